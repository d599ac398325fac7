"""Loop subdivision as a sparse matrix, so that all that lives on vertices can follow.

Weights: C. Loop, "Smooth subdivision surfaces based on triangles", 1987, with Warren's vertex weights
(beta = 3/16 for three neighbours, 3/(8 n) for n > 3); on an open boundary the cubic B-spline rule.
"""

import numpy as np
from jaxtyping import Float64, Int32
from scipy.sparse import coo_matrix, csr_matrix

from fabcraft.geometry.edges import distinct_edges


def loop_matrix(
    faces: Int32[np.ndarray, "F 3"], vertex_count: int
) -> tuple[csr_matrix, Int32[np.ndarray, "F4 3"]]:
    """One step of Loop subdivision.

    Returns (S, new_faces): S (V + E, V), rows sum to 1, the first V rows are the old vertices moved and the
    others one point per edge; new_faces (4 F, 3), the four children of face f at 4 f .. 4 f + 3.
    """
    halves = faces[:, [[1, 2], [2, 0], [0, 1]]].reshape(-1, 2)  # edge k is opposite corner k
    edges, edge_of_half, uses = distinct_edges(halves)
    inner = uses == 2
    odd = _edge_rows(edges, edge_of_half, faces.reshape(-1), inner, vertex_count)
    even = _vertex_rows(edges, inner, vertex_count)
    rows, columns, weights = (np.concatenate(parts) for parts in zip(even, odd, strict=True))
    matrix = coo_matrix((weights, (rows, columns)), shape=(vertex_count + len(edges), vertex_count)).tocsr()
    middles = (edge_of_half.reshape(-1, 3) + vertex_count).astype(np.int32)
    (a, b, c), (p, q, r) = faces.T, middles.T  # p opposite a, q opposite b, r opposite c
    children = np.stack([[a, r, q], [r, b, p], [q, p, c], [p, q, r]])  # 4, 3, F
    return matrix, np.ascontiguousarray(children.transpose(2, 0, 1).reshape(-1, 3), dtype=np.int32)


def _edge_rows(edges, edge_of_half, opposite, inner, vertex_count):
    """New points: 3/8 (a + b) + 1/8 (both opposite corners); the middle of a boundary edge."""
    ends = np.where(inner, 3 / 8, 1 / 2)
    shared = inner[edge_of_half]
    row = np.arange(len(edges)) + vertex_count
    rows = np.concatenate([row, row, edge_of_half[shared] + vertex_count])
    columns = np.concatenate([edges[:, 0], edges[:, 1], opposite[shared]])
    return rows, columns, np.concatenate([ends, ends, np.full(shared.sum(), 1 / 8)])


def _vertex_rows(edges, inner, vertex_count):
    """Old points: (1 - n beta) v + beta sum of the n neighbours; 3/4 v + 1/8 of both on a boundary."""
    on_rim = np.zeros(vertex_count, dtype=bool)
    on_rim[edges[~inner]] = True
    pairs = np.concatenate([edges, edges[:, ::-1]])
    along_rim = np.concatenate([~inner, ~inner])
    counts = np.bincount(pairs[:, 0], minlength=vertex_count)
    beta = np.where(counts > 3, 3 / (8 * np.maximum(counts, 1)), 3 / 16)
    weight = np.where(on_rim[pairs[:, 0]], np.where(along_rim, 1 / 8, 0.0), beta[pairs[:, 0]])
    own = 1.0 - np.bincount(pairs[:, 0], weights=weight, minlength=vertex_count)
    index = np.arange(vertex_count)
    return (
        np.concatenate([index, pairs[:, 0]]),
        np.concatenate([index, pairs[:, 1]]),
        np.concatenate([own, weight]),
    )


def halving_matrix(
    vertices: Float64[np.ndarray, "V 3"], faces: Int32[np.ndarray, "F 3"], longest_mm: float
) -> tuple[csr_matrix, Int32[np.ndarray, "G 3"]]:
    """One step that halves every edge longer than `longest_mm`; the surface stays where it is.

    Returns (S, new_faces): S (V + M, V) appends the middles of the M long edges; faces without one are kept.
    """
    ends = faces[:, [[1, 2], [2, 0], [0, 1]]]  # edge k is opposite corner k
    edges, edge_of_half, _ = distinct_edges(ends.reshape(-1, 2))
    long = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1) > longest_mm
    place = np.where(long, len(vertices) + np.cumsum(long) - 1, -1)
    middles = place[edge_of_half.reshape(-1, 3)]
    new = [faces[(middles < 0).all(1)]]
    for first in range(3):  # corner a opposite the only long edge, or opposite the only short one
        (a, b, c), (p, q, r) = np.roll(faces, -first, 1).T, np.roll(middles, -first, 1).T
        one = (p >= 0) & (q < 0) & (r < 0)
        two = (p < 0) & (q >= 0) & (r >= 0)
        new += [np.stack(corners, 1)[one] for corners in ((a, b, p), (a, p, c))]
        new += [np.stack(corners, 1)[two] for corners in ((a, r, q), (r, b, c), (r, c, q))]
    three = (middles >= 0).all(1)
    (a, b, c), (p, q, r) = faces[three].T, middles[three].T
    new += [np.stack(corners, 1) for corners in ((a, r, q), (r, b, p), (q, p, c), (p, q, r))]
    count, added = len(vertices), int(long.sum())
    rows = np.concatenate([np.arange(count), np.repeat(count + np.arange(added), 2)])
    columns = np.concatenate([np.arange(count), edges[long].ravel()])
    weights = np.concatenate([np.ones(count), np.full(2 * added, 0.5)])
    matrix = coo_matrix((weights, (rows, columns)), shape=(count + added, count)).tocsr()
    return matrix, np.concatenate(new).astype(np.int32)
