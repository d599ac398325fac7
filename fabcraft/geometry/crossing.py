"""Faces that pass through another face.

MeshLab's test finds the candidates. On long coplanar triangles, which a boolean leaves on slanted sides, it
also names faces that only touch within rounding; so a candidate counts when an edge of one goes through the
other and both its ends lie further than `DEPTH_MM` from the other's plane.
"""

import numpy as np
from jaxtyping import Int64

from fabcraft.errors import MissingError
from fabcraft.mesh import Mesh

DEPTH_MM = 1e-6

# With more candidates than this the mesh does cross itself, and pair by pair would take too long.
_MOST_CANDIDATES = 20_000
_ROWS = 256


def self_intersecting_faces(mesh: Mesh) -> Int64[np.ndarray, " K"]:
    """Indices of the faces that pass through another face by more than `DEPTH_MM`.

    Raises `MissingError` without pymeshlab.
    """
    try:
        import pymeshlab
    except ImportError as error:
        raise MissingError(
            "the test for self-intersection needs pymeshlab", "Run `pip install pymeshlab`."
        ) from error
    if len(mesh.faces) == 0:
        return np.zeros(0, np.int64)
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(np.array(mesh.vertices), np.array(mesh.faces)))
    meshes.compute_selection_by_self_intersections_per_face()
    candidates = np.flatnonzero(meshes.current_mesh().face_selection_array()).astype(np.int64)
    if len(candidates) > _MOST_CANDIDATES:
        return candidates
    return candidates[_crossing(mesh.corners[candidates])]


def _crossing(corners: np.ndarray) -> np.ndarray:
    """Which of the triangles (K, 3, 3) take part in a crossing."""
    found = np.zeros(len(corners), bool)
    lower, upper = corners.min(1), corners.max(1)
    for start in range(0, len(corners), _ROWS):
        rows = slice(start, start + _ROWS)
        meet = (lower[rows, None] <= upper[None]).all(2) & (upper[rows, None] >= lower[None]).all(2)
        one, other = np.nonzero(meet)
        one += start
        through = _edge_through(corners[one], corners[other]) & (one != other)
        found[one[through]] = True
        found[other[through]] = True
    return found


def _edge_through(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Whether an edge of each triangle of `one` goes through its partner in `other`."""
    normal = np.cross(other[:, 1] - other[:, 0], other[:, 2] - other[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    height = np.einsum("nkx,nx->nk", one - other[:, :1], normal)
    through = np.zeros(len(one), bool)
    for k in range(3):
        a, b = height[:, k], height[:, (k + 1) % 3]
        splits = (a * b < 0) & (np.minimum(np.abs(a), np.abs(b)) > DEPTH_MM)
        share = np.divide(a, a - b, out=np.zeros_like(a), where=splits)
        place = one[:, k] + share[:, None] * (one[:, (k + 1) % 3] - one[:, k])
        for edge in range(3):
            along = other[:, (edge + 1) % 3] - other[:, edge]
            across = np.cross(along, place - other[:, edge])
            length = np.maximum(np.linalg.norm(along, axis=1), 1e-300)
            # The border counts: a crossing may run exactly along the edge between two faces.
            splits &= (across * normal).sum(1) > -DEPTH_MM * length
        through |= splits
    return through
