"""The two sides of a wall kept apart: what looked away from the body stays behind what looked at it.

Guidance that was made for another body, or a push off this one, may carry one side of a thin wall through the other: between
them the solid is inside out, and there is nothing that could be printed.
"""

import numpy as np
from jaxtyping import Float64

from fabcraft.fit.settle import lifted, spreading
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh

_LOOKS = 0.3
"""Cosine with the way off the body from which on a place looks away from it; less than its opposite: at it."""
_ROUNDS, _TOLERANCE = 10, 0.03
_BESIDE = 0.5
"""Sideways over the way between: what is farther beside the nearest place of the other side is not behind it."""


def kept_apart(
    mesh: Mesh,
    origin: Float64[np.ndarray, "V 3"],
    distance: SurfaceDistance,
    wall_mm: float,
    spread_mm: float,
) -> tuple[Mesh, float]:
    """The mesh with its outer side at least `wall_mm` behind its inner one, and the largest push, mm.

    origin : where the vertices were built, which says what the sides are; a wall that was built thinner stays so.
    spread_mm : how wide a push is felt.
    """
    built = mesh.with_vertices(origin)
    out = distance.signed_with_gradient(np.concatenate([origin, built.corners.mean(1)]))[1]
    outer = np.flatnonzero(np.einsum("ij,ij->i", built.vertex_normals, out[: len(origin)]) > _LOOKS)
    inner = np.einsum("ij,ij->i", built.face_normals, out[len(origin) :]) < -_LOOKS
    if not len(outer) or not inner.any():
        return mesh, 0.0
    behind, beside, _ = _across(built, outer, inner)
    sound = (behind > 0.0) & (beside <= _BESIDE * behind)
    outer, wanted = outer[sound], np.minimum(wall_mm, behind[sound])
    spread, points, largest = spreading(mesh, spread_mm), mesh.vertices.copy(), 0.0
    for _ in range(_ROUNDS):
        behind, beside, away = _across(mesh.with_vertices(points), outer, inner)
        missing = np.where(beside <= _BESIDE * np.maximum(wanted, np.abs(behind)), wanted - behind, 0.0)
        missing[missing > wanted + spread_mm] = 0.0  # a fold: its nearest place is none of its wall
        missing = np.maximum(missing, 0.0)
        if missing.max(initial=0.0) <= _TOLERANCE * wall_mm:
            break
        largest = max(largest, float(missing.max()))
        lacking, ways = np.zeros(len(points)), np.zeros_like(points)
        lacking[outer], ways[outer] = missing, away
        points += lifted(spread, lacking, ways)
    return mesh.with_vertices(points), largest


def _across(mesh: Mesh, outer: np.ndarray, inner: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the outer vertices: how far behind the nearest place of the inner faces, how far beside it; the way out there."""
    side = mesh.submesh(inner)
    found = SurfaceDistance(side).closest(mesh.vertices[outer])
    away = -side.face_normals[found.faces]
    off = mesh.vertices[outer] - found.points
    behind = np.einsum("ij,ij->i", off, away)
    return behind, np.linalg.norm(off - behind[:, None] * away, axis=1), away
