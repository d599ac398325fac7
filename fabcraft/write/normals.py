"""Shading normals that keep a crisp ridge crisp and a curved area smooth.

Corners of faces around a vertex share a normal while the surface between them bends by less than the crease
angle; the shared normal is the mean of the face normals weighted by the corner angle (Thürmer and Wüthrich
1998).
"""

import numpy as np
from jaxtyping import Float64, Int64
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from fabcraft.mesh import Mesh

CREASE_DEG = 40.0
"""Two faces that bend by more than this meet in a visible edge."""


def corner_groups(mesh: Mesh, crease_deg: float = CREASE_DEG) -> Int64[np.ndarray, "F 3"]:
    """Label (F, 3) of every face corner; corners of one vertex with one label are smooth across one
    another."""
    faces = mesh.faces.astype(np.int64)
    count = len(faces)
    if not count:
        return np.zeros((0, 3), dtype=np.int64)
    start = np.arange(3 * count)
    end = 3 * (start // 3) + (start % 3 + 1) % 3  # the next corner of the same face
    a, b = faces.reshape(-1)[start], faces.reshape(-1)[end]
    key = np.minimum(a, b) * len(mesh.vertices) + np.maximum(a, b)
    order = np.argsort(key, kind="stable")
    key = key[order]
    same = key[1:] == key[:-1]
    # exactly two faces at the edge: neither neighbour in the sorted list belongs to a third
    alone = same & ~np.r_[False, same[:-1]] & ~np.r_[same[1:], False]
    first, second = order[:-1][alone], order[1:][alone]
    normals = mesh.face_normals
    bend = np.einsum("ij,ij->i", normals[first // 3], normals[second // 3])
    smooth = bend > np.cos(np.radians(crease_deg))
    first, second = first[smooth], second[smooth]
    # a consistently oriented pair runs along the edge in opposite directions
    opposed = a[first] == b[second]
    left = np.r_[first, end[first]]
    right = np.r_[np.where(opposed, end[second], second), np.where(opposed, second, end[second])]
    graph = coo_matrix((np.ones(len(left), dtype=np.int8), (left, right)), shape=(3 * count, 3 * count))
    return connected_components(graph, directed=False)[1].astype(np.int64).reshape(-1, 3)


def corner_normals(
    mesh: Mesh, groups: Int64[np.ndarray, "F 3"] | None = None
) -> tuple[Float64[np.ndarray, "G 3"], Int64[np.ndarray, "F 3"]]:
    """Unit normal (G, 3) of every group of corners, and the group (F, 3) of every corner."""
    groups = corner_groups(mesh) if groups is None else groups
    corners = mesh.corners
    normals = mesh.face_normals
    size = int(groups.max()) + 1 if groups.size else 0
    total = np.zeros((size, 3))
    for corner in range(3):
        u = corners[:, (corner + 1) % 3] - corners[:, corner]
        v = corners[:, (corner + 2) % 3] - corners[:, corner]
        # atan2(|u × v|, u · v): stable for needles, 0 for a face without area
        angle = np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), np.einsum("ij,ij->i", u, v))
        for axis in range(3):
            total[:, axis] += np.bincount(groups[:, corner], angle * normals[:, axis], minlength=size)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.divide(total, length, out=np.zeros_like(total), where=length > 1e-12), groups


def split_at_creases(
    mesh: Mesh, crease_deg: float = CREASE_DEG
) -> tuple[Int64[np.ndarray, " G"], Int64[np.ndarray, "F 3"], Float64[np.ndarray, "G 3"]]:
    """Vertices as a graphics card wants them: source vertex (G,), faces (F, 3) and unit normals (G, 3)."""
    normals, groups = corner_normals(mesh, corner_groups(mesh, crease_deg))
    source = np.zeros(len(normals), dtype=np.int64)
    source[groups.reshape(-1)] = mesh.faces.reshape(-1)
    return source, groups, normals
