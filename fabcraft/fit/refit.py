"""A guidance mesh refitted to its wearer: bent as little as it takes to go round this body, not the one it was made for.

A similarity makes no oval wrist of a round one. Guidance that stays in the body asks for what cannot be: the object's inner
side is held by the body while its outer one is drawn inside it, and the wall between them crumples.
"""

import numpy as np

from fabcraft.errors import InputError
from fabcraft.fit.settle import clear, lifted, spreading
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh

_AWAY = 0.3
"""Cosine with the way out from which on a place looks away from the skin."""
_ROUNDS, _TOLERANCE_MM = 10, 0.03
_DEEPEST = 0.15
"""Of its size: what is deeper in the body, like a ball round a head, cannot be bent out of it."""


def refitted(
    goal: Mesh,
    seat: Mesh | None,
    body: SurfaceDistance,
    clearance_mm: float,
    least_mm: float = 0.0,
    wall_mm: float = 0.0,
) -> Mesh:
    """The aligned guidance mesh (mm), nowhere nearer to the body than `clearance_mm`, and with room for the seat's wall.

    seat : the part of the template that keeps its shape and looks at the skin; None where there is none.  What looks away
    from the skin makes room for a wall of `least_mm`, or of `wall_mm` where some of it lay behind the seat, which then is
    another's; all else comes at least to the seat; only outwards, and neighbours go with it.
    Guidance that goes deep into the body stays where it is, and what of it lies in the body is left out.
    Raises `InputError` where all of it does.
    """
    size = float(goal.size_mm.max())
    if body.signed(goal.vertices).min() < -_DEEPEST * size:
        outside = body.signed(goal.corners.mean(1)) >= clearance_mm
        if not outside.any():
            raise InputError(
                f"the guidance mesh {goal.name or ''} lies inside the body altogether",
                "Align it with the template first.",
            )
        return goal.submesh(outside)
    wide = min(5.0, 0.1 * size)
    roomy = goal if seat is None else _over(goal, seat, least_mm, max(least_mm, wall_mm), wide)
    return clear(roomy, body, np.full(len(goal.vertices), clearance_mm), wide)[0]


def _over(goal: Mesh, seat: Mesh, least_mm: float, wall_mm: float, wide_mm: float) -> Mesh:
    """The mesh pushed out to the seat, and before it by a wall where there is none."""
    surface, spread, points = SurfaceDistance(seat), spreading(goal, wide_mm), goal.vertices.copy()
    least = np.zeros(len(points))
    for rounds in range(_ROUNDS):
        near = surface.closest(points)
        out = -seat.face_normals[near.faces]
        off = points - near.points
        high = np.einsum("ij,ij->i", off, out)
        if rounds == 0:
            looks_away = np.einsum("ij,ij->i", goal.vertex_normals, out) > _AWAY
            behind = (
                looks_away & (np.linalg.norm(off - high[:, None] * out, axis=1) <= wall_mm) & (high < 0.0)
            )
            least[looks_away] = wall_mm if behind.any() else least_mm
        # a little beyond its border the seat goes on: a wider band is not to narrow the way over the hand
        over = np.linalg.norm(off - high[:, None] * out, axis=1) <= wall_mm
        missing = np.where(over, np.maximum(least - high, 0.0), 0.0)
        if missing.max(initial=0.0) <= _TOLERANCE_MM:
            break
        points = points + lifted(spread, missing, out)
    return goal.with_vertices(points)
