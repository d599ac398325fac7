"""The hinges of glasses: front and temple cut apart behind the end piece, and joined by knuckles round an upright axis.

The cut is a finger joint: the front holds the upper and the lower finger, the temple the middle one, and every finger
carries a knuckle, a round barrel on the inner side of the temple, where the axis is.  Nothing of the temple lies nearer to
the head than the axis but the round knuckle, so that it folds inwards by a right angle; outwards it stops after the
play.  Either the axis is a pin that has grown between the outer knuckles and cannot come out, printed in place, or a
hole for a screw.
"""

from dataclasses import dataclass

import manifold3d
import numpy as np
from jaxtyping import Float64

from fabcraft.errors import InputError, SolidError
from fabcraft.mesh import Mesh
from fabcraft.template.melt import as_manifold
from fabcraft.template.template import HingeAxis
from fabcraft.template.temples import Temple

STYLES = ("rigid", "pin", "screw")
FLARE = 1.7
"""Height of a hinged temple at its root, over that of its section."""
PLAY_MM = 0.5
"""Between all that moves, where no printer says what it needs."""
SCREW_MM = 1.5
"""Hole that an M1.4 screw passes."""
FOLDS_DEG = 85.0
"""How far a temple folds inwards."""
LEAST_KNUCKLE_MM = 1.5
"""A lower knuckle breaks off."""
_PIN_MM, _WALL_MM = (2.4, 1.6), (1.4, 1.0)
"""(a person's, least) diameter of the pin, and wall of a knuckle round it."""
_THICKNESS_MM = 3.0
"""Of a person's temple, which those belong to."""
_ROOT_MM = 3.0
"""Of the temple that stays with the front before the joint, a person's."""
_SHARE = 0.9
"""Height of the barrel over that of the temple there."""
_CHAMFER_MM = 0.3
_SIDES = 24
"""Coarse enough that simplification leaves them as they are: it would take from the clearance."""
_OFF_MM = 0.05
"""What would lie in one plane with another face stands back by this: such cuts leave slivers."""


@dataclass(frozen=True, eq=False)
class Hinge:
    """The left hinge."""

    axis: Float64[np.ndarray, "3"]
    """Middle of the barrel, on the inner side of the temple, mm."""
    frame: Float64[np.ndarray, "3 3"]
    """Rows: away from the head, along the temple, up along the axis."""
    hole: float
    """Radius of the hole in the temple's knuckle; of the other two as well for a screw."""
    pin: float
    """Radius of the pin; 0 for a screw."""
    barrel: float
    """Radius of the knuckles."""
    knuckle: float
    """Height of each of the three."""
    thickness: float
    """Of the temple."""
    play: float
    """Between all that moves."""

    @property
    def wall_mm(self) -> float:
        """Of its thinnest part: round the hole, along the axis, or the pin."""
        walls = [self.barrel - self.hole, self.knuckle, *([2.0 * self.pin] if self.pin else [])]
        return min(walls)

    @property
    def genus(self) -> int:
        """What it adds: the temple's ring, and in the front one ring closed by the pin, or two for the screw."""
        return 2 if self.pin else 3

    @property
    def axes(self) -> tuple[HingeAxis, HingeAxis]:
        """Of both temples, the wearer's right one first."""
        left = HingeAxis(self.axis, self.frame[2], FOLDS_DEG)
        # the mirror image turns the other way
        right = HingeAxis(self.axis * [-1.0, 1.0, 1.0], self.frame[2] * [1.0, -1.0, -1.0], FOLDS_DEG)
        return right, left

    @property
    def half_height(self) -> float:
        """Of the barrel."""
        return 1.5 * self.knuckle + self.play


def hinge_of(side: Temple, start_mm: float, style: str, play_mm: float = PLAY_MM) -> Hinge:
    """The hinge of the left temple, whose joint begins behind `start_mm` of its line.

    style : "pin" or "screw".  play_mm : between all that moves.
    Raises `InputError` where the temple is too thin and low for three knuckles.
    """
    unit = side.thickness / _THICKNESS_MM
    pin, wall = (max(least, person * unit) for person, least in (_PIN_MM, _WALL_MM))
    hole = 0.5 * pin + play_mm if style == "pin" else 0.5 * SCREW_MM
    barrel = hole + wall
    ahead, up, off = side.frames()
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(side.line, axis=0), axis=1))])
    at = int(np.searchsorted(way, start_mm + _ROOT_MM * unit + barrel + play_mm))
    tall = 2.0 * _SHARE * float(side.half_height[at])
    knuckle = (tall - 2.0 * play_mm) / 3.0
    if knuckle < LEAST_KNUCKLE_MM:
        raise InputError(
            f"these temples are {side.thickness:.1f} mm thick and {tall / _SHARE:.1f} mm high at the hinge, too thin "
            f"for one: its knuckles would be {knuckle:.1f} mm high, not {LEAST_KNUCKLE_MM:g}",
            "Choose hinge=rigid, less play (--set hinge_play=...), or glasses for a larger head.",
        )
    axis = side.line[at] - 0.5 * side.thickness * off[at]
    frame = np.stack([off[at], ahead[at], up[at]])
    return Hinge(
        axis, frame, hole, 0.5 * pin if style == "pin" else 0.0, barrel, knuckle, side.thickness, play_mm
    )


def hinged(solid: Mesh, hinge: Hinge) -> Mesh:
    """A closed solid with its left temple hinged: two closed parts that nowhere touch, the front and the temple.

    Raises `SolidError` when the joint does not part them.
    """
    whole = as_manifold(solid, solid.name)
    reach, half, full = hinge.barrel + hinge.play, 0.5 * hinge.knuckle, hinge.half_height
    wide, tall = (-2.0 * reach, hinge.thickness + reach), (-2.0 * full, 2.0 * full)
    joint, middle, tongue = (-reach, reach), half + hinge.play + _OFF_MM, half - _OFF_MM
    inner = _box(hinge, (wide[0], -_OFF_MM), joint, tall)
    front = whole - inner - _box(hinge, wide, (hinge.barrel, reach), tall)
    front = front - _box(hinge, wide, joint, (-middle, middle))
    temple = whole - inner - _box(hinge, wide, (-reach, -hinge.barrel), tall)
    temple = (
        temple - _box(hinge, wide, joint, (tall[0], -tongue)) - _box(hinge, wide, joint, (tongue, tall[1]))
    )
    foremost = min(front.decompose(), key=lambda one: one.bounding_box()[1])
    rearmost = max(temple.decompose(), key=lambda one: one.bounding_box()[4])
    # its sides, not its edges, keep their distance to the pin
    hole = _rod(hinge, hinge.hole / np.cos(np.pi / _SIDES), *tall, chamfer=0.0)
    # from outside, knuckles are hidden within the temple
    seen = _box(hinge, (0.5 * hinge.thickness, wide[1]), joint, tall)
    outer = [_rod(hinge, hinge.barrel, low, low + hinge.knuckle) for low in (-full, full - hinge.knuckle)]
    foremost = foremost + (outer[0] + outer[1] - seen)
    rearmost = rearmost + (_rod(hinge, hinge.barrel, -half, half) - seen)
    rearmost = rearmost - hole
    if hinge.pin:
        # its ends lie within the outer knuckles
        foremost = foremost + _rod(hinge, hinge.pin, -half - hinge.knuckle, half + hinge.knuckle, chamfer=0.0)
    else:
        foremost = foremost - hole
    parts = [foremost, rearmost]
    if any(len(part.decompose()) != 1 for part in parts) or not (foremost ^ rearmost).is_empty():
        raise SolidError(
            f"the hinge does not part front and temple of the {solid.name}", "Choose hinge=rigid."
        )
    made = manifold3d.Manifold.compose(parts).to_mesh64()
    return Mesh(np.array(made.vert_properties[:, :3]), np.array(made.tri_verts, dtype=np.int32), solid.name)


Span = tuple[float, float]


def _box(hinge: Hinge, away: Span, along: Span, up: Span) -> manifold3d.Manifold:
    """What lies within those spans of the hinge's frame."""
    low, high = np.array([away, along, up]).T
    return _placed(hinge, manifold3d.Manifold.cube(tuple(high - low)).translate(tuple(low)))


def _rod(
    hinge: Hinge, radius: float, low: float, high: float, chamfer: float = _CHAMFER_MM
) -> manifold3d.Manifold:
    """A cylinder round the axis, its ends chamfered."""
    profile = [(0.0, low), (radius - chamfer, low), (radius, low + chamfer)]
    profile += [(radius, high - chamfer), (radius - chamfer, high), (0.0, high)]
    corners = [place for place, before in zip(profile, [None, *profile], strict=False) if place != before]
    return _placed(
        hinge, manifold3d.CrossSection([corners]).revolve(_SIDES).rotate((0.0, 0.0, 180.0 / _SIDES))
    )


def _placed(hinge: Hinge, solid: manifold3d.Manifold) -> manifold3d.Manifold:
    return solid.transform(np.column_stack([hinge.frame.T, hinge.axis]))
