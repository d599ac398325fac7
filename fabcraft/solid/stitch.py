"""Vertices that should be one, made one: near corners of loose faces, and corners that lie on a neighbour's edge.

Exporters write every face with corners of its own, rounded apart, and modellers leave T-junctions: a fine side ends on
the long edges of a coarse one. Both look like gaps although nothing is missing.
"""

import numpy as np
from jaxtyping import Int64
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fabcraft.geometry.edges import edge_uses
from fabcraft.mesh import Mesh

ON_EDGE_MM = 0.01
"""A corner this near to an edge lies on it."""
_ROUNDS = 8
_STEP_MM = 2.0
_SHORTEST = 0.3


def near_corners(mesh: Mesh, distance_mm: float) -> tuple[np.ndarray, Int64[np.ndarray, "F 3"]]:
    """Vertices and faces with corners nearer than `distance_mm` made one, at their mean.

    Never more than 0.3 of the short edges (their 2nd percentile): faces are to be joined, not lost.
    """
    corners = mesh.corners
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    reach = min(distance_mm, _SHORTEST * float(np.percentile(edges, 2)))
    pairs = cKDTree(mesh.vertices).query_pairs(reach, output_type="ndarray")
    count = len(mesh.vertices)
    graph = coo_array((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    groups, label = connected_components(graph, directed=False)
    size = np.bincount(label, minlength=groups)
    mean = np.stack([np.bincount(label, mesh.vertices[:, k], groups) / size for k in range(3)], 1)
    return mean, label[mesh.faces].astype(np.int64)


def without_t_junctions(mesh: Mesh) -> tuple[Mesh, int]:
    """Faces split where a corner on a border lies on a border's edge, and how many corners were put in."""
    put_in = 0
    for _ in range(_ROUNDS):
        edges, counts = edge_uses(mesh.faces)
        face, side = np.nonzero(counts[edges] == 1)
        if len(face) == 0:
            break
        start, end = mesh.faces[face, side], mesh.faces[face, (side + 1) % 3]
        row, vertex, share = _on_edges(mesh.vertices, start, end)
        # One edge of a face at a time; the other edges have their turn in the next round.
        _, first = np.unique(face[row], return_index=True)
        mine = np.isin(row, row[first])
        row, vertex, share = row[mine], vertex[mine], share[mine]
        if len(row) == 0:
            break
        mesh = _fanned(mesh, face, side, row, vertex, share)
        put_in += len(row)
    return mesh, put_in


def _on_edges(
    vertices: np.ndarray, start: np.ndarray, end: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Border vertices inside border edges: number of the edge, vertex, and share of the way; by edge."""
    border = np.unique(np.concatenate([start, end]))
    tree = cKDTree(vertices[border])
    along = vertices[end] - vertices[start]
    length = np.linalg.norm(along, axis=1)
    steps = np.minimum(np.ceil(length / _STEP_MM), 10_000).astype(np.int64)
    owner = np.repeat(np.arange(len(start)), steps)
    rank = np.arange(len(owner)) - np.repeat(np.cumsum(steps) - steps, steps)
    middle = vertices[start][owner] + ((rank + 0.5) / steps[owner])[:, None] * along[owner]
    reach = 0.5 * length[owner] / steps[owner] + ON_EDGE_MM
    found = tree.query_ball_point(middle, reach)
    hits = np.array([len(some) for some in found])
    if hits.sum() == 0:
        return (np.zeros(0, np.int64),) * 2 + (np.zeros(0),)
    pairs = np.unique(
        np.stack(
            [np.repeat(owner, hits), border[np.concatenate([np.array(one, np.int64) for one in found])]], 1
        ),
        axis=0,
    )
    row, vertex = pairs.T
    off = vertices[vertex] - vertices[start[row]]
    share = (off * along[row]).sum(1) / np.maximum(length[row] ** 2, 1e-300)
    aside = np.linalg.norm(off - share[:, None] * along[row], axis=1)
    inner = (share * length[row] > ON_EDGE_MM) & ((1 - share) * length[row] > ON_EDGE_MM)
    keep = inner & (aside <= ON_EDGE_MM)
    order = np.lexsort([share[keep], row[keep]])
    return row[keep][order], vertex[keep][order], share[keep][order]


def _fanned(
    mesh: Mesh, face: np.ndarray, side: np.ndarray, row: np.ndarray, vertex: np.ndarray, share: np.ndarray
) -> Mesh:
    """Each edge `row` opened at its vertices: a fan of triangles from the opposite corner."""
    split, first, counts = np.unique(row, return_index=True, return_counts=True)
    faces = mesh.faces.astype(np.int64)
    start = faces[face[split], side[split]]
    end = faces[face[split], (side[split] + 1) % 3]
    tip = faces[face[split], (side[split] + 2) % 3]
    chain = np.insert(vertex, first, start)
    owner = np.repeat(np.arange(len(split)), counts + 1)
    last = np.cumsum(counts + 1) - 1
    following = np.empty_like(chain)
    following[:-1] = chain[1:]
    following[last] = end
    fan = np.stack([chain, following, tip[owner]], 1)
    kept = np.ones(len(faces), bool)
    kept[face[split]] = False
    return Mesh(mesh.vertices, np.concatenate([faces[kept], fan]).astype(np.int32), mesh.name)
