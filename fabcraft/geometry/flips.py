"""Flipping edges: the two triangles beside an edge become the two beside their other diagonal.

`towards` flips for shape: of the two diagonals of a fold the one that lies nearer to the surface is kept, which makes round
rims and beads of few triangles look round (data-dependent triangulation, Dyn, Levin and Rippa 1990).
"""

import numpy as np
from jaxtyping import Bool

from fabcraft.geometry.operators import edge_faces
from fabcraft.geometry.voxels import Field
from fabcraft.mesh import Mesh

_ROUNDS = 6
_BENT = 0.97
"""Cosine between the normals of two triangles whose diagonal is worth a thought."""
_LEAST_QUALITY = 0.3
_LEAST_FACING = 0.2
"""Of a new triangle's normal along the surface's normals at its corners."""


def towards(mesh: Mesh, field: Field, least_mm: float) -> Mesh:
    """The closed `mesh` with its edges flipped to where `field` (signed distance, about) is nearer to zero.

    least_mm : how much nearer the middle of the other diagonal must be.  Vertices stay; no flip makes a sliver.
    """
    points, faces, normals = mesh.vertices, np.array(mesh.faces, dtype=np.int64), mesh.vertex_normals
    for _ in range(_ROUNDS):
        edges, pairs = edge_faces(faces)
        one, other = pairs.T
        a, b = edges.T
        c, d = faces[one].sum(1) - a - b, faces[other].sum(1) - a - b
        outward = _normals(points, *faces.T)
        bent = np.flatnonzero((outward[one] * outward[other]).sum(1) < _BENT)
        one, other, a, b, c, d = (array[bent] for array in (one, other, a, b, c, d))
        gain = np.abs(field(0.5 * (points[a] + points[b]))) - np.abs(field(0.5 * (points[c] + points[d])))
        size = len(points)
        better = gain > least_mm
        better &= ~np.isin(np.minimum(c, d) * size + np.maximum(c, d), edges[:, 0] * size + edges[:, 1])
        index = np.flatnonzero(better)
        a, b, c, d, one, other = (array[index] for array in (a, b, c, d, one, other))
        shapely = np.minimum(_quality(points, a, d, c), _quality(points, d, b, c))
        before = np.minimum(_quality(points, a, b, c), _quality(points, a, b, d))
        forward = faces[one, ((faces[one] == a[:, None]).argmax(1) + 1) % 3] == b
        p, q = np.where(forward, a, b), np.where(forward, b, a)  # face `one` runs p, q, c
        facing = np.minimum(_facing(points, normals, p, d, c), _facing(points, normals, d, q, c))
        index = np.flatnonzero((shapely > np.minimum(_LEAST_QUALITY, before)) & (facing > _LEAST_FACING))
        order = index[np.argsort(-gain[better][index], kind="stable")]
        kept = order[independent(one[order], other[order], c[order], d[order], len(faces))]
        if not len(kept):
            break
        faces = flipped(faces, one[kept], other[kept], a[kept], b[kept], c[kept], d[kept])
    return Mesh(points, faces.astype(np.int32), mesh.name)


def _quality(points: np.ndarray, *corners: np.ndarray) -> np.ndarray:
    """4 sqrt(3) area over the sum of the squared edges: 1 for an equilateral triangle, 0 for a sliver."""
    a, b, c = (points[corner] for corner in corners)
    twice = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    squares = sum(((p - q) ** 2).sum(1) for p, q in ((a, b), (b, c), (c, a)))
    return 2.0 * np.sqrt(3.0) * twice / np.maximum(squares, 1e-300)


def _facing(points: np.ndarray, normals: np.ndarray, *corners: np.ndarray) -> np.ndarray:
    """Least cosine between the normal of triangles and the surface's normals at their corners."""
    facing = _normals(points, *corners)
    return np.min([(facing * normals[corner]).sum(1) for corner in corners], axis=0)


def _normals(points: np.ndarray, *corners: np.ndarray) -> np.ndarray:
    a, b, c = (points[corner] for corner in corners)
    across = np.cross(b - a, c - a)
    return across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)


def independent(
    one: np.ndarray, other: np.ndarray, c: np.ndarray, d: np.ndarray, count: int
) -> Bool[np.ndarray, " N"]:
    """The first of any that share a face, or would make the same edge."""
    used, made = np.zeros(count, dtype=bool), set()
    taken = np.zeros(len(one), dtype=bool)
    for index in range(len(one)):
        edge = (min(c[index], d[index]), max(c[index], d[index]))
        if used[one[index]] or used[other[index]] or edge in made:
            continue
        used[[one[index], other[index]]] = taken[index] = True
        made.add(edge)
    return taken


def flipped(
    faces: np.ndarray,
    one: np.ndarray,
    other: np.ndarray,
    a: np.ndarray,
    b: np.ndarray,
    c: np.ndarray,
    d: np.ndarray,
) -> np.ndarray:
    """Faces (a, b, c) and (b, a, d), in either sense, become (a, d, c) and (d, b, c) in the same sense."""
    faces = faces.copy()
    place = (faces[one] == a[:, None]).argmax(1)
    forward = (faces[one[:, None], ((place + 1) % 3)[:, None]][:, 0] == b)[:, None]
    faces[one] = np.where(forward, np.column_stack([a, d, c]), np.column_stack([d, a, c]))
    faces[other] = np.where(forward, np.column_stack([d, b, c]), np.column_stack([b, d, c]))
    return faces
