"""The helmet: a shell over the convex upper head, with a rolled rim from the brows over the ears down to the nape.

Numbers (mm, on a head 200 long): rim 25 above the glabella, 15 over the ears, 50 under the back of the head; room for
pads 6 (EN 960 headforms are the bare head; 6 mm is a convention), 3 as a show piece; wall 3; ears keep 5.  The rim turns
out to a brim of 3, and to a peak of 10 more over the brows.  A character's helmet is domed where its head is flat or
pointed.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from fabcraft.body.body import Body
from fabcraft.geometry.implicit import met, slope
from fabcraft.geometry.walled import Wall, walled
from fabcraft.template.catalogue import Kind, Settings
from fabcraft.template.headwear import (
    LANDMARKS,
    Head,
    Line,
    Points,
    fitting_mm,
    head_of,
    least_facing_axis,
    lifted_off,
    skin_of,
    wall_mm,
)
from fabcraft.template.lining import Lining, Pad, covered_bounds, pad_gap_mm, resting
from fabcraft.template.template import MotifFrame, Parameter, Template
from fabcraft.template.whole import crest

EDGE_MM, WALL_MM, BRIM_MM, PEAK_MM = 4.0, 3.0, 3.0, 10.0
ROOM_MM = {"padded": 6.0, "show": 3.0}
BROW_MM, OVER_EARS_MM, NAPE_MM = 25.0, 15.0, 50.0
PADS_MM = {"crown": 28.0, "forehead": 15.0, "temple_left": 15.0, "temple_right": 15.0, "nape": 15.0}
"""Where it rests, and the radius of the pad there."""
_BLUR_MM = 12.0
_DOME, _WITHIN = 0.42, 0.96
"""Least height of a character's helmet over the mean of its rim, over its breadth; size of the dome over the head's."""
_BEAD = 0.3
"""How much thicker than the wall the rim is, as a share."""
_PEAK = 0.62
"""Azimuth at which the peak has lost two fifths of its length."""
_CALM_NAPE = 0.7
"""How much less the brim stands out behind, as a share: the shell is away from the neck there as it is."""
_FRONT_RADIUS_MM = 90.0
"""Of the shell at the face window, for its arc lengths."""
_LEFT, _BACK, _UP = np.eye(3)


@dataclass(frozen=True, eq=False)
class _Window:
    """The opening for the face: between two heights and up to an azimuth, with round corners."""

    head: Head
    low: float
    high: float
    side: float

    def beside(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Distance from it, negative in it, along the front of the shell."""
        corner = 20.0 * self.head.scale
        across = _FRONT_RADIUS_MM * self.head.scale * (self.head.azimuth(points) - self.side) + corner
        along = np.abs(points[:, 2] - 0.5 * (self.low + self.high)) - 0.5 * (self.high - self.low) + corner
        outside = np.hypot(np.maximum(across, 0.0), np.maximum(along, 0.0))
        return outside + np.minimum(np.maximum(across, along), 0.0) - corner


@dataclass(frozen=True, eq=False)
class _Shell:
    """The helmet as a field: negative in the material."""

    lining: Lining
    rim: Line
    wall: float
    brim: float
    peak: float
    window: _Window | None = None
    pads: tuple[Pad, ...] = ()

    def beyond(self, points: Points) -> Float64[np.ndarray, " N"]:
        """How far points are past an edge of the shell."""
        past = -self.rim.above(points)
        return past if self.window is None else np.maximum(past, -self.window.beside(points))

    def within(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Distance outward from the inner side, which flares out to the brim near the rim."""
        azimuth = self.rim.head.azimuth(points)
        brim = self.brim * (1.0 - _CALM_NAPE * np.clip(azimuth / np.pi, 0.0, 1.0) ** 4)
        brim = brim + self.peak * np.exp(-0.5 * (azimuth / _PEAK) ** 2)
        reach = 14.0 * self.rim.head.scale + brim
        share = np.clip(1.0 - self.rim.above(points) / reach, 0.0, 1.2)
        steep = 3.0 * brim / reach * share**2
        return (self.lining.within(points) - brim * share**3) / np.sqrt(1.0 + steep**2)

    def outer(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Distance outward from the outer side, which thickens to a bead at the edges."""
        bead = np.exp(-0.5 * (np.minimum(self.beyond(points), 0.0) / (1.2 * self.wall)) ** 2)
        return self.within(points) - self.wall * (1.0 + _BEAD * bead)

    def inner(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Distance inward from the inner side, without pads."""
        return -self.within(points)

    def resting(self, points: Points) -> Float64[np.ndarray, " N"]:
        """1 on the pads, 0 beside them and at the edges, smooth between."""
        share = np.max([np.zeros(len(points)), *(pad.share(points) for pad in self.pads)], axis=0)
        clear = (-self.beyond(points) / (PADS_MM["nape"] * self.rim.head.scale) - 0.1) / 0.5
        return share * np.clip(clear, 0.0, 1.0)

    def middle(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Distance outward from the middle of the wall."""
        return self.within(points) - 0.5 * self.wall


def build(body: Body, settings: Settings) -> Template:
    """The helmet for `body`.  Raises `InputError` for a body without a free upper head and for a size that is too small."""
    chosen = KIND.settled(settings)
    head = head_of(*KIND.worn(body, "head", LANDMARKS))
    part, s = head.part, head.scale
    wall = wall_mm(head, chosen, WALL_MM)
    brim, peak = float(chosen.get("brim", BRIM_MM * s)), float(chosen.get("peak", PEAK_MM * s))
    fit = chosen.get("fit", "padded")
    room = part.clearance_mm(ROOM_MM[fit]) if isinstance(fit, str) else float(fit)
    windowed, padded = bool(chosen.get("window", 0.0)), bool(chosen.get("pads", 1.0))
    size = KIND.within("size", fitting_mm(head, chosen.get("size"), KIND.name))
    rim = _rim(head, chosen, windowed)
    # from over the ears up no part of a face is in the way: the axis may lean to where brow and nape need it
    axis = _UP if windowed else least_facing_axis(part, ("forehead", "nape", "temple_left", "temple_right"))
    # the rounded rim reaches below its line
    worn = skin_of(part.mesh, rim.above(part.mesh.vertices) > -0.6 * (room + wall))
    sized = head.sized(worn, size)
    dome = _dome(rim, sized) if part.kind == "character" else sized[:0]
    bounds = covered_bounds(np.vstack([sized, dome]), axis, room + wall + brim + peak + 8.0 * s)
    promised, gap = pad_gap_mm(head)
    lining = Lining.around(worn, axis, room, gap, _BLUR_MM * s, bounds, 0.5 if padded else 1.0, sized, dome)
    shell = _Shell(lining, rim, wall, brim, peak)
    if windowed:  # what is over the face has no peak
        low, high = head.at["stomion"][2] - 14.0 * s, head.at["glabella"][2] + 14.0 * s
        shell = replace(shell, peak=0.0, window=_Window(head, low, high, 1.05))
    pads = _pads(shell)
    if padded:
        shell = replace(shell, pads=tuple(pads.values()))

    edge = EDGE_MM * s
    wall_of = Wall(
        shell.middle,
        shell.beyond,
        shell.outer,
        shell.inner,
        rest=lining.rest,
        resting=shell.resting,
        least_mm=wall,
    )
    mesh, inside = walled(wall_of, bounds, edge, min(0.65 * edge, wall), mirrored=True, name=KIND.name)
    contacts = resting(part, pads)
    domed = ("The helmet is domed over the head and leaves room where that is flat.",) if len(dome) else ()
    return Template(
        name=KIND.name,
        body=replace(part, regions={**part.regions, **contacts}),
        mesh=mesh,
        rims=(),
        surface=None,
        wall_mm=wall,
        genus=int(windowed),
        contacts=tuple(contacts),
        edge_mm=edge,
        donning=tuple(axis.tolist()),
        path=lifted_off(part, mesh.vertices, axis, "a rigid shell; hair and skin give a little"),
        locked=inside,
        mirrored=True,
        motifs=(*_motifs(shell), crest(mesh, inside, max(8.0 * s, 2.0 * wall), 60.0 * s)),
        listed_mm=(promised if padded else room, room),
        parameters={"size": size, "fit": room, "wall": wall, "brim": brim, "peak": peak}
        | {"pads": float(padded), "window": float(windowed)},
        notes=(*domed, f"The helmet is for a head of {size:.0f} mm round, hat size {size / 10:.1f}."),
    )


def _dome(rim: Line, worn: Points) -> Float64[np.ndarray, "K 3"]:
    """An upper half of an ellipsoid over the rim, at least as high as the head."""
    low = float(rim.height(np.linspace(0.0, np.pi, 32)).mean())
    half = 0.5 * np.ptp(worn[:, :2], axis=0)
    height = max(float(worn[:, 2].max()) - low, _DOME * 2.0 * half[0])
    turn, rise = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 48), np.linspace(0.1, 0.5 * np.pi, 12))
    ball = np.stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)], axis=2)
    middle = np.array([0.0, 0.5 * (worn[:, 1].min() + worn[:, 1].max()), low])
    return middle + ball.reshape(-1, 3) * np.append(_WITHIN * half, height)


def _rim(head: Head, chosen: Settings, windowed: bool) -> Line:
    """Where the shell ends."""

    def mm(name: str, usual: float) -> float:
        return float(chosen.get(name, usual * head.scale))

    behind = head.at["opisthocranion"][2]
    if windowed:
        chin, low = head.at["menton"][2] - 8.0 * head.scale, behind - mm("nape", 80.0)
        return Line.through(head, [(0.0, chin), (0.7, chin), (np.pi - 0.7, low), (np.pi, low)], 0.3)
    first, last = head.ears[0] - 0.1, head.ears[1] + 0.1
    front, back = head.at["glabella"][2] + mm("brow", BROW_MM), behind - mm("nape", NAPE_MM)
    side = head.at["ear_tip_left"][2] + mm("over_ears", OVER_EARS_MM)
    if (
        "ear_left" not in head.part.regions and "over_ears" not in chosen
    ):  # nothing stands out that it must leave free
        back = 0.5 * (front + back)
        side = 0.5 * (front + back)
    knots = [
        (0.0, front),
        (0.35 * first, front),
        (first, side),
        (last, side),
        (np.pi - 0.4, back),
        (np.pi, back),
    ]
    return Line.through(head, knots, 0.2)


def _pads(shell: _Shell) -> dict[str, Pad]:
    """A pad before every place that it can rest on, moved up along the skin where an edge would cut it."""
    part, s = shell.rim.head.part, shell.rim.head.scale
    vertices = part.mesh.vertices
    inside, pads = -shell.beyond(vertices), {}
    for name, radius in PADS_MM.items():
        if name not in part.regions:
            continue
        middle = vertices[part.regions[name].vertex_indices].mean(0)
        middle = middle + max(1.1 * radius * s + float(shell.beyond(middle[None])[0]), 0.0) * _UP
        near = int((np.linalg.norm(vertices - middle, axis=1) + 1e3 * (inside < radius * s)).argmin())
        if shell.lining.reaches(vertices[near], radius * s, s):
            out = slope(shell.lining.distance, vertices[near][None], 0.5 * s)[0]
            deep = -float(shell.lining.within(vertices[near][None])[0])
            pads[name] = Pad(vertices[near], out / np.linalg.norm(out), max(radius * s, deep))
    return pads


def _motifs(shell: _Shell) -> tuple[MotifFrame, ...]:
    """In front over the rim (or over the window), and on top with the wearer's face at its lower edge."""
    head, s = shell.rim.head, shell.rim.head.scale
    top = met(shell.outer, head.middle, _UP, 300.0 * s)
    low = float(shell.rim.height(0.0)) if shell.window is None else shell.window.high
    room = float(top[2]) - low
    brow = met(shell.outer, head.middle * [0.0, 1.0, 0.0] + (low + 0.5 * room) * _UP, -_BACK, 300.0 * s)
    out = slope(shell.lining.distance, brow[None], 0.5)[0]
    height = min(50.0 * s, 0.6 * room)
    return (
        MotifFrame(
            "brow", brow, _LEFT, np.cross(out / np.linalg.norm(out), _LEFT), (1.6 * height, height), 60.0 * s
        ),
        MotifFrame("crown", top, _LEFT, _BACK, (60.0 * s, 90.0 * s), 60.0 * s),
    )


KIND = Kind(
    "helmet",
    build,
    (
        Parameter(
            "size", "mm", 120.0, 750.0, "circumference of the head, or a hat size (M, hat57, US 7 1/8)"
        ),
        Parameter(
            "fit",
            "mm",
            0.4,
            15.0,
            "room between head and shell: 6 with pads, 3 for a show piece",
            tuple(ROOM_MM),
        ),
        Parameter("wall", "mm", 1.6, 8.0, "thickness of the shell"),
        Parameter("brim", "mm", 0.0, 25.0, "how far the rim stands out"),
        Parameter("peak", "mm", 0.0, 40.0, "how much farther it does over the brows"),
        Parameter("brow", "mm", 10.0, 60.0, "height of the rim over the glabella in front"),
        Parameter("over_ears", "mm", 8.0, 40.0, "height of the rim over the ears"),
        Parameter("nape", "mm", 10.0, 90.0, "how far the rim goes down behind, from the back of the head"),
        Parameter(
            "pads", "", 0.0, 1.0, "1: printed pads on the inner side that reach the head; 0: room for foam"
        ),
        Parameter("window", "", 0.0, 1.0, "1: down to the chin, with an opening for the face"),
    ),
    "Printed on its rim it needs supports inside; a resin or powder printer makes it in one piece.",
)
