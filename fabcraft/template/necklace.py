"""The necklace: a rigid tube round the base of the neck with a pendant in front; a collar open at the nape, or closed.

It lies in a plane that rises from the collar bones to the nape, 4 mm off the skin, and is let down until it rests.  A collar
is drawn off to the front: its gap is about 3/4 of the neck's breadth, and its ends spring open.  A closed one is wide enough
for the head.  Sizes are inner lengths: collar 305-330 mm, choker 355-405, princess 430-480, matinee 510-610.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float64

from fabcraft.body.body import Body
from fabcraft.body.tape import girth
from fabcraft.errors import InputError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.oval import Oval
from fabcraft.mesh import Mesh
from fabcraft.template.band import closed_band, open_band
from fabcraft.template.catalogue import Kind, Settings
from fabcraft.template.neck import ROUND_MM, Neck, head_slices, tube_profile
from fabcraft.template.necklace_off import easiest, over_the_head, to_the_front
from fabcraft.template.pendant import Hanger, with_pendant
from fabcraft.template.rolled import Rolled
from fabcraft.template.template import Parameter, Template

EDGE_MM, TUBE_MM, LEAST_TUBE_MM, DROP_MM = 2.2, 6.0, 2.4, 30.0
RESTING_MM = 0.5
"""Clearance where it rests."""
SIZES: Mapping[str, float] = {"collar": 318.0, "choker": 380.0, "princess": 455.0, "matinee": 560.0}
"""Inner length of the usual sizes, mm: the middle of each range."""
NECK_MM = 400.0
"""Girth of a median man's neck, which the listed lengths belong to."""
_BASE = 1.32
"""Girth of the base of the neck over that of the neck: a flatter plane would cut into the shoulders."""
_TILTS_DEG = (20.0, 25.0, 30.0, 35.0, 40.0, 45.0)
_RESTS = ("collarbone_left", "collarbone_right", "nape_low")
"""Where it rests; an open one leaves the nape free."""
_ABOVE_NOTCH_MM, _RISE_MM, _RISES = 5.0, 4.0, 14
_OVER_HEAD_MM = 15.0
_NAPE_MM = 25.0
"""What hangs hangs from the nape, this far above the lowest vertebra of the neck."""
_LARGEST = 2.0
"""Length of a closed necklace over that of one that follows the neck."""
_CLOSEST, _LIFTS, _RESERVE_MM = 400, 12, 0.02
_PLACES = ("cervicale", "jugular_notch", "neck_root", "head", "vertex", "menton")


def build(body: Body, settings: Settings) -> Template:
    """The necklace for `body`.  Raises `InputError` for a body without a neck, and for a size that does not go on."""
    chosen = KIND.settled(settings)
    neck, open_ = _neck(body, chosen), chosen.get("style", "open") == "open"
    surface = SurfaceDistance(neck.part.mesh)
    rolled, play = _laid(neck, chosen.get("size"), surface, 0.0 if open_ else _OVER_HEAD_MM)
    edge = EDGE_MM * float(np.clip(neck.scale, 0.35, 1.0))
    if open_:
        way = to_the_front(neck, rolled, chosen.get("gap"))
        gap, size = way.gap, (neck.tall, neck.tube)
        tube, _ = open_band(rolled, size, gap, 0.5 * neck.tube, 0.0, edge, KIND.name)
        path = easiest(way, tube, surface)
    else:
        gap, path = 0.0, over_the_head(neck, rolled)
        tube, _ = closed_band(rolled, tube_profile(neck), edge, KIND.name)
    drop = float(chosen.get("drop", DROP_MM * neck.scale))
    thick = max(0.75 * neck.tube, LEAST_TUBE_MM)
    hanger = Hanger(neck.part, rolled, tube, neck.tube, neck.tall, thick, neck.scale)
    mesh, frames = with_pendant(hanger, drop, edge, KIND.name)
    return Template(
        name=KIND.name,
        body=neck.part,
        mesh=mesh,
        rims=(),
        surface=None,
        wall_mm=neck.tube if drop == 0.0 else min(neck.tube, thick),
        genus=0 if open_ else 1,
        contacts=tuple(name for name in _RESTS[: 2 if open_ else 3] if name in neck.part.regions),
        edge_mm=edge,
        donning=(0.0, -1.0, 0.0) if open_ else (0.0, 0.0, 1.0),
        path=path,
        locked=_inner(mesh, rolled, neck),
        holds=not open_,
        mirrored=True,
        motifs=frames,
        listed_mm=(neck.part.clearance_mm(RESTING_MM), play),
        parameters={"tube": neck.tube, "drop": drop, "size": rolled.oval.length, "gap": gap},
        notes=(
            f"The necklace is {rolled.oval.length:.0f} mm long inside; the neck measures {neck.girth_mm:.0f} mm.",
        ),
    )


def length_mm(size: str | float) -> float:
    """Inner length of a necklace: a number is the length itself; "choker", "princess", ...

    Raises `InputError` for another name.
    """
    if isinstance(size, int | float):
        return float(size)
    if size.strip().lower() not in SIZES:
        raise InputError(
            f"there is no necklace size '{size}'", f"Write {', '.join(SIZES)}, or the length in mm."
        )
    return SIZES[size.strip().lower()]


def _neck(body: Body, chosen: Mapping[str, float | str]) -> Neck:
    part, at = KIND.worn(body, "bust", _PLACES)
    root, along = at["neck_root"], at["head"] - at["neck_root"]
    around = min(girth(part.mesh, root + t * along, along).length_mm for t in np.arange(-0.3, 1.01, 0.1))
    scale = around / NECK_MM
    natural = max(LEAST_TUBE_MM, TUBE_MM * scale) if part.kind == "character" else TUBE_MM
    return Neck(part, at, scale, around, float(chosen.get("tube", natural)))


def _laid(
    neck: Neck, size: float | str | None, surface: SurfaceDistance, over_head_mm: float
) -> tuple[Rolled, float]:
    """The inner side of the tube where it lies, at w = 0, and how far it is from the neck on the whole.

    over_head_mm : how much longer than the head it has to be; 0 for a collar that opens.
    """
    up, off = _ABOVE_NOTCH_MM * neck.scale, neck.part.clearance_mm(ROUND_MM)
    for tilt in _TILTS_DEG:
        skin = neck.skin(up, tilt)
        if skin.oval.length <= _BASE * neck.girth_mm:
            break
    oval = skin.oval.grown(off)
    if over_head_mm > 0.0:
        room, windows = over_head_mm * neck.scale / (2.0 * np.pi), head_slices(neck, neck.tall)
        held = Oval.holding([one.oval.grown(room).moved(-one.oval.middle) for one in windows])
        if held.length > _LARGEST * oval.length:
            raise InputError(
                f"over this head a closed necklace is {held.length:.0f} mm long, the neck only {neck.girth_mm:.0f} mm round",
                "Choose style=open.",
            )
        oval = held.moved(_forward(held, oval))
    asked = oval.length if size is None else length_mm(size)
    if asked < oval.length - 0.5:
        if over_head_mm > 0.0:
            raise InputError(
                f"a closed necklace of {asked:.0f} mm does not go over the head, which asks for {oval.length:.0f} mm",
                f"Choose {np.ceil(oval.length):.0f} mm or more, or style=open.",
            )
        skin, oval = _higher(neck, up, tilt, off, asked)
    larger = oval.grown((asked - oval.length) / (2.0 * np.pi))
    hangs = over_head_mm > 0.0 or larger.length > oval.length + 10.0 * neck.scale
    play = (larger.length - skin.oval.length) / (2.0 * np.pi)
    return _rested(neck, replace(skin, oval=larger.moved(_forward(larger, oval))), surface, hangs), play


def _forward(larger: Oval, smaller: Oval) -> Float64[np.ndarray, "2"]:
    """The move that brings the back of the larger to that of the smaller: what is too long hangs in front."""
    back = 3 * len(larger.support) // 4
    return np.array([0.0, larger.support[back] - smaller.support[back]])


def _higher(neck: Neck, up: float, tilt: float, off: float, asked: float) -> tuple[Rolled, Oval]:
    """A place higher on the neck, where a necklace of the length that was asked lies round it."""
    shortest = np.inf
    for rise in range(1, _RISES + 1):
        skin = neck.skin(up + rise * _RISE_MM * neck.scale, tilt)
        oval = skin.oval.grown(off)
        if oval.length <= asked:
            return skin, oval
        shortest = min(shortest, oval.length)
    raise InputError(
        f"a necklace of {asked:.0f} mm does not go round this neck of {neck.girth_mm:.0f} mm",
        f"Choose {np.ceil(shortest):.0f} mm or more.",
    )


def _rested(neck: Neck, rolled: Rolled, surface: SurfaceDistance, hangs: bool) -> Rolled:
    """Let down until it just rests: on the collar bones, or on the shoulders.

    hangs : it is longer than the neck asks for, so that it is tilted about the nape until its front lies on the chest.
    """
    wanted = neck.part.clearance_mm(RESTING_MM)
    flat = _spread(neck, rolled, 60, 8)
    back = rolled.world(np.array([[0.5 * rolled.oval.length, 0.0, 0.0]]))[0]

    def placed(tilt_deg: float, down: float) -> Rolled:
        axes = neck.axes(tilt_deg)
        local = (back - rolled.origin) @ rolled.axes.T
        return Rolled(back - local @ axes - down * axes[2], axes, rolled.oval)

    def room(tilt_deg: float, down: float, places: Float64[np.ndarray, "N 3"] = flat) -> float:
        return float(surface.signed(placed(tilt_deg, down).world(places)).min()) - wanted

    step = 0.1 * float(neck.at["vertex"][2] - neck.at["menton"][2])
    start = float(np.degrees(np.arctan2(-rolled.axes[1, 2], -rolled.axes[1, 1])))
    nape = neck.at["cervicale"][2] + _NAPE_MM * neck.scale
    if hangs:  # the steepest it can hang from somewhere on the nape
        raised = min(0.0, float(back[2] - nape)) - 0.25 * step * np.arange(7)
        tilts = np.arange(75.0, -1.0, -5.0)
        steepest = (next((one for one in tilts if room(one, down) > 0.0), -np.inf) for down in raised)
        tilt, low = max(zip(steepest, raised, strict=True))
        if not np.isfinite(tilt):
            raise InputError(
                f"a necklace of {rolled.oval.length:.0f} mm finds no way to hang round this neck",
                "Choose style=open, or another length.",
            )
    else:
        tilt, low = (
            start,
            next((down for down in -0.25 * step * np.arange(17) if room(start, down) > 0.0), 0.0),
        )
    high = low + step
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if room(tilt, middle) > 0.0 else (low, middle)
    # then lifted off what stands out of the skin between the places that were looked at
    fine = _spread(neck, rolled, round(rolled.oval.length / (0.4 * neck.tube)), 16)
    close = fine[np.argsort(surface.signed(placed(tilt, low).world(fine)))[:_CLOSEST]]
    for _ in range(_LIFTS):
        missing = _RESERVE_MM - room(tilt, low, close)
        if missing <= 0.0:
            break
        low -= missing
    return placed(tilt, low)


def _spread(neck: Neck, rolled: Rolled, around: int, on_section: int) -> Float64[np.ndarray, "N 3"]:
    """Places (u, v, w) spread over the tube."""
    u = np.linspace(-0.5, 0.5, around, endpoint=False) * rolled.oval.length
    section = tube_profile(neck).points(u[:1], on_section)[0]
    return np.column_stack([np.repeat(u, len(section)), np.tile(section, (len(u), 1))])


def _inner(mesh: Mesh, rolled: Rolled, neck: Neck) -> Bool[np.ndarray, " F"]:
    """Faces of the tube that look at the neck."""
    u, v, w = rolled.flat(mesh.corners.mean(1)).T
    beside = (np.abs(u) < 2.0 * neck.tall) & (v < -0.4 * neck.tall)  # the pendant's root
    return (w < 0.5 * neck.tube) & (np.abs(v) < 0.55 * neck.tall) & ~beside


KIND = Kind(
    "necklace",
    build,
    (
        Parameter(
            "style", "", 0.0, 0.0, "a collar with a gap at the nape, or over the head", ("open", "closed")
        ),
        Parameter("tube", "mm", 2.4, 14.0, "thickness of the tube"),
        Parameter("drop", "mm", 0.0, 80.0, "length of the pendant; 0 for none"),
        Parameter("size", "mm", 40.0, 900.0, 'inner length, or "choker", "princess"'),
        Parameter("gap", "mm", 5.0, 300.0, "between the ends of a collar"),
    ),
    "Print it flat; an open one wants a material that springs (PA12, PETG).",
)
