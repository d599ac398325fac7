"""The ring: a band around the proximal phalanx of the ring finger, a little higher at the bezel.

It follows the finger's section and taper, and is as wide inside as seat and knuckle ask.  Ease on the girth is 0.6 mm for
bands up to 4 mm and 1.3 mm from 6 mm on, as wide bands sit tighter.  Sizes: ISO 8653 is the inner girth in mm; US n has
36.5 + 2.55 n mm; Swiss, Italian and Spanish sizes are 40 less than the girth.
"""

import re
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from fabcraft.body.body import Body
from fabcraft.body.tape import girth
from fabcraft.errors import InputError
from fabcraft.geometry.oval import Oval
from fabcraft.template.band import Profile, closed_band
from fabcraft.template.catalogue import Kind, Settings
from fabcraft.template.limb import Axes, along, centred, facing, middles, poses, station, straight
from fabcraft.template.rolled import Rolled
from fabcraft.template.template import DonningPath, MotifFrame, Parameter, Template

EDGE_MM, WALL_MM, LEAST_WALL_MM = 0.6, 1.8, 1.6
FINGER_MM = 63.5
"""Girth of a median man's ring finger, which the widths of bands are made for."""
_SEAT = 0.6
"""Where the ring sits, as a share of the phalanx: on the slender part, clear of the web."""
_SECTIONS, _POSES = 7, 40
_SKIN_GIVES_MM = 0.3
_STEEPEST = 0.1
"""Most that the finger's taper is followed."""
_PLACES = ("finger4_1", "finger4_2", "finger4_3", "ring_finger_tip", "wrist_back", "wrist_palm")


def build(body: Body, settings: Settings) -> Template:
    """The ring for `body`.  Raises `InputError` for a body without fingers and for a size that does not go on."""
    chosen = KIND.settled(settings)
    hand = str(chosen.get("hand", "left"))
    part, at = KIND.worn(body, f"hand_{hand}", [f"{place}_{hand}" for place in _PLACES])
    base, joint, last, tip, back, palm = (at[f"{place}_{hand}"] for place in _PLACES)
    reach = 0.1 * float(np.linalg.norm(joint - base))
    origin, axes = centred(part.mesh, base + _SEAT * (joint - base), facing(joint - base, back - palm), reach)
    seat_mm = station(part.mesh, origin, axes).oval.length
    knuckle_mm = float(chosen.get("knuckle", _knuckle_mm(part, base, joint, last)))
    scale = seat_mm / FINGER_MM
    width = float(chosen.get("width", 6.0 * scale))
    wall = float(
        chosen.get("thickness", max(LEAST_WALL_MM, 0.02 * seat_mm) if body.kind == "character" else WALL_MM)
    )
    bezel = float(chosen.get("bezel", min(1.0, scale)))
    gap = part.clearance_mm(float(np.interp(width, [4.0, 6.0], [0.1, 0.2])))

    half = 0.5 * width - min(1.0, 0.5 * wall)
    oval, taper = _finger(part, origin, axes, half)
    ease = 2.0 * np.pi * gap
    taper = min(taper, max(0.0, (oval.length - knuckle_mm) / (2.0 * np.pi * half)))
    inside = _inner_girth(chosen.get("size"), max(oval.length, knuckle_mm) + ease, oval.length < knuckle_mm)
    rolled = Rolled(origin, axes, oval.grown((inside - oval.length) / (2.0 * np.pi)))
    profile = _profile(rolled.oval.length, width, wall, bezel, taper)
    edge = EDGE_MM * float(np.clip(scale, 0.4, 1.0))
    mesh, locked = closed_band(rolled, profile, edge, "ring")
    return Template(
        name=KIND.name,
        body=part,
        mesh=mesh,
        rims=(),
        surface=None,
        wall_mm=wall,
        genus=1,
        contacts=(f"ring_finger_{hand}",),
        edge_mm=edge,
        donning=tuple(axes[2].tolist()),
        path=_off(part, rolled, [joint, last, tip], width),
        locked=locked,
        motifs=(_bezel(rolled, width, wall + bezel, scale),),
        listed_mm=(gap, gap + 0.1),
        parameters={"width": width, "thickness": wall, "bezel": bezel, "size": inside, "knuckle": knuckle_mm},
        notes=(
            f"The ring's inner girth is {inside:.1f} mm: ISO {inside:.0f}, US {(inside - 36.5) / 2.55:.2g}.",
        ),
    )


def circumference_mm(size: str | float) -> float:
    """Inner girth of a ring size: a number is the girth itself, "ISO 54", "US 7", "CH 14", "IT 14", "ES 14".

    Raises `InputError` for another name.
    """
    if isinstance(size, int | float):
        return float(size)
    match = re.fullmatch(r"(ISO|EU|US|CH|IT|ES) ?(\d{1,2}(?:\.\d{1,2})?)", size.strip(), re.IGNORECASE)
    if match is None:
        raise InputError(
            f"there is no ring size '{size}'", 'Write "US 7", "ISO 54", "CH 14", or the inner girth in mm.'
        )
    system, number = match[1].upper(), float(match[2])
    return 36.5 + 2.55 * number if system == "US" else number if system in ("ISO", "EU") else number + 40.0


def _inner_girth(size: str | float | None, needed_mm: float, for_knuckle: bool) -> float:
    """The girth that was asked, or the one that is needed where none was."""
    if size is None:
        return needed_mm
    asked = circumference_mm(size)
    if asked < needed_mm - 0.05:
        raise InputError(
            f"a ring of {asked:.1f} mm inner girth does not go {'over the knuckle' if for_knuckle else 'on the finger'}, "
            f"which asks for {needed_mm:.1f} mm with its ease",
            f"Choose ISO {np.ceil(needed_mm):.0f} or US {np.ceil((needed_mm - 36.5) / 2.55 * 4) / 4:g}.",
        )
    return asked


def _knuckle_mm(
    part: Body,
    base: Float64[np.ndarray, "3"],
    joint: Float64[np.ndarray, "3"],
    last: Float64[np.ndarray, "3"],
) -> float:
    """Girth of the finger at the joint after the seat."""
    before, after = joint - base, last - joint
    return girth(part.mesh, joint, before / np.linalg.norm(before) + after / np.linalg.norm(after)).length_mm


def _finger(part: Body, origin: Float64[np.ndarray, "3"], axes: Axes, half: float) -> tuple[Oval, float]:
    """The finger under the band as a cone: its section at the middle, and how fast it becomes thinner along it."""
    places = np.linspace(-half, half, _SECTIONS)
    ovals = [station(part.mesh, origin + at * axes[2], axes).oval for at in places]
    taper = -float(np.polyfit(places, [oval.length for oval in ovals], 1)[0]) / (2.0 * np.pi)
    taper = float(np.clip(taper, 0.0, _STEEPEST))
    return Oval.holding([oval.grown(taper * at) for oval, at in zip(ovals, places, strict=True)]), taper


def _profile(around: float, width: float, wall: float, bezel: float, taper: float) -> Profile:
    """Full width and height at the bezel, narrower towards the palm; rounded inside for comfort."""

    def half_width(u: Float64[np.ndarray, " N"]) -> Float64[np.ndarray, " N"]:
        return 0.5 * width * (0.86 + 0.14 * np.cos(2.0 * np.pi * u / around))

    def outer(u: Float64[np.ndarray, " N"]) -> Float64[np.ndarray, " N"]:
        return wall + bezel * np.exp(-((u / (0.12 * around)) ** 2))

    return Profile(half_width, np.zeros_like, outer, (1.0, 0.45 * wall), taper=taper)


def _bezel(rolled: Rolled, width: float, height: float, scale: float) -> MotifFrame:
    left, _out, along = rolled.axes
    top = rolled.world(np.array([[0.0, 0.0, height]]))[0]
    return MotifFrame("bezel", top, -left, along, (11.0 * scale, max(width, 8.0 * scale)), 4.0 * scale)


def _off(part: Body, rolled: Rolled, joints: Sequence[Float64[np.ndarray, "3"]], width: float) -> DonningPath:
    """Along the finger, over the knuckle and past the tip, the last of `joints`."""
    *before, tip = joints
    end = tip + (width + 2.0) * (tip - before[-1]) / np.linalg.norm(tip - before[-1])
    line = middles(part.mesh, straight([rolled.origin, *before, end], _POSES), rolled.axes)
    gives = 0.0 if part.kind == "character" else _SKIN_GIVES_MM
    return DonningPath(
        poses(along(part.mesh, line, rolled.axes), rolled.middle), gives, "the skin of the finger gives"
    )


KIND = Kind(
    "ring",
    build,
    (
        Parameter("hand", "", 0.0, 0.0, "which hand wears it", ("left", "right")),
        Parameter("width", "mm", 2.0, 12.0, "of the band at the bezel"),
        Parameter("thickness", "mm", 1.2, 4.0, "of the band"),
        Parameter("bezel", "mm", 0.0, 3.0, "how much higher the middle of the back is"),
        Parameter("size", "mm", 12.0, 90.0, 'inner girth, or a size such as "US 7" or "ISO 54"'),
        Parameter("knuckle", "mm", 10.0, 90.0, "girth of the knuckle where it was taped"),
    ),
    "Resin from 1.2 mm on, filament from 1.6 mm on; lay it on its side so that no support touches the inside.",
)
