"""Which vertices of the baked skin make up each region of a person (extra `fabcraft[bake]`).

A region is a disc round places (along edges on the face, straight where the skin is coarse and even), a band round a
limb, or the support of a local change of anny: the vertices that it moves by more than a share of the largest
displacement.  Distances are the neutral adult's.  Only the left one of a pair is sought; the right one is its mirror
image.
"""

from collections.abc import Callable, Iterable

import numpy as np
from jaxtyping import Float64, Int32
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from fabcraft.body.bake_skin import mirrored
from fabcraft.body.body import Body
from fabcraft.geometry.edges import distinct_edges

Support = Callable[[str, float], np.ndarray]
Disc = Callable[[Iterable[int], float], np.ndarray]
Members = dict[str, np.ndarray]


def region_members(person: Body, lid: int, support: Support) -> tuple[Members, Members]:
    """(vertex indices of every region, emphasis of those that have one), for the neutral adult.

    lid : centre of the fan between the left lids.  support : (change, share) to the vertices that it moves.
    """
    graph = _edge_lengths(person.mesh.vertices, person.mesh.faces)

    def disc(seeds: Iterable[int], radius_mm: float) -> np.ndarray:
        reach = dijkstra(graph, indices=np.unique(list(seeds)), min_only=True, limit=radius_mm)
        return np.flatnonzero(np.isfinite(reach))

    members = _face(person, lid, disc, support) | _skull_and_neck(person, disc) | _foot(person)
    emphasis: Members = {}
    for name, start, end, between, lowest in (
        ("wrist_left", "wrist_left", "lowerarm_left", (-0.05, 0.10), 0.25),
        ("ring_finger_left", "finger4_1_left", "finger4_2_left", (0.45, 0.72), 0.5),
    ):
        band, along = _band(person, start, end, between)
        members[name], emphasis[name] = band, _palm_share(person, along, band, lowest)
    opposite = mirrored(person.mesh.vertices)
    for name in [name for name in members if name.endswith("_left")]:
        right = opposite[members[name]]
        order, other = np.argsort(right), name.replace("_left", "_right")
        members[other] = right[order]
        if name in emphasis:
            emphasis[other] = emphasis[name][order]
    return members, emphasis


def _face(person: Body, lid: int, disc: Disc, support: Support) -> Members:
    vertices, mark = person.mesh.vertices, person.landmarks
    middle = vertices[np.unique(person.mesh.faces[(person.mesh.faces == lid).any(1)])].mean(0)  # of the eye
    brow = mark["glabella"][2] + 20.0

    def front(places: Iterable[tuple[float, float]], radius_mm: float) -> np.ndarray:
        return disc([_front_vertex(vertices, place) for place in places], radius_mm)

    return {
        "forehead": front([(x, brow) for x in np.arange(-35.0, 36.0, 2.5)], 9.0),
        "cheekbone_left": front([(middle[0] + 14.0, middle[2] - 27.0)], 12.0),
        "nose_bridge": front([(0.0, mark["sellion"][2])], 8.0),
        "nose_tip": front([(0.0, mark["pronasale"][2])], 10.0),
        "nose_flank_left": front([(8.0, mark["sellion"][2] - 11.0)], 6.0),
        "lips": np.union1d(
            support("mouth-lowerlip-volume-incr", 0.35), support("mouth-upperlip-volume-incr", 0.35)
        ),
        # straight distances: the folds of the lids would make edge paths long and leave out the outer corner
        "eye_left": np.flatnonzero(np.linalg.norm(vertices - middle, axis=1) <= 19.0),
        "ear_left": support("l-ear-trans-up", 0.97),
        "chin": front([(0.0, mark["menton"][2] + 14.0)], 14.0),
    }


def _skull_and_neck(person: Body, disc: Disc) -> Members:
    mesh, mark = person.mesh, person.landmarks
    vertices, normals = mesh.vertices, mesh.vertex_normals

    def pad(seeds: Iterable[int], radius_mm: float) -> np.ndarray:
        away = np.linalg.norm(vertices[:, None] - vertices[None, list(seeds)], axis=2).min(1)
        return np.flatnonzero(away <= radius_mm)

    def at(point: np.ndarray, facing: np.ndarray) -> int:
        """The vertex nearest to `point` of those that face that way."""
        right = np.flatnonzero(normals @ facing > 0.5)
        return int(right[np.linalg.norm(vertices[right] - point, axis=1).argmin()])

    left, back, front = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), np.array([0.0, -1.0, 0.0])
    low, high = mark["jugular_notch"], mark["menton"]
    heights = np.arange(low[2] + 22.0, high[2] - 45.0, 5.0)
    return {
        "crown": pad([at(mark["vertex"], np.array([0.0, 0.0, 1.0]))], 35.0),
        "temple_left": pad([at(mark["ear_tip_left"] + [0.0, -22.0, 22.0], left)], 15.0),
        "nape": pad([at(mark["opisthocranion"] - [0.0, 0.0, 58.0], back)], 20.0),
        "ear_root_left": disc([at(mark["ear_root_top_left"], left)], 10.0),
        "collarbone_left": pad([at(mark["collarbone_left"], front)], 18.0),
        "nape_low": pad([at(mark["cervicale"], back)], 20.0),
        "throat": pad([at(np.array([0.0, low[1], height]), front) for height in heights], 20.0),
    }


def _foot(person: Body) -> Members:
    mesh, mark = person.mesh, person.landmarks
    vertices, down = mesh.vertices, -mesh.vertex_normals[:, 2]
    heel, along = mark["heel_left"], (mark["toe_tip_left"] - mark["heel_left"]) * [1.0, 1.0, 0.0]
    width = mark["ball_lateral_left"] - mark["ball_medial_left"]
    share = (vertices - heel) @ along / (along @ along)
    outward = (vertices - mark["ball_medial_left"]) @ width / (width @ width)
    ankle = person.joints["foot_left"]
    foot = (np.abs(vertices[:, 0] - ankle[0]) < 120.0) & (vertices[:, 2] < ankle[2])
    sole, toes = (
        foot & (down > 0.35),
        foot & (share > 0.81 - 0.13 * outward),
    )  # the little toe begins farther back
    instep = np.linalg.norm(vertices - mark["instep_left"], axis=1) < 24.0
    places = {
        "sole_heel_left": sole & (share < 0.22),
        "sole_ball_left": sole & ~toes & (share > 0.78 - 0.17 - 0.13 * outward),
        "sole_toes_left": sole & toes,
        "toes_left": toes & ~sole,
        "instep_left": instep & (down < 0.0),
    }
    return {name: np.flatnonzero(inside) for name, inside in places.items()}


def _band(
    person: Body, start: str, end: str, between: tuple[float, float]
) -> tuple[np.ndarray, Float64[np.ndarray, "3"]]:
    """(the skin round the bone from `start` to `end`, between two shares of its length; the bone's direction)."""
    base, bone = person.joints[start], person.joints[end] - person.joints[start]
    length = float(np.linalg.norm(bone))
    away = person.mesh.vertices - base
    share = away @ bone / length**2
    distance = np.linalg.norm(away - share[:, None] * bone, axis=1)
    near = (share > between[0]) & (share < between[1]) & (distance < 0.45 * length)
    return np.flatnonzero(near), bone / length


def _palm_share(
    person: Body, along: Float64[np.ndarray, "3"], members: np.ndarray, lowest: float
) -> Float64[np.ndarray, " N"]:
    """1 on the palm's side of a band, `lowest` on the back, even between."""
    back = person.landmarks["wrist_back_left"] - person.landmarks["wrist_palm_left"]
    palm = along * (back @ along) - back
    facing = person.mesh.vertex_normals[members] @ (palm / np.linalg.norm(palm))
    return lowest + (1.0 - lowest) * np.clip(0.5 + 0.5 * facing, 0.0, 1.0)


def _front_vertex(vertices: np.ndarray, place: tuple[float, float]) -> int:
    """The foremost vertex within 4 mm of (x, z) in the front view, or the nearest where there is none."""
    away = np.linalg.norm(vertices[:, [0, 2]] - place, axis=1)
    near = np.flatnonzero(away < max(4.0, away.min() + 1e-9))
    return int(near[vertices[near, 1].argmin()])


def _edge_lengths(vertices: Float64[np.ndarray, "V 3"], faces: Int32[np.ndarray, "F 3"]) -> coo_matrix:
    edges, _, _ = distinct_edges(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2))
    both = np.concatenate([edges, edges[:, ::-1]])
    lengths = np.linalg.norm(vertices[both[:, 0]] - vertices[both[:, 1]], axis=1)
    return coo_matrix((lengths, both.T), shape=(len(vertices),) * 2).tocsr()
