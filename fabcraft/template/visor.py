"""The visor: a band round the head over brows and ears, and a brim in front; open behind for an elastic, or closed.

Numbers (mm, on a head 200 long): the band's middle 28 over the glabella, 36 high, tilted 8 degrees down in front; brim 62
long over 60 degrees to either side; 60 degrees open behind; room 1.5, nothing on the forehead and before the ears;
wall 2.5.  Conventions of makers.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64

from fabcraft.body.body import Body
from fabcraft.body.region import Region
from fabcraft.geometry.implicit import met, smooth_common, smooth_union
from fabcraft.geometry.walled import Wall, walled
from fabcraft.mesh import Mesh
from fabcraft.template.catalogue import Kind, Settings
from fabcraft.template.headwear import (
    LANDMARKS,
    Head,
    Points,
    fitting_mm,
    head_of,
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
PAD_MM = 15.0
"""Radius of the pads before the ears."""
_MOST_OVER = 0.7
"""Of the head over the glabella that the band may take."""
_BLUR_MM = 8.0
_FALL, _ARCH = 0.16, 0.45
"""Slope of the brim in its middle, and how much steeper it is at the side of the head."""
HALF_BREADTH_MM = 80.0
"""Of a median man's head."""
_OFF_BRIM_MM = 3.0
"""Distance of the brim from a face."""
_ROUNDED = 2.2
"""Exponent of the brim's outline; 2 is an ellipse."""
_FILLET_MM, _CORNER_MM = 12.0, 9.0
_UNDER = 1.2
"""How far the brim starts under the band, in walls."""
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
    fall: float
    """Slope of the brim in its middle."""
    pads: tuple[Pad, ...] = ()

    def height(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Over the middle of the band, along the axis."""
        return (points - self.middle) @ self.axis

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
        across, along = (
            (turn / size) ** (_ROUNDED - 1.0) / (self.spread * radius),
            (out / size) ** (_ROUNDED - 1.0) / self.brim,
        )
        return (size - 1.0) / np.maximum(np.hypot(across, along), 0.1 / self.brim)

    def over_brim(self, points: Points, within: Float64[np.ndarray, " N"]) -> Float64[np.ndarray, " N"]:
        """Distance over the middle of the brim, which starts under the band and falls, most at its sides."""
        sideways = (points[:, 0] / (HALF_BREADTH_MM * self.head.scale)) ** 2
        fall = self.fall + _ARCH * sideways
        low = -0.5 * self.band - _UNDER * self.wall
        return (self.height(points) - low + fall * np.maximum(within, 0.0)) / np.sqrt(1.0 + fall**2)

    def bent(self, points: Points, within: Float64[np.ndarray, " N"]) -> Float64[np.ndarray, " N"]:
        """Distance outward and upward from the middle of band and brim, for a distance `within` from the inner side."""
        fillet = _FILLET_MM * self.head.scale
        return smooth_union(within - 0.5 * self.wall, self.over_brim(points, within), fillet)

    def middle_of(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Distance outward and upward from the middle of the wall."""
        return self.bent(points, self.lining.within(points))

    def outer(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Distance outward from the outer side."""
        return self.middle_of(points) - 0.5 * self.wall

    def inner(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Distance inward from the inner side, where it does not rest."""
        return -self.middle_of(points) - 0.5 * self.wall

    def rest(self, points: Points) -> Float64[np.ndarray, " N"]:
        """The same where it rests."""
        return -self.bent(points, -self.lining.rest(points)) - 0.5 * self.wall

    def beyond(self, points: Points) -> Float64[np.ndarray, " N"]:
        """How far points are past an edge; corners are round."""
        within, corner = self.lining.within(points), 2.0 * _CORNER_MM * self.head.scale
        below = smooth_union(
            self.past_brim(points, within), _UNDER * self.wall - self.over_brim(points, within), 0.5 * corner
        )
        above = self.height(points) - 0.5 * self.band
        if self.open:
            radius = np.hypot(*(points - self.head.middle)[:, :2].T)
            behind = radius * (self.head.azimuth(points) - (np.pi - self.open))
            above = smooth_common(above, behind, corner)
        return smooth_common(above, below, min(corner, self.band))


def build(body: Body, settings: Settings) -> Template:
    """The visor for `body`.  Raises `InputError` for a body without a free forehead and for a size that is too small."""
    chosen = KIND.settled(settings)
    head = head_of(*KIND.worn(body, "head", LANDMARKS))
    part, s = head.part, head.scale
    wall = wall_mm(head, chosen, WALL_MM)
    room = float(chosen.get("fit", part.clearance_mm(ROOM_MM)))
    size = fitting_mm(head, chosen.get("size"), KIND.name)
    over = float(part.mesh.vertices[:, 2].max() - head.at["glabella"][2])  # little where a head is flat
    band = float(chosen.get("band", min(BAND_MM * s, _MOST_OVER * over)))
    brim = float(chosen.get("brim", BRIM_MM * s))
    tilt = np.radians(float(chosen.get("tilt", TILT_DEG)))
    axis = np.array([0.0, -np.sin(tilt), np.cos(tilt)])
    middle = head.at["glabella"] * [0.0, 1.0, 1.0] + min(OVER_GLABELLA_MM * s, 0.5 * _MOST_OVER * over) * _UP
    spread, open_ = (
        np.radians(float(chosen.get(*one))) for one in (("spread", SPREAD_DEG), ("open", OPEN_DEG))
    )

    worn = part.mesh.vertices[(part.mesh.vertices - middle) @ axis > -0.5 * (band + wall)]
    sized = head.sized(worn, size)
    bounds = covered_bounds(sized, axis, room + wall + 8.0 * s)
    bounds[0, 1:] -= [brim, 0.7 * brim]
    bounds[:, 0] += np.array([-0.7, 0.7]) * brim
    promised, gap = pad_gap_mm(head)
    lining = Lining.around(worn, axis, room, gap, _BLUR_MM * s, bounds, 0.3, sized, sized[:0])
    visor = _Visor(head, lining, middle, axis, wall, band, brim, spread, 0.5 * open_, _FALL)
    pads = _pads(visor)
    visor = replace(visor, pads=tuple(pads.values()), fall=_fall(visor))

    edge = EDGE_MM * s
    sides = Wall(
        visor.middle_of,
        visor.beyond,
        visor.outer,
        visor.inner,
        rest=visor.rest,
        resting=visor.resting,
        least_mm=wall,
    )
    mesh, inside = walled(sides, bounds, edge, min(0.6 * edge, wall), mirrored=True, name=KIND.name)
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
        locked=inside & _on_band(visor, mesh),
        mirrored=True,
        motifs=(_front(visor),),
        listed_mm=(promised, room),
        parameters={"size": size, "fit": room, "wall": wall, "band": band, "brim": brim}
        | {
            "tilt": float(np.degrees(tilt)),
            "spread": float(np.degrees(spread)),
            "open": float(np.degrees(open_)),
        },
        notes=(f"The visor is for a head of {size:.0f} mm round, hat size {size / 10:.1f}.",),
    )


def _fall(visor: _Visor) -> float:
    """The usual slope of the brim, or less where a brow or a snout stands in its way."""
    skin = visor.head.part.mesh.vertices
    within = visor.lining.within(skin)
    low = -0.5 * visor.band - _UNDER * visor.wall
    clear = 0.5 * visor.wall + visor.head.part.clearance_mm(_OFF_BRIM_MM)
    below = (visor.past_brim(skin, within) < visor.wall) & (within > 0.5 * visor.wall)
    below &= visor.height(skin) < 0.5 * visor.band
    if not below.any():
        return _FALL
    sideways = (skin[below, 0] / (HALF_BREADTH_MM * visor.head.scale)) ** 2
    most = (low - clear - visor.height(skin[below])) / within[below] - _ARCH * sideways
    return float(min(_FALL, most.min()))


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
        near = int(
            (np.linalg.norm(vertices - middle, axis=1) + 1e3 * (np.abs(height) > 0.25 * visor.band)).argmin()
        )
        if visor.lining.reaches(vertices[near], PAD_MM * s, s):
            pads[name] = Pad(vertices[near], normals[near], PAD_MM * s)
    return pads


def _on_band(visor: _Visor, mesh: Mesh) -> Bool[np.ndarray, " F"]:
    """Faces at the height of the band."""
    return visor.height(mesh.corners.mean(1)) > -0.5 * visor.band


def _forehead(visor: _Visor) -> dict[str, Region]:
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
    origin = met(visor.outer, centre + 0.15 * visor.band * visor.axis, -ahead, 300.0 * s)
    return MotifFrame(
        "front", origin, _LEFT, visor.axis, (2.2 * visor.band, visor.band), 60.0 * s, (centre, visor.axis)
    )


KIND = Kind(
    "visor",
    build,
    (
        Parameter(
            "size", "mm", 120.0, 750.0, "circumference of the head, or a hat size (M, hat57, US 7 1/8)"
        ),
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
