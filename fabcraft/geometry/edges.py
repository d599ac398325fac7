"""Faces seen through their edges: which share one, what hangs together, and cutting the long ones.

Edge k of a face runs from its corner k to its corner k + 1.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float64, Int, Int32, Int64
from scipy.sparse import coo_matrix, csr_matrix, diags
from scipy.sparse.csgraph import connected_components

from fabcraft.mesh import Mesh


def edge_uses(
    faces: Int[np.ndarray, "F 3"],
) -> tuple[Int64[np.ndarray, "F 3"], Int64[np.ndarray, " E"]]:
    """For every face the edge (corner k to k + 1) it uses, and how many faces use each edge."""
    _, edges, counts = distinct_edges(np.stack([faces, np.roll(faces, -1, axis=1)], 2).reshape(-1, 2))
    return edges.reshape(-1, 3), counts


def distinct_edges(
    pairs: Int[np.ndarray, "H 2"],
) -> tuple[Int64[np.ndarray, "E 2"], Int64[np.ndarray, " H"], Int64[np.ndarray, " E"]]:
    """Every pair once, as (lower, higher) in ascending order; which one each row is; how many rows are the same."""
    ordered = np.sort(pairs, axis=1).astype(np.int64)
    # one number sorts many times faster than two
    codes, which, counts = np.unique(ordered @ [2**32, 1], return_inverse=True, return_counts=True)
    return np.stack(np.divmod(codes, 2**32), axis=1), which.reshape(-1), counts.astype(np.int64)


def components(faces: Int[np.ndarray, "F 3"]) -> Int32[np.ndarray, " F"]:
    """Number of the edge-connected component of every face, in order of first appearance."""
    edges, counts = edge_uses(faces)
    owner = np.repeat(np.arange(len(faces)), 3)
    incidence = coo_matrix(
        (np.ones(len(owner), np.int8), (owner, edges.reshape(-1) + len(faces))),
        shape=(len(faces) + len(counts),) * 2,
    )
    return connected_components(incidence, directed=False)[1][: len(faces)].astype(np.int32)


def graph_laplacian(faces: Int[np.ndarray, "F 3"], count: int) -> csr_matrix:
    """Degree minus adjacency of `count` vertices, (V, V): what one is away from the sum of its neighbours."""
    edges, _, _ = distinct_edges(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2))
    both = np.concatenate([edges, edges[:, ::-1]])
    adjacent = coo_matrix((np.ones(len(both)), both.T), shape=(count, count)).tocsr()
    return (diags(np.asarray(adjacent.sum(1)).ravel()) - adjacent).tocsr()


Length = Callable[[Float64[np.ndarray, "N 3"]], Float64[np.ndarray, " N"]]
"""A length, mm, for every place."""


def split_edges(mesh: Mesh, longest_mm: float | Length, most_faces: int | None = None) -> Mesh:
    """The same surface with no edge above `longest_mm`: longer ones are halved, without gaps.

    longest_mm : one length, or a function of the edges' middles.  most_faces : above that many it is left unfinished.
    """
    while most_faces is None or len(mesh.faces) <= most_faces:
        a, b = mesh.vertices[mesh.faces], mesh.vertices[np.roll(mesh.faces, -1, axis=1)]
        middles = 0.5 * (a + b).reshape(-1, 3)
        limit = longest_mm(middles).reshape(-1, 3) if callable(longest_mm) else longest_mm
        long = np.linalg.norm(b - a, axis=2) > limit
        if not long.any():
            break
        mesh = halved(mesh, long)
    return mesh


def halved(mesh: Mesh, long: Bool[np.ndarray, "F 3"]) -> Mesh:
    """Faces cut into two, three or four at the middles of their `long` edges."""
    edges, counts = edge_uses(mesh.faces)
    first = np.zeros(len(counts), np.int64)
    first[edges.reshape(-1)] = np.arange(edges.size)
    cut = np.zeros(len(counts), bool)
    cut[edges[long]] = True
    number = np.cumsum(cut) - 1 + len(mesh.vertices)
    face, corner = np.divmod(first[cut], 3)
    middles = 0.5 * (
        mesh.vertices[mesh.faces[face, corner]] + mesh.vertices[mesh.faces[face, (corner + 1) % 3]]
    )
    pieces = [mesh.faces[~cut[edges].any(1)].astype(np.int64)]
    for pattern, triangles in _PATTERNS.items():
        mine = (cut[edges] == pattern).all(1)
        # Columns 0-2: corners; 3-5: the middles of the edges 01, 12, 20.
        points = np.concatenate([mesh.faces[mine].astype(np.int64), number[edges[mine]]], 1)
        pieces += [points[:, triangle] for triangle in triangles]
    return Mesh(np.concatenate([mesh.vertices, middles]), np.concatenate(pieces).astype(np.int32), mesh.name)


_PATTERNS: dict[tuple[bool, bool, bool], list[list[int]]] = {
    (True, False, False): [[0, 3, 2], [3, 1, 2]],
    (False, True, False): [[0, 1, 4], [0, 4, 2]],
    (False, False, True): [[0, 1, 5], [5, 1, 2]],
    (True, True, False): [[3, 1, 4], [0, 3, 2], [3, 4, 2]],
    (False, True, True): [[4, 2, 5], [0, 1, 5], [1, 4, 5]],
    (True, False, True): [[0, 3, 5], [3, 1, 5], [1, 2, 5]],
    (True, True, True): [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]],
}
