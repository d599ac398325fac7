"""Strap slots: where a band is tied to a mask, found on the finished outline, cut when the wall is made.

A slot is a stadium 3 x 12 mm in the front view, 4.5 mm of material outside it, parallel to the rim, as far to the side as
the outline reaches near the height of the eyes (a band above the ears then pulls straight back).  On a character the
slot is as small as its head, but not under half that size: a thread has to go through.

A solid knows where its own slots are (`Template.straps`); they are cut out of what has become of it.
"""

from dataclasses import dataclass

import manifold3d
import numpy as np
from jaxtyping import Float64

from fabcraft.errors import SolidError
from fabcraft.guidance.inflate import Relief
from fabcraft.mesh import Mesh
from fabcraft.solid.manifolds import to_manifold, to_mesh
from fabcraft.template.template import StrapHole, Template

LENGTH_MM, WIDTH_MM, RIM_MM = 12.0, 3.0, 4.5
HEIGHT_RANGE_MM = (-20.0, 30.0)
"""How far below and above the eyes a slot may sit."""
_LEAST_SCALE = 0.5
_TIDY_MM = 0.002
"""Edges that a cut leaves shorter than this are collapsed."""


@dataclass(frozen=True, eq=False)
class StrapSlot:
    """A slot through the wall, seen from the front; (x, z) in mm."""

    centre: Float64[np.ndarray, "2"]
    direction: Float64[np.ndarray, "2"]
    """Unit vector along the slot."""
    scale: float = 1.0
    """Its size over a person's."""

    def distance(self, xz: Float64[np.ndarray, "N 2"]) -> Float64[np.ndarray, " N"]:
        """Signed distance to the stadium, mm, negative inside."""
        away = xz - self.centre
        half = 0.5 * self.scale * (LENGTH_MM - WIDTH_MM)
        along = np.clip(away @ self.direction, -half, half)
        return np.linalg.norm(away - along[:, None] * self.direction, axis=1) - 0.5 * self.scale * WIDTH_MM


def strap_slots(template: Template, relief: Relief) -> tuple[StrapSlot, ...]:
    """One slot on each side, the wearer's right first; empty where either side has no room for one."""
    landmarks = template.body.landmarks
    middle = 0.5 * (landmarks["eye_left"] + landmarks["eye_right"])[[0, 2]]
    found = [_slot(relief, middle, side, template.scale) for side in (-1.0, 1.0)]
    return tuple(slot for slot in found if slot is not None) if all(found) else ()


def with_straps(solid: Mesh, straps: tuple[StrapHole, ...]) -> Mesh:
    """The closed solid with its slots cut through.  Raises `SolidError` when one misses it, or cuts it in two."""
    cut = to_manifold(solid)
    for strap in straps:
        half, radius = 0.5 * (strap.length_mm - strap.width_mm), 0.5 * strap.width_mm
        rounds = [
            manifold3d.Manifold.cylinder(strap.depth_mm, radius, radius, 32, center=True).translate(
                (end, 0.0, 0.0)
            )
            for end in (-half, half)
        ]
        across = np.cross(strap.through, strap.along)
        place = np.column_stack([strap.along, across, strap.through, strap.centre])
        before = cut
        cut = cut - manifold3d.Manifold.batch_hull(rounds).transform(place)
        if cut.genus() != before.genus() + 1:
            raise SolidError(
                "a strap slot does not go through the wall as one hole",
                "Choose another band (--set band=...), or a closed one (--set open=0).",
            )
    return to_mesh(cut.simplify(_TIDY_MM))


def _slot(relief: Relief, middle: np.ndarray, side: float, scale: float) -> StrapSlot | None:
    """The outermost place on one side where a slot has its rim of material all round."""
    low, high = HEIGHT_RANGE_MM
    outline = relief.outline
    reach = float(np.abs(outline[:, 0] - middle[0]).max()) / scale
    x, z = np.meshgrid(np.arange(20.0, reach, 1.0), np.arange(low, high, 1.0))
    places = np.column_stack([middle[0] + side * scale * x.ravel(), middle[1] + scale * z.ravel()])
    size = max(scale, _LEAST_SCALE)
    need = size * (RIM_MM + 0.5 * WIDTH_MM)
    places = places[np.abs(relief.room_at(places) - need) < 0.75 * scale]
    best, score = None, -np.inf
    for place in places:
        slope = _gradient(relief, place, scale)
        length = np.linalg.norm(slope)
        if length < 0.5 or slope[0] * side > -0.2 * length:  # the rim beside it has to be the outer one
            continue
        direction = np.array([-slope[1], slope[0]]) / length
        ends = place + np.outer([-0.5, 0.0, 0.5], direction) * size * (LENGTH_MM - WIDTH_MM)
        if relief.room_at(ends).min() < need - scale:
            continue
        # outermost, but rather near the eyes' height than far above or below it
        value = side * (place[0] - middle[0]) - 0.25 * abs(place[1] - middle[1] - 5.0 * scale)
        if value > score:
            best, score = StrapSlot(place, direction, size), value
    return best


def _gradient(relief: Relief, place: np.ndarray, step: float) -> np.ndarray:
    points = place + step * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    room = relief.room_at(points)
    return np.array([room[0] - room[1], room[2] - room[3]]) / (2.0 * step)
