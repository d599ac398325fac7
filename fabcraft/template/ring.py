"""The ring: a band around the proximal phalanx of the ring finger, a little higher at the bezel.

It follows the finger's section and taper, and is as wide inside as seat and knuckle ask.  Ease on the girth is 0.6 mm for
bands up to 4 mm and 1.3 mm from 6 mm on, as wide bands sit tighter.  Sizes are inner girths: ISO 8653 in mm, US n has
36.5 + 2.55 n mm, Swiss, Italian and Spanish sizes are 40 less than the girth.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float64

from fabcraft.body.body import Body
from fabcraft.body.sizes import asked
from fabcraft.errors import InputError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.oval import Oval
from fabcraft.geometry.passage import passage
from fabcraft.mesh import Mesh
from fabcraft.template.band import Profile, closed_band
from fabcraft.template.catalogue import Kind, Settings
from fabcraft.template.limb import (
    Axes,
    Station,
    along,
    centred,
    facing,
    loft,
    middles,
    poses,
    station,
    straight,
)
from fabcraft.template.rolled import Rolled
from fabcraft.template.template import DonningPath, MotifFrame, Parameter, Template
from fabcraft.template.whole import profile

EDGE_MM, WALL_MM, LEAST_WALL_MM, WIDTH_MM = 0.6, 1.8, 1.6, 6.0
FINGER_MM = 63.5
"""Girth of a median man's ring finger, which the widths of bands are made for."""
_SEATS = (0.6, 0.7, 0.8)
"""Where the ring sits, as a share of the phalanx: on the slender part, clear of the web; nearer to the knuckle where the
fingers beside it leave no room, as short ones do."""
_BESIDE_MM = 0.05
"""How much nearer than listed a ring may come to the fingers beside it before it is seated elsewhere."""
_STEEPEST = 0.1
"""Most that the finger's taper is followed."""
_SKIN_GIVES_MM = 0.3
_PRESS, _ENLARGED = 0.65, 4
"""Share of what skin gives that a ring may take over the knuckle: the rest is for what a motif and printing add."""
_SECTIONS, _POSES = 7, 40
_PLACES = ("finger4_1", "finger4_2", "finger4_3", "ring_finger_tip", "wrist_back", "wrist_palm")


def build(body: Body, settings: Settings) -> Template:
    """The ring for `body`.  Raises `InputError` for a body without fingers and for a size that does not go on."""
    chosen = KIND.settled(settings)
    hand = str(chosen.get("hand", "left"))
    part, at = KIND.worn(body, f"hand_{hand}", [f"{place}_{hand}" for place in _PLACES])
    places = [at[f"{place}_{hand}"] for place in _PLACES]
    skin = SurfaceDistance(part.mesh)
    for seat in _SEATS:
        ring = _seated(part, places, seat, chosen)
        if skin.signed(ring.mesh.vertices).min() >= ring.listed_mm[0] - _BESIDE_MM:
            break
    return ring


def _seated(
    part: Body, places: Sequence[Float64[np.ndarray, "3"]], seat: float, chosen: Settings
) -> Template:
    """The ring at the share `seat` of the phalanx; `places` as in _PLACES, `chosen` as settled."""
    hand = str(chosen.get("hand", "left"))
    base, joint, last, tip, back, palm = places
    reach = 0.1 * float(np.linalg.norm(joint - base))
    origin, axes = centred(part.mesh, base + seat * (joint - base), facing(joint - base, back - palm), reach)
    seat_mm = station(part.mesh, origin, axes).oval.length
    scale = seat_mm / FINGER_MM
    width = float(chosen.get("width", WIDTH_MM * scale))
    natural = max(LEAST_WALL_MM, 0.02 * seat_mm) if part.kind == "character" else WALL_MM
    wall = float(chosen.get("thickness", natural))
    bezel = float(chosen.get("bezel", min(1.0, scale)))
    gap = part.clearance_mm(float(np.interp(width, [4.0, 6.0], [0.1, 0.2])))
    gives = 0.0 if part.kind == "character" else _SKIN_GIVES_MM

    over, knuckle_mm = _over_the_finger(part, origin, axes, [joint, last, tip], width, chosen.get("knuckle"))
    half = 0.5 * width - min(1.0, 0.5 * wall)
    oval, taper = _inside(part, origin, axes, over, half, gap, 0.5 * gives)
    oval = oval.grown(max(0.0, (knuckle_mm - oval.length) / (2.0 * np.pi) + gap))
    edge = EDGE_MM * float(np.clip(scale, 0.4, 1.0))

    def band(oval: Oval) -> tuple[Mesh, Bool[np.ndarray, " F"]]:
        section = _profile(oval.length, width, wall, bezel, taper)
        return closed_band(Rolled(origin, axes, oval), section, edge, KIND.name)

    rolled = Rolled(origin, axes, oval)
    through = loft(over, "finger with the knuckle that was taped") if "knuckle" in chosen else None
    path = DonningPath(poses(over, rolled.middle), gives, "the skin of the finger gives", through)
    oval, note = _of_size(_passing(oval, band, path, part.mesh), chosen.get("size"))
    rolled = Rolled(origin, axes, oval)
    mesh, locked = band(oval)
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
        path=path,
        locked=locked,
        motifs=(_bezel(rolled, width, wall + bezel, scale), _whole(mesh, rolled, wall, scale)),
        listed_mm=(gap, max(gap + 0.2, (oval.length - seat_mm) / (2.0 * np.pi))),
        parameters={
            "width": width,
            "thickness": wall,
            "bezel": bezel,
            "size": oval.length,
            "knuckle": knuckle_mm,
        },
        notes=(note,),
    )


def _over_the_finger(
    part: Body,
    origin: Float64[np.ndarray, "3"],
    axes: Axes,
    joints: Sequence[Float64[np.ndarray, "3"]],
    width: float,
    taped: float | str | None,
) -> tuple[tuple[Station, ...], float]:
    """Sections of the finger from the seat over the knuckle and past the tip, the last of `joints`, and the knuckle's girth.

    taped : girth of the knuckle; the sections near it are enlarged to it.
    """
    *before, tip = joints
    end = tip + (width + 2.0) * (tip - before[-1]) / np.linalg.norm(tip - before[-1])
    line = middles(part.mesh, straight([origin, *before, end], _POSES), axes)
    found = along(part.mesh, line, axes)
    knuckle = int(np.argmin([np.linalg.norm(one.middle - joints[0]) for one in found]))
    girth = found[knuckle].oval.length
    if taped is None:
        return found, girth
    away = np.array([np.linalg.norm(one.middle - found[knuckle].middle) for one in found])
    more = max(0.0, float(taped) / girth - 1.0) * np.exp(-((away / (0.08 * girth)) ** 2))
    larger = [
        Station(one.origin, one.axes, one.oval.scaled(1.0 + m)) for one, m in zip(found, more, strict=True)
    ]
    return tuple(larger), max(girth, float(taped))


def _inside(
    part: Body,
    origin: Float64[np.ndarray, "3"],
    axes: Axes,
    over: Sequence[Station],
    half: float,
    gap: float,
    gives: float,
) -> tuple[Oval, float]:
    """The inner side at its middle, and how fast it becomes narrower towards the tip.

    The finger under the band, `half` wide either way, is a cone; what has to pass on the way is kept a hair wider.
    """
    places = np.linspace(-half, half, _SECTIONS)
    ovals = [station(part.mesh, origin + at * axes[2], axes).oval for at in places]
    slope = float(np.polyfit(places, [oval.length for oval in ovals], 1)[0]) / (2.0 * np.pi)
    steepest = float(np.clip(-slope, 0.0, _STEEPEST))
    way = Oval.holding([one.oval.moved(-one.oval.middle) for one in over[1:]]).grown(-gives)
    for taper in (steepest, 0.5 * steepest, 0.0):
        seat = Oval.holding([oval.grown(taper * at) for oval, at in zip(ovals, places, strict=True)]).grown(
            gap
        )
        needed = way.grown(taper * half).moved(seat.middle)
        if (seat.support >= needed.support).all():
            return seat, taper
    return Oval.holding([seat, needed]), 0.0


def _passing(
    oval: Oval, band: Callable[[Oval], tuple[Mesh, Bool[np.ndarray, " F"]]], path: DonningPath, finger: Mesh
) -> Oval:
    """The inner side, enlarged until the band presses no more than a share of what it may on its way over the knuckle."""
    surface = SurfaceDistance(path.through or finger)
    for _ in range(_ENLARGED):
        mesh, inner = band(oval)
        inside = mesh.vertices[np.unique(mesh.faces[inner])[::2]]
        short = float(passage(inside, path.poses, surface).depth_mm.max()) - _PRESS * path.allowed_mm
        if short <= 0.0:
            break
        oval = oval.grown(short)
    return oval


def _of_size(needed: Oval, size: float | str | None) -> tuple[Oval, str]:
    """The inner side at the size that was asked, and a note of what size it is."""
    girth = needed.length if size is None else KIND.within("size", asked({"ring_finger": size})[0].mm)
    if girth < needed.length - 0.05:
        raise InputError(
            f"a ring of {girth:.1f} mm inner girth does not go on this finger, which asks for {needed.length:.1f} mm",
            f"Choose ISO {np.ceil(needed.length):.0f} or US {np.ceil((needed.length - 36.5) / 2.55 * 4) / 4:g}.",
        )
    note = f"The ring's inner girth is {girth:.1f} mm: ISO {girth:.1f}, US {(girth - 36.5) / 2.55:.1f}."
    return needed.grown((girth - needed.length) / (2.0 * np.pi)), note


def _profile(around: float, width: float, wall: float, bezel: float, taper: float) -> Profile:
    """Full width and height at the bezel, narrower towards the palm; rounded inside for comfort."""

    def half_width(u: Float64[np.ndarray, " N"]) -> Float64[np.ndarray, " N"]:
        return 0.5 * width * (0.86 + 0.14 * np.cos(2.0 * np.pi * u / around))

    def outer(u: Float64[np.ndarray, " N"]) -> Float64[np.ndarray, " N"]:
        return wall + bezel * np.exp(-((u / (0.12 * around)) ** 2))

    return Profile(half_width, np.zeros_like, outer, (1.0, 0.45 * wall), taper=taper)


def _bezel(rolled: Rolled, width: float, height: float, scale: float) -> MotifFrame:
    """On the back of the finger, upright for the wearer who looks at the hand."""
    left, _, ahead = rolled.axes
    top = rolled.world(np.array([[0.0, 0.0, height]]))[0]
    return MotifFrame("bezel", top, -left, ahead, (11.0 * scale, max(width, 8.0 * scale)), 4.0 * scale)


def _whole(mesh: Mesh, rolled: Rolled, wall: float, scale: float) -> MotifFrame:
    """The ring seen from the tip of the finger, the back of the hand up."""
    return profile(mesh, rolled.middle, rolled.axes[2], rolled.axes[1], wall, 6.0 * scale)


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
