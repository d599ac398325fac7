"""Where the front of glasses stands before a face: as far off as brow, nose and cheeks ask, cut out for the nose.

The front is a plate in a picture plane, tilted (pantoscopic) and rolled round a standing axis (wrap).  Its back stands 13 mm
before the corneas, or as much farther as it has to, and it is wide enough for straight temples.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64
from scipy.ndimage import gaussian_filter1d

from fabcraft.body.body import Body
from fabcraft.errors import InputError
from fabcraft.geometry.contour import inside
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.oval import SAMPLES, Oval
from fabcraft.template.lenses import FrontSizes, Outline, blank, lens_outline
from fabcraft.template.rolled import Rolled
from fabcraft.template.temples import Temple, Way

PD_MM = 64.0
"""Median man's distance of the pupils, which the listed lengths belong to."""
RIM_MM, FRONT_MM, TEMPLE_MM, LEAST_MM = 3.5, 4.0, (3.0, 5.0), 1.6
VERTEX_MM, BROW_MM, NOSE_MM, CHEEK_MM, HEAD_MM, EAR_MM, PAD_MM = 13.0, 3.0, 0.5, 1.0, 1.0, 0.15, 0.1
"""Least distances to the skin: of the front to cornea, brow, nose and cheek; of temples to head and ear; of pads."""
_BELOW_PUPIL_MM = 2.5
_WIDER_MM = 3.0
"""The lenses' middles are that much farther apart than the pupils: an optician's allowance."""
_END_MM = 5.0
"""Most that the end pieces grow to meet the temples."""
_NASAL = 0.9
"""Least width of a rim beside the nose, as a share of the rim."""
_HEIGHTS: Mapping[str, float] = {"panto": 0.76, "round": 0.95, "square": 0.72, "cat-eye": 0.72}
"""B over A where nothing else is asked."""


@dataclass(frozen=True, eq=False)
class Face:
    """Who wears the glasses."""

    part: Body
    at: Mapping[str, Float64[np.ndarray, "3"]]
    skin: SurfaceDistance
    points: Float64[np.ndarray, "P 3"]
    """The skin of the face's left half, densely."""
    pd: float
    scale: float
    """Of the face over a median man's."""

    @property
    def temple_mm(self) -> tuple[float, float]:
        """Thickness and height of a temple, of a person's proportions."""
        thickness = self.least(TEMPLE_MM[0])
        return thickness, thickness * TEMPLE_MM[1] / TEMPLE_MM[0]

    def least(self, person_mm: float) -> float:
        """A person's wall or rim: as it is for people, smaller for small characters."""
        return person_mm if self.part.kind != "character" else max(LEAST_MM, person_mm * self.scale)


@dataclass(frozen=True, eq=False)
class Front:
    """The front where it is worn."""

    rolled: Rolled
    """Its outer face at w = 0."""
    sizes: FrontSizes
    lens: Outline
    outline: Outline
    """The left half's outer border."""
    thick: float

    @property
    def unit(self) -> float:
        """Size of its section over a person's: roundings and edges go with it."""
        return min(self.sizes.rim / RIM_MM, self.thick / FRONT_MM)

    def world(self, u: float, v: float, w: float) -> Float64[np.ndarray, "3"]:
        """A place of the front, mm."""
        return self.rolled.world(np.array([[u, v, w]]))[0]


def front_of(face: Face, chosen: Mapping[str, float | str]) -> Front:
    """The front at the distance that the face asks for, wide enough for straight temples."""
    k, pd = face.scale, face.pd
    adult = float(np.clip(18.0 + (pd - PD_MM) * 4.0 / 9.0, 13.0, 20.0))
    bridge = float(chosen.get("bridge", adult if face.part.kind != "character" else 18.0 * k))
    width = float(chosen.get("lens_width", pd - bridge + _WIDER_MM * k))
    height = float(chosen.get("lens_height", _HEIGHTS[str(chosen.get("shape", "panto"))] * width))
    rim = float(chosen.get("rim", face.least(RIM_MM)))
    end = 1.9 * face.temple_mm[1]
    half = 0.5 * bridge + width + rim + 4.0 * k
    sizes = FrontSizes(width, height, bridge, rim, half, end)
    lens = lens_outline(str(chosen.get("shape", "panto")), sizes)
    thick = float(chosen.get("thickness", face.least(FRONT_MM)))
    tilt, wrap = float(chosen.get("tilt", 8.0)), float(chosen.get("wrap", 5.0))
    front = Front(_standing(face, sizes, thick, tilt, wrap), sizes, lens, lens, thick)
    front = _before_the_face(face, front)
    way = way_of(face)
    short = float(np.clip(way.short(temple_start(front, way.thickness)), 0.0, _END_MM * k))
    return _before_the_face(face, replace(front, sizes=replace(front.sizes, half_width=half + short)))


def _standing(face: Face, sizes: FrontSizes, thick: float, tilt_deg: float, wrap_deg: float) -> Rolled:
    """The rolled plane of the front, its back `VERTEX_MM` before the corneas."""
    tilt, wrap = np.radians([tilt_deg, max(wrap_deg, 0.1)])
    radius = sizes.lens_middle / np.sin(wrap)
    up, out = np.array([0.0, -np.sin(tilt), np.cos(tilt)]), np.array([0.0, -np.cos(tilt), -np.sin(tilt)])
    eye = face.at["eye_left"]
    middle = np.array([0.0, eye[1], eye[2] - _BELOW_PUPIL_MM * face.scale])
    rolled = Rolled(
        middle - radius * out, np.stack([np.cross(out, up), out, up]), Oval(np.full(SAMPLES, radius))
    )
    vertices = face.part.mesh.vertices
    around = np.hypot(vertices[:, 0] - eye[0], vertices[:, 2] - eye[2]) < 5.0 * face.scale
    cornea = float(vertices[around, 1].min()) if around.any() else float(eye[1])
    back = rolled.world(np.array([[eye[0], _BELOW_PUPIL_MM * face.scale, -thick]]))[0, 1]
    return _forward(rolled, float(back) - (cornea - VERTEX_MM * face.scale))


def _forward(rolled: Rolled, by_mm: float) -> Rolled:
    return Rolled(rolled.origin - np.array([0.0, by_mm, 0.0]), rolled.axes, rolled.oval)


def _before_the_face(face: Face, front: Front) -> Front:
    """The outline cut out for the nose, and the front moved forward until it keeps its distances."""
    k, sizes, clear = face.scale, front.sizes, face.part.clearance_mm
    rolled, drawn = front.rolled, blank(front.lens, sizes)
    for _ in range(60):
        flat = rolled.flat(face.points)
        nose = _nose(flat, front, clear(NOSE_MM))
        outline = drawn.outline(nose)
        u, v, w = flat.T
        room = np.full(len(u), clear(CHEEK_MM))
        room[(v > 0.15 * sizes.lens_height) & (u > 0.5 * sizes.bridge)] = clear(BROW_MM)
        room[u < 0.5 * sizes.bridge + sizes.rim] = clear(NOSE_MM)
        front = replace(front, rolled=rolled, outline=outline)
        missing = w + front.thick + room
        boxed = (flat[:, :2] >= outline.min(0)) & (flat[:, :2] <= outline.max(0))
        near = np.flatnonzero((missing > 0.0) & boxed.all(1))
        near = near[inside(flat[near, :2], [np.append(outline, outline[:1], axis=0)])]
        near = near[~inside(flat[near, :2], [front.lens])]
        short = float(missing[near].max(initial=0.0))
        step = max(short, 0.6 * k if _rim_left(front.lens, nose) < _NASAL * sizes.rim else 0.0)
        if step <= 0.02:
            break
        rolled = _forward(rolled, step)
    return front


def _nose(flat: Float64[np.ndarray, "P 3"], front: Front, room: float) -> Float64[np.ndarray, "M 2"]:
    """Rows (v, u): how wide the nose is where it passes through the front, with its clearance."""
    sizes = front.sizes
    u, v, w = flat.T
    near = (w > -front.thick - room) & (u >= 0.0) & (u < sizes.lens_middle) & (v < 0.5 * sizes.lens_height)
    if not near.any():
        return np.zeros((0, 2))
    low = -0.5 * sizes.lens_height - 3.0 * sizes.rim
    steps = np.arange(low, float(v[near].max()) + 1e-6, 0.35 * sizes.rim)
    if len(steps) < 3:
        return np.zeros((0, 2))
    row = np.clip(np.searchsorted(steps, v[near]) - 1, 0, len(steps) - 1)
    widest = np.zeros(len(steps))
    np.maximum.at(widest, row, u[near])
    widest = np.maximum.accumulate(widest[::-1])[::-1]  # an arch does not close below
    return np.stack([steps, gaussian_filter1d(widest, 1.0, mode="nearest") + room], 1)


def _rim_left(lens: Outline, nose: Float64[np.ndarray, "M 2"]) -> float:
    """Least distance from the nose's cut to the lens, mm."""
    if len(nose) == 0:
        return np.inf
    width = np.interp(lens[:, 1], nose[:, 0], nose[:, 1], right=-np.inf)
    return float((lens[:, 0] - width).min())


def temple_start(front: Front, thickness: float) -> Float64[np.ndarray, "3"]:
    """Where the temple's middle line begins, inside the end piece."""
    inset = 0.5 * thickness + 0.13 * front.sizes.end_piece
    return front.world(front.sizes.half_width - inset, front.sizes.hinge_height, -0.6 * front.thick)


def groove_depth(front: Front, chosen: Mapping[str, float | str]) -> float:
    """Depth of the groove for lenses, 0 for none.  Raises `InputError` where the rim has no room for it."""
    groove = float(chosen.get("groove", 0.0))
    deepest = min(front.sizes.rim - LEAST_MM, 0.5 * front.thick - 0.8 * front.unit)
    if groove > deepest:
        raise InputError(
            f"a groove of {groove:g} mm does not fit into a rim of {front.sizes.rim:g} x {front.thick:g} mm",
            f"Choose a groove of at most {max(deepest, 0.0):.2f} mm, or a wider rim or a thicker front.",
        )
    return groove


def way_of(face: Face, flare: float = 1.3) -> Way:
    """Where the left temple has to pass."""
    thickness, height = face.temple_mm
    clear = face.part.clearance_mm
    root = face.at["ear_root_top_left"]
    return Way(root, thickness, height, clear(HEAD_MM), clear(EAR_MM), face.skin, face.scale, flare)


def behind_front(front: Front, side: Temple) -> float:
    """How much of the temple's line lies before the back of the front, over the temple's whole height, mm."""
    _, up, _ = side.frames()
    edges = [side.line + sign * side.half_height[:, None] * up for sign in (-1.0, 0.0, 1.0)]
    within = np.stack([front.rolled.flat(one)[:, 2] > -front.thick for one in edges]).any(0)
    steps = np.linalg.norm(np.diff(side.line, axis=0), axis=1)
    return float(steps[: np.flatnonzero(within).max(initial=0)].sum())
