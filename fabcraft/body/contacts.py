"""Places on a skin that an object touches or keeps away from."""

import numpy as np
from jaxtyping import Float64, Int64
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from fabcraft.mesh import Mesh


def skin_disc(mesh: Mesh, points: Float64[np.ndarray, "N 3"], radius_mm: float) -> Int64[np.ndarray, " M"]:
    """Vertices within `radius_mm` of one of the points, measured along the skin; at least the nearest to each.

    Paths run along edges, so a disc reaches a few per cent less far across them than along them.
    """
    vertices = mesh.vertices
    seeds = cKDTree(vertices).query(points)[1]
    near = cKDTree(vertices[seeds]).query(vertices, distance_upper_bound=radius_mm)[0] < np.inf
    faces = mesh.faces[near[mesh.faces].any(1)]
    ends = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    lengths = np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1)
    # every edge inside is there once in each direction, so no length is added up twice
    graph = coo_matrix((lengths, ends.T), shape=(len(vertices),) * 2).tocsr()
    reach = dijkstra(graph, directed=False, indices=np.unique(seeds), min_only=True, limit=radius_mm)
    return np.flatnonzero(np.isfinite(reach))
