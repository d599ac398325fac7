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
from fabcraft.errors import InputError
from fabcraft.geometry.implicit import met, slope, smooth_common, smooth_union
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
    skin_of,
    wall_mm,
)
from fabcraft.template.lining import Lining, Pad, covered_bounds, pad_gap_mm, resting
from fabcraft.template.template import MotifFrame, Parameter, StrapHole, Template

EDGE_MM, WALL_MM, ROOM_MM = 3.0, 2.5, 1.5
BAND_MM, OVER_GLABELLA_MM, TILT_DEG = 36.0, 28.0, 8.0
SHORT_BRIM_MM, LESS_TILT_DEG = 46.0, 3.0
"""A character's: its eyes are large and high up, and behind, a tilted band would stand over a flat head."""
BRIM_MM, SPREAD_DEG, OPEN_DEG = 62.0, 60.0, 60.0
REST_DEG = 45.0
"""Half the arc over which the band rests on the forehead."""
STRAP_FROM_END_MM, STRAP_WIDE_MM = 8.0, 3.0
"""Middle of an elastic's slot from the end of the band, and its width; not under half of that on small heads."""
PAD_MM = 15.0
"""Radius of the pads before the ears."""
_MOST_OVER, _MOST_LIFT = 0.7, 0.2
"""Of the head over the glabella that the band may take, and that it may go up for the brim to be free of the brows."""
_LEAST_SHARE = 0.3
"""Of its room that the inner side keeps everywhere."""
_BLUR_MM = 8.0
_FALL, _ARCH = 0.16, 0.3
"""Slope of the brim in its middle, and how much steeper it is at the side of the head."""
HALF_BREADTH_MM = 80.0
"""Of a median man's head."""
_OFF_BRIM_MM = 3.0
"""Distance of the brim from a face."""
_TAPER = 1.3
"""How the brim becomes shorter sideways: it is as long as (1 - (azimuth / spread)²) to this power."""
_OVER_PUPIL, _RISES = 0.8, -0.1
"""The brim ends this share of an eye's radius over its middle, or rises by this slope: it shades an eye, not covers it."""
_FLATTEST = -0.2
"""A brim that would have to rise more steeply than this has no place."""
_DEEPEST = 4.0
"""How far the inner side reaches in where it rests, over its room elsewhere."""
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
    round: float
    """Size of fillets and corners over a man's."""
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
        """Distance, about, beyond the outline of the brim, which runs out into the band at its sides."""
        radius = np.maximum(np.hypot(*(points - self.head.middle)[:, :2].T), 30.0 * self.head.scale)
        turn = self.head.azimuth(points) / self.spread
        left = np.maximum(1.0 - turn**2, 0.0)
        full = self.brim + 2.0 * self.wall
        steep = 2.0 * _TAPER * full * turn * left ** (_TAPER - 1.0) / (self.spread * radius)
        return (within + self.wall - full * left**_TAPER) / np.sqrt(1.0 + steep**2)

    def over_brim(self, points: Points, within: Float64[np.ndarray, " N"]) -> Float64[np.ndarray, " N"]:
        """Distance over the middle of the brim, which starts under the band and falls, most at its sides."""
        fall = self.fall + _sideways(self, points)
        low = -0.5 * self.band - _UNDER * self.wall
        return (self.height(points) - low + fall * np.maximum(within, 0.0)) / np.sqrt(1.0 + fall**2)

    def bent(self, points: Points, within: Float64[np.ndarray, " N"]) -> Float64[np.ndarray, " N"]:
        """Distance outward and upward from the middle of band and brim, for a distance `within` from the inner side."""
        fillet = _FILLET_MM * self.round
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
        within = self.lining.within(points)
        reaching = np.minimum(-self.lining.rest(points), within + _DEEPEST * self.lining.room)
        return -self.bent(points, reaching) - 0.5 * self.wall

    def beyond(self, points: Points) -> Float64[np.ndarray, " N"]:
        """How far points are past an edge; corners are round."""
        within, corner = self.lining.within(points), 2.0 * _CORNER_MM * self.round
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
    size = KIND.within("size", fitting_mm(head, chosen.get("size"), KIND.name))
    over = float(part.mesh.vertices[:, 2].max() - head.at["glabella"][2])  # little where a head is flat
    band = float(chosen.get("band", min(BAND_MM * s, _MOST_OVER * over)))
    long, tilted = (BRIM_MM, TILT_DEG) if part.kind != "character" else (SHORT_BRIM_MM, LESS_TILT_DEG)
    brim, tilt = float(chosen.get("brim", long * s)), np.radians(float(chosen.get("tilt", tilted)))
    axis = np.array([0.0, -np.sin(tilt), np.cos(tilt)])
    middle = head.at["glabella"] * [0.0, 1.0, 1.0] + min(OVER_GLABELLA_MM * s, 0.5 * _MOST_OVER * over) * _UP
    spread, open_ = (
        np.radians(float(chosen.get(*one))) for one in (("spread", SPREAD_DEG), ("open", OPEN_DEG))
    )

    # a wall that cannot be as thin as the head is small asks for rounder corners
    rounded = max(s, 0.5 * wall / WALL_MM)

    def placed(at: Float64[np.ndarray, "3"]) -> tuple[_Visor, Float64[np.ndarray, "2 3"]]:
        lining, bounds = _lining(head, at, axis, size, room, wall, band, brim)
        return _Visor(head, lining, at, axis, wall, band, brim, spread, 0.5 * open_, _FALL, rounded), bounds

    visor, bounds = placed(middle)
    lift = min(_in_the_way(visor), _MOST_LIFT * over)
    if lift > 0.0:
        visor, bounds = placed(middle + lift * _UP)
    visor = replace(visor, fall=_fall(visor))
    pads = _pads(visor)
    visor = replace(visor, pads=tuple(pads.values()))

    edge = max(EDGE_MM * s, 0.6 * wall)
    fields = visor.middle_of, visor.beyond, visor.outer, visor.inner, visor.rest, visor.resting
    sides = Wall(*fields, least_mm=wall)
    mesh, inside = walled(sides, bounds, edge, min(0.7 * edge, wall), mirrored=True, name=KIND.name)
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
        holds=not open_,
        mirrored=True,
        motifs=_motifs(visor),
        straps=_straps(visor),
        listed_mm=(pad_gap_mm(head)[0], room),
        parameters={"size": size, "fit": room, "wall": wall, "band": band, "brim": brim}
        | {
            "tilt": float(np.degrees(tilt)),
            "spread": float(np.degrees(spread)),
            "open": float(np.degrees(open_)),
        },
        notes=(f"The visor is for a head of {size:.0f} mm round, hat size {size / 10:.1f}.",),
    )


def _lining(
    head: Head,
    middle: Float64[np.ndarray, "3"],
    axis: Float64[np.ndarray, "3"],
    size: float,
    room: float,
    wall: float,
    band: float,
    brim: float,
) -> tuple[Lining, Float64[np.ndarray, "2 3"]]:
    """The inner side of a band whose middle is there, on a head of that size; and a box that holds band and brim."""
    s, mesh = head.scale, head.part.mesh
    worn = skin_of(mesh, (mesh.vertices - middle) @ axis > -0.5 * (band + wall))
    sized = head.sized(worn, size)
    # a character's band that followed the bevel of a flat head would be a bowl
    lower = np.abs((sized - middle) @ axis) < 0.5 * (band + wall)
    upright = sized[lower] + band * axis if head.part.kind == "character" else sized[:0]
    bounds = covered_bounds(np.concatenate([sized, upright]), axis, room + wall + 8.0 * s)
    bounds[0, 1:] -= [brim, 0.7 * brim]
    bounds += np.array([[-1.0], [1.0]]) * [0.4 * brim, 0.0, 0.0]
    gap = pad_gap_mm(head)[1]
    lining = Lining.around(worn, axis, room, gap, _BLUR_MM * s, bounds, _LEAST_SHARE, sized, upright)
    return lining, bounds


def _below(visor: _Visor) -> tuple[Points, Float64[np.ndarray, " N"], float]:
    """The skin under the brim, how far it is before the band, and the height that it has to stay under there."""
    skin = visor.head.part.mesh.vertices
    within = visor.lining.within(skin)
    below = (visor.past_brim(skin, within) < visor.wall) & (within > 0.5 * visor.wall)
    below &= visor.height(skin) < 0.5 * visor.band
    clear = 0.5 * visor.wall + visor.head.part.clearance_mm(_OFF_BRIM_MM)
    return skin[below], within[below], -0.5 * visor.band - _UNDER * visor.wall - clear


def _sideways(visor: _Visor, points: Points) -> Float64[np.ndarray, " N"]:
    """How much steeper than in its middle the brim is."""
    return _ARCH * (points[:, 0] / (HALF_BREADTH_MM * visor.head.scale)) ** 2


def _in_the_way(visor: _Visor) -> float:
    """How far the visor would have to go up for brow and snout to be free of its brim, mm."""
    skin, within, most = _below(visor)
    return float(
        (visor.height(skin) - most + (visor.fall + _sideways(visor, skin)) * within).max(initial=0.0)
    )


def _fall(visor: _Visor) -> float:
    """The usual slope of the brim, or less where it would hang before the eyes, or a brow or a snout stands in its way.

    Raises `InputError` where it would have to stand up.
    """
    skin, within, most = _below(visor)
    usual = min(_FALL, max(_in_sight(visor), _RISES))
    fall = float(((most - visor.height(skin)) / within - _sideways(visor, skin)).min(initial=usual))
    if fall < _FLATTEST:
        raise InputError(
            f"the brow or snout of the {visor.head.part.name} stands in the way of a brim of {visor.brim:.0f} mm",
            "Ask for a shorter or narrower one (--set brim=..., --set spread=...), or choose another template.",
        )
    return fall


def _in_sight(visor: _Visor) -> float:
    """The slope with which the brim ends over the eyes, as one sees it who looks straight ahead."""
    part, eye = visor.head.part, visor.head.at["eye_left"]
    if "eye_left" not in part.regions:
        return _FALL
    around = part.mesh.vertices[part.regions["eye_left"].vertex_indices] - eye
    top = float(visor.height(eye[None])[0]) + _OVER_PUPIL * float(np.linalg.norm(around, axis=1).max())
    root = -0.5 * visor.band - (_UNDER + 0.5) * visor.wall
    return (root - top) / visor.brim - float(_sideways(visor, eye[None])[0])


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


def _straps(visor: _Visor) -> tuple[StrapHole, ...]:
    """A slot near either end of an open band, for an elastic as wide as two thirds of the band."""
    if not visor.open:
        return ()
    head, size = visor.head, max(visor.head.scale, 0.5)
    found = []
    for side in (-1.0, 1.0):
        turn = np.pi - visor.open
        for _ in range(2):  # the azimuth of a place that is so far from the end of the band
            way = np.array([side * np.sin(turn), -np.cos(turn), 0.0])
            way -= (way @ visor.axis) * visor.axis
            start = head.middle + ((visor.middle - head.middle) @ visor.axis) * visor.axis
            place = met(visor.middle_of, start, way / np.linalg.norm(way), 200.0 * head.scale)
            radius = float(np.hypot(*(place - head.middle)[:2]))
            turn = np.pi - visor.open - STRAP_FROM_END_MM * size / radius
        out = slope(visor.middle_of, place[None], 0.2 * head.scale)[0]
        along = visor.axis - (visor.axis @ out) / (out @ out) * out
        found.append(
            StrapHole(
                place,
                along / np.linalg.norm(along),
                out / np.linalg.norm(out),
                2.0 / 3.0 * visor.band,
                STRAP_WIDE_MM * size,
                3.0 * visor.wall + 2.0 * visor.lining.room,
            )
        )
    return tuple(found)


def _motifs(visor: _Visor) -> tuple[MotifFrame, ...]:
    """Before the band, rolled around the head: for a motif, and for a drawn crown that rises from the band."""
    head, s = visor.head, visor.head.scale
    centre = head.middle - ((head.middle - visor.middle) @ visor.axis) * visor.axis
    ahead = np.cross(visor.axis, _LEFT)
    origin = met(visor.outer, centre + 0.15 * visor.band * visor.axis, -ahead, 300.0 * s)
    front = MotifFrame(
        "front", origin, _LEFT, visor.axis, (2.2 * visor.band, visor.band), 60.0 * s, (centre, visor.axis)
    )
    crown = replace(
        front,
        name="crown",
        origin=origin + 0.55 * visor.band * visor.axis,
        size_mm=(4.4 * visor.band, 2.1 * visor.band),
        depth_mm=visor.wall + 1.0,
        follows=True,
    )
    return front, crown


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
