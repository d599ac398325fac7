"""The necklace: a rigid tube round the base of the neck with a pendant in front; a collar open at the nape, or closed.

It lies in a plane that rises from the collar bones to the nape, 4 mm off the skin, and is let down until it rests.  A collar
is drawn off to the front: its gap is about 3/4 of the neck's breadth, and its ends spring open.  A closed one is wide enough
for the head.  Sizes are inner lengths: collar 305-330 mm, choker 355-405, princess 430-480, matinee 510-610.
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64

from fabcraft.body.body import Body
from fabcraft.body.tape import girth
from fabcraft.errors import InputError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.oval import Oval
from fabcraft.geometry.passage import passage
from fabcraft.mesh import Mesh
from fabcraft.template.band import Profile, closed_band, open_band
from fabcraft.template.catalogue import Kind, Settings
from fabcraft.template.limb import Axes, Station, loft, poses, station
from fabcraft.template.pendant import Hanger, with_pendant
from fabcraft.template.rolled import Rolled
from fabcraft.template.template import DonningPath, Parameter, Template

EDGE_MM, TUBE_MM, LEAST_TUBE_MM, DROP_MM = 2.2, 6.0, 2.4, 30.0
ROUND_MM, RESTING_MM = 4.0, 0.5
"""Clearance all round, and where it rests."""
SIZES: Mapping[str, float] = {"collar": 318.0, "choker": 380.0, "princess": 455.0, "matinee": 560.0}
"""Inner length of the usual sizes, mm: the middle of each range."""
NECK_MM = 400.0
"""Girth of a median man's neck, which the listed lengths belong to."""
_BASE = 1.32
"""Girth of the base of the neck over that of the neck: a flatter plane would cut into the shoulders."""
_TILTS_DEG = (20.0, 25.0, 30.0, 35.0, 40.0, 45.0)
_RESTS = ("collarbone_left", "collarbone_right", "nape_low")
"""Where it rests; an open one leaves the nape free."""
_TALL = 4.0 / 3.0
"""Height of the tube's section over its thickness."""
_ABOVE_NOTCH_MM, _RISE_MM, _RISES = 5.0, 4.0, 14
_OVER_HEAD_MM = 15.0
_NAPE_MM = 25.0
"""What hangs hangs from the nape, this far above the lowest vertebra of the neck."""
_FLEX, _SKIN_GIVES_MM = 0.085, 3.0
_LARGEST = 2.0
"""Length of a closed necklace over that of one that follows the neck."""
_POSES, _SLICES = 36, 24
_CLOSEST, _LIFTS, _RESERVE_MM = 400, 12, 0.02
_LEVEL = np.array([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
_PLACES = ("cervicale", "jugular_notch", "neck_root", "head", "vertex", "menton")


@dataclass(frozen=True, eq=False)
class _Neck:
    """Where a necklace is worn, and how thick it is."""

    part: Body
    at: Mapping[str, Float64[np.ndarray, "3"]]
    scale: float
    """Girth of the neck over a median man's."""
    girth_mm: float
    """Of the neck, where it is least."""
    tube: float
    """Thickness of the tube, square to the skin."""

    @property
    def tall(self) -> float:
        """Height of the tube's section, along the neck."""
        return _TALL * self.tube

    def axes(self, tilt_deg: float) -> Axes:
        """The plane that rises to the nape by that angle: to the right of the wearer, to the front, up."""
        turn = np.radians(tilt_deg)
        front = np.array([0.0, -np.cos(turn), -np.sin(turn)])
        return np.stack([[-1.0, 0.0, 0.0], front, [0.0, front[2], -front[1]]])

    def skin(self, up_mm: float, tilt_deg: float) -> Rolled:
        """The neck under the tube where the plane passes `up_mm` above the jugular notch."""
        notch, axes = self.at["jugular_notch"], self.axes(tilt_deg)
        depth = float(np.linalg.norm(notch - self.at["cervicale"]))
        origin = (notch + [0.0, 0.0, up_mm] - 0.5 * depth * axes[1]) * [0.0, 1.0, 1.0]
        heights = 0.5 * self.tall * np.array([-1.0, 0.0, 1.0])
        ovals = [station(self.part.mesh, origin + at * axes[2], axes).oval for at in heights]
        return Rolled(origin, axes, Oval.holding(ovals).mirrored())


def build(body: Body, settings: Settings) -> Template:
    """The necklace for `body`.  Raises `InputError` for a body without a neck, and for a size that does not go on."""
    chosen = KIND.settled(settings)
    neck, open_ = _neck(body, chosen), chosen.get("style", "open") == "open"
    surface = SurfaceDistance(neck.part.mesh)
    rolled, play = _laid(neck, chosen.get("size"), surface, 0.0 if open_ else _OVER_HEAD_MM)
    edge = EDGE_MM * float(np.clip(neck.scale, 0.35, 1.0))
    if open_:
        way = _to_the_front(neck, rolled, chosen.get("gap"))
        gap, size = way.gap, (neck.tall, neck.tube)
        tube, _ = open_band(rolled, size, gap, 0.5 * neck.tube, 0.0, edge, KIND.name)
        path = _easiest(way, tube, surface)
    else:
        gap, path = 0.0, _over_the_head(neck, rolled)
        tube, _ = closed_band(rolled, _profile(neck), edge, KIND.name)
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


def _neck(body: Body, chosen: Mapping[str, float | str]) -> _Neck:
    part, at = KIND.worn(body, "bust", _PLACES)
    root, along = at["neck_root"], at["head"] - at["neck_root"]
    around = min(girth(part.mesh, root + t * along, along).length_mm for t in np.arange(-0.3, 1.01, 0.1))
    scale = around / NECK_MM
    natural = max(LEAST_TUBE_MM, TUBE_MM * scale) if part.kind == "character" else TUBE_MM
    return _Neck(part, at, scale, around, float(chosen.get("tube", natural)))


def _laid(
    neck: _Neck, size: float | str | None, surface: SurfaceDistance, over_head_mm: float
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
        room, windows = over_head_mm * neck.scale / (2.0 * np.pi), _head(neck, neck.tall)
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


def _higher(neck: _Neck, up: float, tilt: float, off: float, asked: float) -> tuple[Rolled, Oval]:
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


def _profile(neck: _Neck) -> Profile:
    return Profile(
        lambda u: np.full(len(u), 0.5 * neck.tall),
        np.zeros_like,
        lambda u: np.full(len(u), neck.tube),
        (0.5 * neck.tube, 0.5 * neck.tube),
    )


def _rested(neck: _Neck, rolled: Rolled, surface: SurfaceDistance, hangs: bool) -> Rolled:
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


def _spread(neck: _Neck, rolled: Rolled, around: int, on_section: int) -> Float64[np.ndarray, "N 3"]:
    """Places (u, v, w) spread over the tube."""
    u = np.linspace(-0.5, 0.5, around, endpoint=False) * rolled.oval.length
    section = _profile(neck).points(u[:1], on_section)[0]
    return np.column_stack([np.repeat(u, len(section)), np.tile(section, (len(u), 1))])


def _head(neck: _Neck, thick_mm: float = 0.0) -> list[Station]:
    """Level slices of the head from the chin to past its top, ears laid back; those of a character stay.

    thick_mm : how much a slice takes in besides what lies between it and the next.
    """
    vertices = neck.part.mesh.vertices
    keep = np.ones(len(vertices), dtype=bool)
    if neck.part.kind != "character":
        for name in ("ear_left", "ear_right"):
            if name in neck.part.regions:
                keep[neck.part.regions[name].vertex_indices] = False
    points = vertices[keep]
    low, top = 0.5 * (neck.at["neck_root"][2] + neck.at["menton"][2]), neck.at["vertex"][2]
    heights = np.linspace(low, top + neck.tall, _SLICES)
    reach = 0.75 * (heights[1] - heights[0]) + 0.5 * thick_mm
    slices: list[Station] = []
    for z in heights:
        near = points[np.abs(points[:, 2] - z) < reach]
        middle = np.array([0.0, neck.at["head"][1], z])
        past = len(near) <= 8  # the top of the head
        oval = slices[-1].oval.scaled(0.5) if past else Oval.around((near - middle) @ _LEVEL[:2].T).mirrored()
        slices.append(Station(middle, _LEVEL, oval))
    return slices


def _over_the_head(neck: _Neck, rolled: Rolled) -> DonningPath:
    """Lifted off the shoulders, levelled, and over the head."""
    seat = Station(rolled.origin, rolled.axes, rolled.oval)
    lifted = poses([seat, *_head(neck, neck.tall)], rolled.middle)
    filled = [lifted[0]]
    for before, after in itertools.pairwise(lifted):
        filled += [_between(before, after, 0.5), after]
    gives = 0.0 if neck.part.kind == "character" else _SKIN_GIVES_MM
    return DonningPath(
        np.stack(filled), gives, "ears and hair give", loft(_head(neck), "head with the ears laid back")
    )


def _between(one: Float64[np.ndarray, "4 4"], other: Float64[np.ndarray, "4 4"], share: float) -> np.ndarray:
    """The pose between two that differ little: the mean, made a rotation again."""
    mean = (1.0 - share) * one + share * other
    left, _, right = np.linalg.svd(mean[:3, :3])
    mean[:3, :3] = left @ right
    return mean


@dataclass(frozen=True, eq=False)
class _Way:
    """How a collar comes off to the front."""

    gap: float
    gives: float
    why: str
    rise: Float64[np.ndarray, "3"]
    """To where the neck is slender."""
    travel: float
    """From there to the front, mm."""

    def path(self, rises: bool, down_deg: float) -> DonningPath:
        """Up first or not, then to the front and down by that angle."""
        step, down = np.linspace(0.0, 1.0, _POSES), np.radians(down_deg)
        off = np.maximum(0.0, (step - 0.25) / 0.75)
        poses_ = np.tile(np.eye(4), (_POSES, 1, 1))
        front = np.array([0.0, -np.cos(down), -np.sin(down)])
        poses_[:, :3, 3] = np.outer(np.minimum(4.0 * step, 1.0) * rises, self.rise) + np.outer(
            off * self.travel, front
        )
        return DonningPath(poses_, self.gives, self.why)


def _to_the_front(neck: _Neck, rolled: Rolled, asked: float | str | None) -> _Way:
    """The gap at the nape that lets the neck through where it is most slender, and the way there and off."""
    flex = _FLEX * rolled.oval.length / np.pi
    gives = flex + (0.0 if neck.part.kind == "character" else _SKIN_GIVES_MM)
    back = rolled.world(np.array([[0.5 * rolled.oval.length, 0.0, 0.0]]))[0]
    axis = (neck.at["head"] - neck.at["neck_root"]) / (neck.at["head"] - neck.at["neck_root"])[2]
    highest = 0.6 * float(neck.at["menton"][2] - neck.at["jugular_notch"][2])
    rises = np.linspace(0.0, max(highest, 0.0), 9)
    breadths = [_breadth(neck, back[2] + rise, axis) for rise in rises]
    best = int(np.argmin(breadths))
    # or along its own plane, where the neck is as broad as the collar but for the clearance
    breadth = min(breadths[best], rolled.oval.width(0.0) - 2.0 * neck.part.clearance_mm(ROUND_MM))
    needed = breadth - 2.0 * gives
    gap = max(0.75 * breadth, needed + 1.5) if asked is None else float(asked)
    if gap < needed:
        raise InputError(
            f"a gap of {gap:.0f} mm does not let the neck through, {breadth:.0f} mm broad there, although the ends spring "
            f"open by {flex:.0f} mm each",
            f"Choose a gap of {np.ceil(needed):.0f} mm or more.",
        )
    travel = 2.0 * rolled.oval.width(0.5 * np.pi) + 4.0 * neck.tube
    return _Way(gap, gives, f"each end springs open by {flex:.0f} mm", rises[best] * axis, travel)


def _easiest(way: _Way, tube: Mesh, surface: SurfaceDistance) -> DonningPath:
    """The first way that presses no more than allowed, or the one that presses least."""
    points = tube.vertices[:: max(1, len(tube.vertices) // 600)]
    best, least = way.path(True, 0.0), np.inf
    for rises, down_deg in ((True, 0.0), *((False, down) for down in (0.0, 20.0, 30.0, 40.0, 50.0, 60.0))):
        path = way.path(rises, down_deg)
        pressed = float(passage(points, path.poses, surface).depth_mm.max())
        if pressed < least:
            best, least = path, pressed
        if least <= path.allowed_mm:
            break
    return best


def _breadth(neck: _Neck, z: float, axis: Float64[np.ndarray, "3"]) -> float:
    """Breadth of the neck under the ends of a collar at that height."""
    root, mesh = neck.at["neck_root"], neck.part.mesh
    heights = z + 0.5 * neck.tall * np.array([-1.0, 1.0])
    return max(station(mesh, root + (one - root[2]) * axis, _LEVEL).oval.width(0.0) for one in heights)


def _inner(mesh: Mesh, rolled: Rolled, neck: _Neck) -> Bool[np.ndarray, " F"]:
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
