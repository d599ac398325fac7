"""Distances along a surface, from face to face over the middles of the edges between them."""

import numpy as np
from jaxtyping import Bool, Float64
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from fabcraft.geometry.operators import edge_faces
from fabcraft.mesh import Mesh


def face_distances(mesh: Mesh, sources: Bool[np.ndarray, " F"], limit_mm: float) -> Float64[np.ndarray, " F"]:
    """Length of the shortest such way from each face's middle to one of the `sources`'; infinite beyond the limit.

    The ways turn with the triangles and so are up to a quarter too long.  Needs at least one source.
    Raises `InputError` when more than two faces meet at an edge.
    """
    edges, sides = edge_faces(mesh.faces)
    shared = (sides >= 0).all(1)
    one, other = sides[shared].T
    middles, crossed = mesh.corners.mean(1), mesh.vertices[edges[shared]].mean(1)
    ways = sum(np.linalg.norm(middles[face] - crossed, axis=1) for face in (one, other))
    graph = csr_matrix((ways, (one, other)), shape=(len(mesh.faces),) * 2)
    found: Float64[np.ndarray, " F"] = dijkstra(
        graph, directed=False, indices=np.flatnonzero(sources), min_only=True, limit=limit_mm
    )
    return found
