"""Edges of a triangle mesh and what follows from them: parts, orientation, cavities, genus.

The mesh is welded first (vertices at exactly the same place are one), and its faces have three different
corners.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fabcraft.mesh import Mesh


@dataclass(frozen=True, eq=False)
class Edges:
    """The edges of a welded mesh, by the two half-edges of the ordinary ones."""

    start: np.ndarray
    end: np.ndarray
    face: np.ndarray
    count: np.ndarray
    """Faces of every half-edge's edge."""
    balance: np.ndarray
    """Of every half-edge's edge: faces going one way minus the other way."""
    pairs: np.ndarray
    """(P, 2) half-edges of the edges with two faces."""


def welded(mesh: Mesh) -> tuple[Float64[np.ndarray, "W 3"], Int64[np.ndarray, "F 3"]]:
    """Vertices at exactly the same place become one."""
    if len(mesh.vertices) == 0:
        return np.zeros((0, 3)), mesh.faces.astype(np.int64)
    order = np.lexsort(mesh.vertices.T)
    ordered = mesh.vertices[order]
    first = np.concatenate([[True], (ordered[1:] != ordered[:-1]).any(1)])
    compact = np.empty(len(order), dtype=np.int64)
    compact[order] = np.cumsum(first) - 1
    return ordered[first], compact[mesh.faces]


def edges_of(faces: np.ndarray, vertex_count: int) -> Edges:
    """Half-edges grouped by edge."""
    start = faces.reshape(-1)
    end = np.roll(faces, -1, axis=1).reshape(-1)
    key = np.minimum(start, end) * vertex_count + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    key, start, end, face = key[order], start[order], end[order], np.repeat(np.arange(len(faces)), 3)[order]
    group = np.cumsum(np.concatenate([[0], key[1:] != key[:-1]])) if len(key) else np.zeros(0, dtype=np.int64)
    counts = np.bincount(group)
    balance = np.bincount(group, weights=np.where(start < end, 1.0, -1.0))
    first = np.flatnonzero(counts[group] == 2)[::2] if len(key) else np.zeros(0, dtype=np.int64)
    pairs = np.stack([first, first + 1], 1)
    return Edges(start, end, face, counts[group], balance[group], pairs)


def components(rows: np.ndarray, columns: np.ndarray, nodes: int) -> tuple[int, np.ndarray]:
    graph = coo_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(nodes, nodes))
    count, labels = connected_components(graph, directed=False)
    return int(count), labels.astype(np.int64)


def parts_of(edges: Edges, face_count: int) -> tuple[int, np.ndarray]:
    if face_count == 0:
        return 0, np.zeros(0, dtype=np.int64)
    rows, columns = edges.face[edges.pairs].T
    return components(rows, columns, face_count)


def orientation_of(
    vertices: np.ndarray, faces: np.ndarray, edges: Edges, parts: int, part_of_face: np.ndarray
) -> tuple[np.ndarray, int]:
    """Which faces look the wrong way, and how many parts are cavities.

    Every face has two sides; sides of neighbours are joined in a graph, so that a side's component is one
    consistent orientation of the part. The outward one encloses a positive volume; a part inside another may
    look either way and is left as most of its faces have it.
    """
    count = len(faces)
    turned = np.zeros(count, dtype=bool)
    if count == 0:
        return turned, 0
    one, other = edges.face[edges.pairs].T
    clash = edges.start[edges.pairs[:, 0]] == edges.start[edges.pairs[:, 1]]
    rows = np.concatenate([one, one + count])
    columns = np.concatenate([other + count * clash, other + count * ~clash])
    _, side = components(rows, columns, 2 * count)
    seed = np.zeros(parts, dtype=np.int64)
    seed[part_of_face[::-1]] = np.arange(count)[::-1]  # the first face of every part
    against = side[:count] != side[seed[part_of_face]]
    a, b, c = vertices[faces].transpose(1, 0, 2)
    volumes = np.einsum("ij,ij->i", a - vertices.mean(0), np.cross(b - a, c - a)) / 6.0
    volume = np.bincount(part_of_face, weights=np.where(against, -volumes, volumes), minlength=parts)
    size = np.bincount(part_of_face, minlength=parts)
    disagree = np.bincount(part_of_face, weights=against, minlength=parts)
    closed = np.bincount(part_of_face[edges.face[edges.count != 2]], minlength=parts) == 0
    flip = disagree * 2 > size
    outward = np.where(flip, -volume, volume) > 0
    nested = np.zeros(parts, dtype=bool)
    for part in np.flatnonzero(closed & ~outward):
        nested[part] = _lies_inside(vertices, faces, part_of_face, int(part))
    flip = np.where(closed & ~nested & ~outward, ~flip, flip)
    return against ^ flip[part_of_face], int(nested.sum())


def _lies_inside(vertices: np.ndarray, faces: np.ndarray, part_of_face: np.ndarray, part: int) -> bool:
    """Whether the others wind around a vertex of the part (solid angles: Oosterom, Strackee 1983)."""
    point = vertices[faces[np.argmax(part_of_face == part), 0]]
    a, b, c = (vertices[faces[part_of_face != part]] - point).transpose(1, 0, 2)
    la, lb, lc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    triple = np.einsum("ij,ij->i", a, np.cross(b, c))
    below = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return bool(abs(np.arctan2(triple, below).sum() / (2 * np.pi)) > 0.5)


def genus_of(faces: np.ndarray, edges: Edges, parts: int) -> int:
    """Sum over the parts of 1 - (V - E + F)/2, a vertex counted once for every fan of faces around it."""
    # Corners of two neighbours that lie on the same end of their shared edge belong to the same fan.
    joined = []
    for end in (edges.start[edges.pairs[:, 0]], edges.end[edges.pairs[:, 0]]):
        owners = edges.face[edges.pairs]
        joined.append(owners * 3 + (faces[owners] == end[:, None, None]).argmax(2))
    rows, columns = np.concatenate(joined).T
    fans, _ = components(rows, columns, faces.size)
    return int(parts - (fans - len(edges.pairs) + len(faces)) // 2)
