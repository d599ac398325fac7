"""The visor: a band round the head over brows and ears, and a brim in front; open behind for an elastic, or closed.

Numbers (mm, on a head 200 long): the band's middle 28 over the glabella, 36 high, tilted 8 degrees down in front; brim 62
long over 60 degrees to either side; 60 degrees open behind; room 1.5, nothing on the forehead and before the ears;
wall 2.5.  Conventions of makers.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from fabcraft.body.body import Body
from fabcraft.geometry.flips import towards
from fabcraft.geometry.implicit import met, round_wall, settled, skin, smooth_union
from fabcraft.geometry.isotropic import isotropic
from fabcraft.template.catalogue import Kind, Settings
from fabcraft.template.headwear import (
    LANDMARKS,
    Head,
    Points,
    fitting_mm,
    head_of,
    inner_faces,
    lifted_off,
    wall_mm,
)
from fabcraft.template.lining import Lining, Pad, covered_bounds, pad_gap_mm, resting
from fabcraft.template.template import MotifFrame, Parameter, Template

EDGE_MM, WALL_MM, ROOM_MM = 3.0, 2.5, 1.5
BAND_MM, OVER_GLABELLA_MM, TILT_DEG = 36.0, 28.0, 8.0
BRIM_MM, SPREAD_DEG, OPEN_DEG = 62.0, 60.0, 60.0
REST_DEG = 45.0
"""Half the arc over which the band rests on the forehead."""
_BLUR_MM = 8.0
_FALL, _ARCH = 0.16, 0.45
"""Slope of the brim in its middle, and how much steeper it is at the side of the head."""
HALF_BREADTH_MM = 80.0
"""Of a median man's head."""
_ROUNDED = 2.2
"""Exponent of the brim's outline; 2 is an ellipse."""
_FILLET_MM, _CORNER_MM = 5.0, 12.0
_LEFT, _BACK, _UP = np.eye(3)


@dataclass(frozen=True, eq=False)
class _Visor:
    """The visor as a field: negative in the material."""

    head: Head
    lining: Lining
    middle: Float64[np.ndarray, "3"]
    """Of the band."""
    axis: Float64[np.ndarray, "3"]
    """Square to the band."""
    wall: float
    band: float
    brim: float
    spread: float
    """Half the arc of the brim, radians."""
    open: float
    """Half the arc that is left out behind, radians; 0 where it is closed."""
    pads: tuple[Pad, ...] = ()

    def height(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Over the middle of the band, along the axis."""
        return (points - self.middle) @ self.axis

    def beyond(self, points: Points) -> Float64[np.ndarray, " N"]:
        """How far points are past an edge of the band."""
        half = 0.5 * self.band
        up = np.abs(self.height(points)) - half
        if not self.open:
            return up
        radius = np.hypot(*(points - self.head.middle)[:, :2].T)
        corner = min(_CORNER_MM * self.head.scale, half)
        behind = radius * (self.head.azimuth(points) - (np.pi - self.open)) + corner
        up = up + corner
        outside = np.hypot(np.maximum(behind, 0.0), np.maximum(up, 0.0))
        return outside + np.minimum(np.maximum(behind, up), 0.0) - corner

    def resting(self, points: Points) -> Float64[np.ndarray, " N"]:
        """1 where the inner side touches the head, 0 where it has its room, smooth between."""
        turn = (np.radians(REST_DEG) - self.head.azimuth(points)) / 0.25
        share = np.clip(turn, 0.0, 1.0)
        share = share**2 * (3.0 - 2.0 * share)
        return np.max([share, *(pad.share(points) for pad in self.pads)], axis=0)

    def past_brim(self, points: Points, within: Float64[np.ndarray, " N"]) -> Float64[np.ndarray, " N"]:
        """Distance, about, beyond the outline of the brim: a superellipse of azimuth and distance from the band."""
        radius = np.maximum(np.hypot(*(points - self.head.middle)[:, :2].T), 30.0 * self.head.scale)
        turn = self.head.azimuth(points) / self.spread
        out = np.maximum(within - self.wall, 0.0) / self.brim
        size = np.maximum((turn**_ROUNDED + out**_ROUNDED) ** (1.0 / _ROUNDED), 0.3)
        across, along = (turn / size) ** (_ROUNDED - 1.0) / (self.spread * radius), (out / size) ** (_ROUNDED - 1.0) / self.brim
        return (size - 1.0) / np.hypot(across, along)

    def falling(self, points: Points, within: Float64[np.ndarray, " N"]) -> Float64[np.ndarray, " N"]:
        """Distance from the middle of the brim, which starts at the lower edge of the band and falls, most at its sides."""
        sideways = (points[:, 0] / (HALF_BREADTH_MM * self.head.scale)) ** 2
        fall = _FALL + _ARCH * sideways
        down = fall * np.maximum(within, 0.0) - 0.5 * (self.wall - self.band)
        return (self.height(points) + down) / np.sqrt(1.0 + fall**2)

    def off_edges(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Distance from the nearest edge of band or brim."""
        within = self.lining.within(points)
        brim = np.hypot(self.falling(points, within), np.minimum(self.past_brim(points, within) + 0.5 * self.wall, 0.0))
        return np.minimum(np.abs(self.beyond(points)), brim)

    def __call__(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Signed distance, about."""
        within = self.lining.within(points)
        inner = -self.lining.padded(points, within, self.resting(points), self.wall)
        outer = within - self.wall
        band = round_wall(0.5 * (outer - inner), self.beyond(points) + 0.5 * self.wall, -0.5 * (outer + inner))
        past = np.maximum(self.past_brim(points, within), 0.7 * self.wall - within)
        brim = round_wall(self.falling(points, within), past + 0.5 * self.wall, 0.5 * self.wall)
        whole = smooth_union(band, brim, _FILLET_MM * self.head.scale)
        return np.maximum(whole, inner)  # the fillet stays off the head


def build(body: Body, settings: Settings) -> Template:
    """The visor for `body`.  Raises `InputError` for a body without a free forehead and for a size that is too small."""
    chosen = KIND.settled(settings)
    head = head_of(*KIND.worn(body, "head", LANDMARKS))
    part, s = head.part, head.scale
    wall = wall_mm(head, chosen, WALL_MM)
    room = float(chosen.get("fit", part.clearance_mm(ROOM_MM)))
    size = fitting_mm(head, chosen.get("size"), KIND.name)
    band, brim = float(chosen.get("band", BAND_MM * s)), float(chosen.get("brim", BRIM_MM * s))
    tilt = np.radians(float(chosen.get("tilt", TILT_DEG)))
    axis = np.array([0.0, -np.sin(tilt), np.cos(tilt)])
    middle = head.at["glabella"] * [0.0, 1.0, 1.0] + OVER_GLABELLA_MM * s * _UP
    spread, open_ = (np.radians(float(chosen.get(*one))) for one in (("spread", SPREAD_DEG), ("open", OPEN_DEG)))

    worn = _worn(head, middle, axis, 0.5 * band + 0.5 * wall)
    sized = head.sized(worn, size)
    bounds = covered_bounds(sized, axis, room + wall + 8.0 * s)
    bounds[0, 1:] -= [brim, 0.7 * brim]
    bounds[:, 0] += np.array([-0.7, 0.7]) * brim
    promised, gap = pad_gap_mm(head)
    lining = Lining.around(worn, axis, room, gap, _BLUR_MM * s, bounds, 0.3, sized, sized[:0])
    visor = _Visor(head, lining, middle, axis, wall, band, brim, spread, 0.5 * open_)
    pads = _pads(visor)
    visor = replace(visor, pads=tuple(pads.values()))

    edge = EDGE_MM * s
    least = min(max(0.5 * edge, 0.6 * wall), edge)

    def finer(points: Points) -> Float64[np.ndarray, " N"]:
        return least + 0.7 * np.maximum(visor.off_edges(points) - 0.7 * wall, 0.0)

    mesh = skin(visor, bounds, 0.45 * edge, mirrored=True, name=KIND.name)
    mesh = settled(isotropic(mesh, edge, finer=finer, mirrored=True, rounds=6), visor, 0.5 * least)
    mesh = towards(mesh, visor, 0.03 * least)
    contacts = resting(part, pads) | _forehead(visor)
    return Template(
        name=KIND.name,
        body=replace(part, regions={**part.regions, **contacts}),
        mesh=mesh,
        rims=(),
        surface=None,
        wall_mm=wall,
        genus=0 if open_ else 1,
        contacts=tuple(contacts),
        edge_mm=edge,
        donning=tuple(axis.tolist()),
        path=lifted_off(part, mesh.vertices, axis, "the band and the skin give a little"),
        locked=inner_faces(mesh, lining.distance),
        mirrored=True,
        motifs=(_front(visor),),
        listed_mm=(promised, room),
        parameters={"size": size, "fit": room, "wall": wall, "band": band, "brim": brim}
        | {"tilt": float(np.degrees(tilt)), "spread": float(np.degrees(spread)), "open": float(np.degrees(open_))},
        notes=(f"The visor is for a head of {size:.0f} mm round, hat size {size / 10:.1f}.",),
    )


def _worn(head: Head, middle: Float64[np.ndarray, "3"], axis: Float64[np.ndarray, "3"], below: float) -> Points:
    """The skin above the lower edge of the band, without ears: all of it has to come out of the band."""
    keep = (head.part.mesh.vertices - middle) @ axis > -below
    for name in ("ear_left", "ear_right"):
        if name in head.part.regions:
            keep[head.part.regions[name].vertex_indices] = False
    return head.part.mesh.vertices[keep]


def _pads(visor: _Visor) -> dict[str, Pad]:
    """A pad at either temple, on the band."""
    part, s = visor.head.part, visor.head.scale
    vertices, normals = part.mesh.vertices, part.mesh.vertex_normals
    height, pads = visor.height(vertices), {}
    for name in ("temple_left", "temple_right"):
        if name not in part.regions:
            continue
        middle = vertices[part.regions[name].vertex_indices].mean(0)
        middle = middle - visor.height(middle[None])[0] * visor.axis
        near = int((np.linalg.norm(vertices - middle, axis=1) + 1e3 * (np.abs(height) > 0.25 * visor.band)).argmin())
        if visor.lining.reaches(vertices[near], s):
            pads[name] = Pad(vertices[near], normals[near], 15.0 * s)
    return pads


def _forehead(visor: _Visor) -> dict:
    """The skin that the front of the band rests on."""
    part = visor.head.part
    if "forehead" not in part.regions:
        return {}
    vertices = part.mesh.vertices
    under = (np.abs(visor.height(vertices)) < 0.3 * visor.band) & (
        visor.head.azimuth(vertices) < np.radians(REST_DEG) - 0.3
    )
    near = -visor.lining.tight(vertices) < 1.5 * max(visor.head.scale, 0.6)
    return {"forehead": part.regions["forehead"].at(np.flatnonzero(under & near))}


def _front(visor: _Visor) -> MotifFrame:
    """Before the band, rolled around the head."""
    head, s = visor.head, visor.head.scale
    centre = head.middle - ((head.middle - visor.middle) @ visor.axis) * visor.axis
    ahead = np.cross(visor.axis, _LEFT)
    origin = met(visor, centre + 0.15 * visor.band * visor.axis, -ahead, 300.0 * s)
    return MotifFrame(
        "front", origin, _LEFT, visor.axis, (2.2 * visor.band, visor.band), 60.0 * s, (centre, visor.axis)
    )


KIND = Kind(
    "visor",
    build,
    (
        Parameter("size", "mm", 120.0, 750.0, "circumference of the head, or a hat size (M, hat57, US 7 1/8)"),
        Parameter("fit", "mm", 0.4, 6.0, "room between head and band where it does not rest"),
        Parameter("wall", "mm", 1.6, 5.0, "thickness of band and brim"),
        Parameter("band", "mm", 6.0, 60.0, "height of the band"),
        Parameter("brim", "mm", 5.0, 110.0, "length of the brim in front"),
        Parameter("spread", "deg", 30.0, 85.0, "how far the brim reaches to either side"),
        Parameter("tilt", "deg", -5.0, 20.0, "how much the band is lower in front"),
        Parameter("open", "deg", 0.0, 150.0, "what is left out behind, for an elastic; 0: a closed band"),
    ),
    "Printed upside down on the band's upper edge it needs supports under the brim only.",
)
