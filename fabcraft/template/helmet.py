"""The helmet: a shell over the convex upper head, with a rolled rim from the brows over the ears down to the nape.

Its middle surface is a level of the blurred distance to the hull of the covered head without the ears, drawn down along the
donning axis.  Blurring keeps a shape that is open downwards so, which is why no part of the inner side is undercut.
Numbers (mm, on a head 200 long): rim 25 above the glabella, 15 over the ears, 60 under the back of the head; room for
pads 6 (EN 960 headforms are the bare head; 6 mm is a convention), 3 as a show piece; wall 3; ears keep 5.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64

from fabcraft.body.body import Body
from fabcraft.body.region import Region
from fabcraft.errors import InputError
from fabcraft.geometry.flips import towards
from fabcraft.geometry.implicit import Convex, GridField, blurred, met, round_wall, settled, skin, slope
from fabcraft.geometry.isotropic import isotropic
from fabcraft.mesh import Mesh
from fabcraft.template.catalogue import Kind, Settings
from fabcraft.template.headwear import LANDMARKS, Head, Line, Points, hat_mm, head_of, least_facing_axis, lifted_off
from fabcraft.template.template import MotifFrame, Parameter, Template

EDGE_MM, WALL_MM, LEAST_WALL_MM, BRIM_MM = 4.0, 3.0, 1.6, 3.0
ROOM_MM = {"padded": 6.0, "show": 3.0}
BROW_MM, OVER_EARS_MM, NAPE_MM = 25.0, 15.0, 60.0
PADS_MM = {"crown": 28.0, "forehead": 15.0, "temple_left": 15.0, "temple_right": 15.0, "nape": 15.0}
"""Where it rests, and the radius of the pad there."""
PAD_GAP_MM = 0.3
_BLUR_MM = 12.0
_DOME, _WITHIN = 0.42, 0.96
"""Least height of a character's helmet over the mean of its rim, over its breadth; size of the dome over the head's."""
_HOLLOW_MM = 2.5
"""Skin that lies deeper than this under the hull of the head is not rested on."""
_DEEPEST = 5.0
"""How far pads may reach in, over the room between head and shell."""
_BEAD = 0.4
"""How much thicker than the wall the rim is, as a share."""
_FRONT_RADIUS_MM = 90.0
"""Of the shell at the face window, for its arc lengths."""
_LEFT, _BACK, _UP = np.eye(3)


@dataclass(frozen=True, eq=False)
class _Pad:
    """A boss on the inner side that follows the head."""

    foot: Float64[np.ndarray, "3"]
    """On the skin, mm."""
    normal: Float64[np.ndarray, "3"]
    radius: float

    def share(self, points: Points) -> Float64[np.ndarray, " N"]:
        """1 on the pad, 0 beside it, smooth between."""
        away = points - self.foot
        out = away @ self.normal
        across = np.sqrt(np.maximum((away**2).sum(1) - out**2, 0.0))
        share = np.clip((1.5 * self.radius - across) / (0.7 * self.radius), 0.0, 1.0)
        return np.where(out > -self.radius, share**2 * (3.0 - 2.0 * share), 0.0)


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

    head: Head
    tight: Convex
    """The hull of what is covered, drawn down along the donning axis."""
    distance: GridField
    """The same, blurred."""
    level: float
    """Of the inner side in `distance`."""
    rim: Line
    wall: float
    brim: float
    pads: tuple[_Pad, ...] = ()
    deep: float = 0.0
    """How far pads reach in from the inner side, at most."""
    gap: float = 0.0
    """Between pads and skin."""
    window: _Window | None = None

    def beyond(self, points: Points) -> Float64[np.ndarray, " N"]:
        """How far points are past an edge of the shell."""
        past = -self.rim.above(points)
        return past if self.window is None else np.maximum(past, -self.window.beside(points))

    def within(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Distance outward from the inner side, which flares out to the brim near the rim."""
        reach = 10.0 * self.head.scale + 0.6 * self.brim
        share = np.clip(1.0 - self.rim.above(points) / reach, 0.0, 1.0)
        flare = self.brim * share**2 * (3.0 - 2.0 * share)
        steep = 6.0 * self.brim / reach * share * (1.0 - share)
        return (self.distance(points) - self.level - flare) / np.sqrt(1.0 + steep**2)

    def padded(self, points: Points, within: Float64[np.ndarray, " N"]) -> Float64[np.ndarray, " N"]:
        """Distance outward from the inner side with its pads."""
        share = np.zeros(len(points))
        for pad in self.pads:
            share = np.maximum(share, pad.share(points))
        there = np.flatnonzero((share > 0.0) & (within < self.wall) & (within > -self.deep))
        padded = within.copy()
        padded[there] += share[there] * (self.tight(points[there]) - self.gap - within[there])
        return np.maximum(within, padded)

    def __call__(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Signed distance, about."""
        beyond = self.beyond(points)
        bead = _BEAD * self.wall * np.exp(-0.5 * (np.minimum(beyond, 0.0) / (1.2 * self.wall)) ** 2)
        within = self.within(points)
        outer, inner = within - self.wall - bead, -self.padded(points, within)
        return round_wall(0.5 * (outer - inner), beyond, -0.5 * (outer + inner))


def build(body: Body, settings: Settings) -> Template:
    """The helmet for `body`.  Raises `InputError` for a body without a free upper head and for a size that is too small."""
    chosen = KIND.settled(settings)
    part, at = KIND.worn(body, "head", LANDMARKS)
    head = head_of(part, at)
    s = head.scale
    usual = WALL_MM if part.kind != "character" else max(LEAST_WALL_MM, 0.02 * float(part.mesh.size_mm[2]))
    wall, brim = float(chosen.get("wall", usual)), float(chosen.get("brim", BRIM_MM * s))
    fit = chosen.get("fit", "padded")
    room = part.clearance_mm(ROOM_MM[fit]) if isinstance(fit, str) else float(fit)
    windowed, own = bool(chosen.get("window", 0.0)), head.round_mm
    size = _size(chosen.get("size"), own)

    rim = _rim(head, chosen, windowed)
    axis = least_facing_axis(part, ("forehead", "nape", "temple_left", "temple_right")) if not windowed else _UP
    padded = bool(chosen.get("pads", 1.0))
    covered = head.skin(rim.lowered(0.6 * (room + wall)), ears=windowed)  # the rounded rim reaches below its line
    covered = head.middle + (covered - head.middle) * [size / own, size / own, 1.0]
    worn = covered
    covered, notes = _domed(head, rim, worn)
    down = float(part.mesh.size_mm[2]) * axis
    tight = Convex.around(np.concatenate([worn, worn - down]), mirrored=True)
    shape = tight if covered is worn else Convex.around(np.concatenate([covered, covered - down]), mirrored=True)
    under = covered - float(np.ptp(covered[:, 2])) * axis
    bounds = np.stack([np.minimum(covered, under).min(0), covered.max(0)])
    bounds[0, 2] = covered[:, 2].min()
    bounds += np.array([[-1.0], [1.0]]) * (room + wall + brim + 8.0 * s)
    distance = blurred(shape, bounds, _BLUR_MM * s, 7.0 * s, mirrored=True)
    depths = distance(worn)
    level = float(max(np.median(depths) + room, depths.max() + 0.5 * room) if padded else depths.max() + room)
    shell = _Shell(head, tight, distance, level, rim, wall, brim)
    if windowed:
        low, high = head.at["stomion"][2] - 14.0 * s, head.at["glabella"][2] + 14.0 * s
        shell = replace(shell, window=_Window(head, low, high, 1.05))
    pads = _pads(shell, room)
    if padded:
        shell = replace(shell, pads=tuple(pads.values()), deep=(_DEEPEST + 0.5) * room, gap=part.clearance_mm(PAD_GAP_MM) + 0.15 * s)

    edge = EDGE_MM * s
    least = min(max(0.36 * edge, 0.45 * wall), edge)

    def finer(points: Points) -> Float64[np.ndarray, " N"]:
        return least + 0.5 * np.maximum(-shell.beyond(points) - 0.8 * wall, 0.0)

    mesh = skin(shell, bounds, 0.45 * edge, mirrored=True, name=KIND.name)
    mesh = settled(isotropic(mesh, edge, finer=finer, mirrored=True, rounds=6), shell, 0.5 * least)
    mesh = towards(mesh, shell, 0.03 * least)
    resting = _resting(part, pads)
    return Template(
        name=KIND.name,
        body=replace(part, regions={**part.regions, **resting}),
        mesh=mesh,
        rims=(),
        surface=None,
        wall_mm=wall,
        genus=int(windowed),
        contacts=tuple(resting),
        edge_mm=edge,
        donning=tuple(axis.tolist()),
        path=lifted_off(part, mesh.vertices, axis, "a rigid shell; hair and skin give a little"),
        locked=_inner(mesh, shell),
        mirrored=True,
        motifs=_motifs(shell),
        listed_mm=(part.clearance_mm(PAD_GAP_MM) if padded else room, room),
        parameters={
            "size": size, "fit": room, "wall": wall, "brim": brim, "pads": float(padded), "window": float(windowed)
        },
        notes=(*notes, f"The helmet is for a head of {size:.0f} mm round: hat size {size / 10:.1f}, US {size / np.pi / 25.4:.2f}.",),
    )


def _domed(head: Head, rim: Line, covered: Points) -> tuple[Points, tuple[str, ...]]:
    """What is covered; of a character with a flat or a pointed head together with a dome, so that the helmet is round."""
    low = float(rim.height(np.linspace(0.0, np.pi, 32)).mean())
    half = 0.5 * np.ptp(covered[:, :2], axis=0)
    height = float(covered[:, 2].max()) - low
    if head.part.kind != "character":
        return covered, ()
    turn, rise = (axis.ravel() for axis in np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 48), np.linspace(0.1, 0.5 * np.pi, 12)))
    middle = np.array([0.0, 0.5 * (covered[:, 1].min() + covered[:, 1].max()), low])
    ball = np.stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)], axis=1)
    dome = middle + ball * np.append(_WITHIN * half, max(height, _DOME * 2.0 * half[0]))
    return np.concatenate([covered, dome]), ("The helmet is domed over the head, which is flat or pointed, and leaves room there.",)


def _size(size: float | str | None, own: float) -> float:
    """Circumference of the head that the helmet is made for."""
    asked = own if size is None else hat_mm(size)
    if asked < own - 1.0:
        raise InputError(
            f"a helmet for a head of {asked:.0f} mm round was asked, but this one has {own:.0f} mm",
            f"Choose hat{np.ceil(own / 10):.0f} ({10 * np.ceil(own / 10):.0f} mm) or larger.",
        )
    return asked


def _rim(head: Head, chosen: Settings, windowed: bool) -> Line:
    """Where the shell ends."""
    s = head.scale

    def mm(name: str, usual: float) -> float:
        return float(chosen.get(name, usual * s))

    if windowed:
        chin, low = head.at["menton"][2] - 8.0 * s, head.at["opisthocranion"][2] - mm("nape", 80.0)
        return Line.through(head, [(0.0, chin), (0.7, chin), (np.pi - 0.7, low), (np.pi, low)], 0.3)
    first, last = head.ears[0] - 0.1, head.ears[1] + 0.1
    front = head.at["glabella"][2] + mm("brow", BROW_MM)
    side = head.at["ear_tip_left"][2] + mm("over_ears", OVER_EARS_MM)
    back = head.at["opisthocranion"][2] - mm("nape", NAPE_MM)
    if "ear_left" not in head.part.regions and "over_ears" not in chosen:  # nothing stands out that it must leave free
        back = 0.5 * (front + back)
        side = 0.5 * (front + back)
    return Line.through(
        head, [(0.0, front), (0.35 * first, front), (first, side), (last, side), (np.pi - 0.4, back), (np.pi, back)], 0.16
    )


def _pads(shell: _Shell, room: float) -> dict[str, _Pad]:
    """A pad before every place that it can rest on, moved up along the skin where the rim would cut it."""
    part, s = shell.head.part, shell.head.scale
    vertices, normals, above = part.mesh.vertices, part.mesh.vertex_normals, -shell.beyond(part.mesh.vertices)
    pads = {}
    for name, radius in PADS_MM.items():
        if name not in part.regions:
            continue
        middle = vertices[part.regions[name].vertex_indices].mean(0)
        middle = middle + max(1.1 * radius * s + float(shell.beyond(middle[None])[0]), 0.0) * _UP
        off = np.linalg.norm(vertices - middle, axis=1) + 1e3 * (above < radius * s)
        near = int(off.argmin())
        foot = vertices[near][None]
        if shell.tight(foot)[0] > -max(_HOLLOW_MM * s, 1.5) and shell.within(foot)[0] > -_DEEPEST * room:
            pads[name] = _Pad(vertices[near], normals[near], radius * s)
    return pads


def _resting(part: Body, pads: Mapping[str, _Pad]) -> dict[str, Region]:
    """The regions that it rests on: the skin under the pads."""
    found = {}
    for name, pad in pads.items():
        facing = part.mesh.vertex_normals @ pad.normal > 0.5
        under = np.linalg.norm(part.mesh.vertices - pad.foot, axis=1) < 0.75 * pad.radius
        found[name] = part.regions[name].at(np.flatnonzero(under & facing))
    return found


def _inner(mesh: Mesh, shell: _Shell) -> Bool[np.ndarray, " F"]:
    """Faces that look at the head."""
    outward = slope(shell.distance, mesh.corners.mean(1), 0.5)
    return np.einsum("ij,ij->i", mesh.face_normals, outward) < -0.2


def _motifs(shell: _Shell) -> tuple[MotifFrame, ...]:
    """In front over the rim (or over the window), and on top with the wearer's face at its lower edge."""
    head, s = shell.head, shell.head.scale
    top = met(shell, head.middle, _UP, 300.0 * s)
    low = float(shell.rim.height(0.0)) if shell.window is None else shell.window.high
    room = top[2] - low
    brow = met(shell, head.middle * [0.0, 1.0, 0.0] + (low + 0.42 * room) * _UP, -_BACK, 300.0 * s)
    out = slope(shell.distance, brow[None], 0.5)[0]
    up = np.cross(out / np.linalg.norm(out), _LEFT)
    height = min(50.0 * s, 0.8 * room)
    return (
        MotifFrame("brow", brow, _LEFT, up, (1.6 * height, height), 60.0 * s),
        MotifFrame("crown", top, _LEFT, _BACK, (60.0 * s, 90.0 * s), 60.0 * s),
    )


KIND = Kind(
    "helmet",
    build,
    (
        Parameter("size", "mm", 120.0, 750.0, "circumference of the head, or a hat size (M, hat57, US 7 1/8)"),
        Parameter("fit", "mm", 0.4, 15.0, "room between head and shell: 6 with pads, 3 for a show piece", tuple(ROOM_MM)),
        Parameter("wall", "mm", 1.6, 8.0, "thickness of the shell"),
        Parameter("brim", "mm", 0.0, 25.0, "how far the rim stands out"),
        Parameter("brow", "mm", 10.0, 60.0, "height of the rim over the glabella in front"),
        Parameter("over_ears", "mm", 8.0, 40.0, "height of the rim over the ears"),
        Parameter("nape", "mm", 10.0, 90.0, "how far the rim goes down behind, from the back of the head"),
        Parameter("pads", "", 0.0, 1.0, "1: printed pads on the inner side that reach the head; 0: room for foam"),
        Parameter("window", "", 0.0, 1.0, "1: down to the chin, with an opening for the face"),
    ),
    "Printed on its rim it needs supports inside; a resin or powder printer makes it in one piece.",
)
