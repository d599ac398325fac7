"""Glasses: a front with two lens openings before the eyes, temples over the ears, pads on the nose.

The front is a plate in a picture plane, tilted (pantoscopic) and rolled round a standing axis (wrap); its back stands 13 mm
before the corneas, or as far as brow, nose and cheeks ask.  A = PD - DBL, B = 0.72 A, DBL 18 mm for adults; "52-18-140"
names A, DBL and the length of the temples.  Everything is symmetric to x = 0: the left half is made and reflected.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64
from scipy.ndimage import gaussian_filter1d

from fabcraft.body.body import Body, fan_closed
from fabcraft.errors import InputError
from fabcraft.geometry.contour import inside
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.isotropic import reflected
from fabcraft.geometry.oval import SAMPLES, Oval
from fabcraft.mesh import Mesh
from fabcraft.template.catalogue import Kind, Settings
from fabcraft.template.lenses import SHAPES, FrontSizes, Outline, blank, lens_outline
from fabcraft.template.melt import melted
from fabcraft.template.nose_pad import rounded_block
from fabcraft.template.plate import Rim, plate
from fabcraft.template.rolled import Rolled
from fabcraft.template.template import DonningPath, MotifFrame, Parameter, Template
from fabcraft.template.temples import Temple, Way, temple
from fabcraft.template.whole import PROUD_MM

EDGE_MM = 1.4
PD_MM = 64.0
"""Median man's distance of the pupils, which the listed lengths belong to."""
RIM_MM, FRONT_MM, TEMPLE_MM, LEAST_MM = 3.5, 4.0, (3.0, 5.0), 1.6
VERTEX_MM, BROW_MM, NOSE_MM, CHEEK_MM, HEAD_MM, EAR_MM, PAD_MM = 13.0, 3.0, 0.5, 1.0, 1.0, 0.15, 0.1
"""Least distances to the skin: of the front to cornea, brow, nose and cheek; of temples to head and ear; of pads."""
SPREAD_MM = 10.0
"""How far each temple may be spread to put them on."""
_BELOW_PUPIL_MM = 2.5
_DROP_MM = 38.0
_WIDER_MM = 3.0
"""The lenses' middles are that much farther apart than the pupils: an optician's allowance."""
_END_MM = 5.0
"""Most that the end pieces grow to meet the temples."""
_NASAL = 0.9
"""Least width of a rim beside the nose, as a share of the rim."""
_POSES = 40
_PLACES = ("sellion", "eye_left", "eye_right", "ear_root_top_left")


@dataclass(frozen=True, eq=False)
class _Face:
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
class _Front:
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


def build(body: Body, settings: Settings) -> Template:
    """Glasses for `body`.  Raises `InputError` for a body without a nose or ears to rest on, and for a size without room."""
    chosen = _named(KIND.settled(settings))
    face = _face(body)
    front = _front(face, chosen)
    groove = _groove(front, chosen)
    drop = _DROP_MM * face.scale
    way = _way(face)
    hinge = _hinge(front, way.thickness)
    side = temple(hinge, way, drop)
    if "temple_length" in chosen:
        drop += float(chosen["temple_length"]) - side.length
        if not 15.0 * face.scale <= drop <= 75.0 * face.scale:
            shortest, longest = (side.length + d * face.scale - _DROP_MM * face.scale for d in (15.0, 75.0))
            raise InputError(
                f"temples of {chosen['temple_length']} mm do not reach round this ear, or too far",
                f"Choose {np.ceil(shortest):.0f} to {np.floor(longest):.0f} mm.",
            )
        side = temple(hinge, way, drop)
    edge = EDGE_MM * (1.0 if face.part.kind != "character" else float(np.clip(face.scale, 0.3, 1.0)))
    edge = min(edge, EDGE_MM * front.unit)
    mesh = _assembled(face, front, side, groove, edge)
    spread = SPREAD_MM * face.scale
    path = np.tile(np.eye(4), (_POSES, 1, 1))
    travel = float(mesh.vertices[:, 1].max() - face.part.mesh.vertices[:, 1].min()) + 10.0 * face.scale
    path[:, 1, 3] = -travel * np.linspace(0.0, 1.0, _POSES) ** 1.4
    sizes = front.sizes
    return Template(
        name=KIND.name,
        body=face.part,
        mesh=mesh,
        rims=(),
        surface=None,
        wall_mm=min(sizes.rim - groove, front.thick, side.thickness),
        genus=2,
        contacts=tuple(
            f"{name}_{s}"
            for name in ("nose_flank", "ear_root")
            for s in ("left", "right")
            if f"{name}_{s}" in face.part.regions
        ),
        edge_mm=edge,
        path=DonningPath(path, spread, f"each temple spreads by {spread:.0f} mm"),
        locked=_behind(mesh, front),
        mirrored=True,
        motifs=_frames(front, face.scale),
        listed_mm=(0.0, face.part.clearance_mm(HEAD_MM)),
        parameters={
            "lens_width": sizes.lens_width,
            "lens_height": sizes.lens_height,
            "bridge": sizes.bridge,
            "rim": sizes.rim,
            "thickness": front.thick,
            "temple_length": side.length,
            "groove": groove,
        },
        notes=(
            f"{sizes.lens_width:.0f}-{sizes.bridge:.0f}-{side.length:.0f}, {2.0 * sizes.half_width:.0f} mm wide.",
        ),
    )


def _named(chosen: Mapping[str, float | str]) -> dict[str, float | str]:
    """The settings with a size such as "52-18-140" taken apart; what was set besides stays."""
    size = chosen.get("size")
    if size is None:
        return dict(chosen)
    match = re.fullmatch(r"(\d{2})[-□ ]+(\d{2})[-□ ]+(\d{2,3})", str(size).strip())
    if match is None:
        raise InputError(
            f"there is no size of glasses '{size}'", 'Write lens, bridge and temple, as in "52-18-140".'
        )
    named = dict(zip(("lens_width", "bridge", "temple_length"), map(float, match.groups()), strict=True))
    return {**KIND.settled(named), **chosen}


def _face(body: Body) -> _Face:
    part, at = KIND.worn(body, "head", _PLACES)
    pd = float(np.linalg.norm(at["eye_left"] - at["eye_right"]))
    scale = part.scale if part.kind == "character" else pd / PD_MM
    corners = part.mesh.corners
    near = (corners[:, :, 1].min(1) < at["ear_root_top_left"][1]) & (corners[:, :, 0].max(1) > -1.0)
    corners = corners[near & (np.abs(corners[:, :, 2].mean(1) - at["sellion"][2]) < 70.0 * scale)]
    points = np.concatenate(
        [corners.reshape(-1, 3), corners.mean(1), 0.5 * (corners + np.roll(corners, 1, 1)).reshape(-1, 3)]
    )
    return _Face(part, at, SurfaceDistance(part.mesh), np.unique(points, axis=0), pd, scale)


def _front(face: _Face, chosen: Mapping[str, float | str]) -> _Front:
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
    front = _Front(_standing(face, sizes, thick, tilt, wrap), sizes, lens, lens, thick)
    front = _before_the_face(face, front)
    way = _way(face)
    short = float(np.clip(way.short(_hinge(front, way.thickness)), 0.0, _END_MM * k))
    return _before_the_face(face, replace(front, sizes=replace(front.sizes, half_width=half + short)))


def _standing(face: _Face, sizes: FrontSizes, thick: float, tilt_deg: float, wrap_deg: float) -> Rolled:
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


def _before_the_face(face: _Face, front: _Front) -> _Front:
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
        material = inside(flat[:, :2], [np.append(outline, outline[:1], axis=0)]) & ~inside(
            flat[:, :2], [front.lens]
        )
        short = float((w + front.thick + room)[material].max(initial=-1.0))
        step = max(short, 0.6 * k if _rim_left(front.lens, nose) < _NASAL * sizes.rim else 0.0)
        if step <= 0.02:
            break
        rolled = _forward(rolled, step)
    return front


def _nose(flat: Float64[np.ndarray, "P 3"], front: _Front, room: float) -> Float64[np.ndarray, "M 2"]:
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


def _hinge(front: _Front, thickness: float) -> Float64[np.ndarray, "3"]:
    """Where the temple's middle line begins, inside the end piece."""
    inset = 0.5 * thickness + 0.13 * front.sizes.end_piece
    return front.world(front.sizes.half_width - inset, front.sizes.hinge_height, -0.6 * front.thick)


def _groove(front: _Front, chosen: Mapping[str, float | str]) -> float:
    """Depth of the groove for lenses, 0 for none.  Raises `InputError` where the rim has no room for it."""
    groove = float(chosen.get("groove", 0.0))
    deepest = min(front.sizes.rim - LEAST_MM, 0.5 * front.thick - 0.8 * front.unit)
    if groove > deepest:
        raise InputError(
            f"a groove of {groove:g} mm does not fit into a rim of {front.sizes.rim:g} x {front.thick:g} mm",
            f"Choose a groove of at most {max(deepest, 0.0):.2f} mm, or a wider rim or a thicker front.",
        )
    return groove


def _way(face: _Face) -> Way:
    thickness, height = face.temple_mm
    clear = face.part.clearance_mm
    root = face.at["ear_root_top_left"]
    return Way(root, thickness, height, clear(HEAD_MM), clear(EAR_MM), face.skin, face.scale)


def _assembled(face: _Face, front: _Front, side: Temple, groove: float, edge: float) -> Mesh:
    """The left half of the front with its temple and pad, and its mirror image."""
    unit = front.unit
    rims = [Rim(0.8 * unit, 1.2 * unit), Rim(0.6 * unit, 0.6 * unit, groove)]
    flat = plate([front.outline, front.lens], front.thick, rims, edge, half=True)
    places = front.rolled.world(flat.points - [0.0, 0.0, front.thick])
    places[np.abs(flat.points[:, 0]) < 1e-9, 0] = 0.0
    solid = fan_closed(Mesh(places, flat.faces, KIND.name))
    solid = melted(solid, side.mesh(edge), 1.8 * unit, edge, KIND.name, half=True)
    solid = melted(solid, _pad(face, front, edge), 1.6 * unit, edge, KIND.name, half=True)
    cut = (np.abs(solid.corners[:, :, 0]) < 1e-7).all(1)
    return reflected(solid.submesh(~cut), 1e-6)


def _pad(face: _Face, front: _Front, edge: float) -> Mesh:
    """The left pad: a rounded block from the back of the rim to the flank of the nose, shaped by the skin."""
    k, unit = face.scale, front.unit
    room = face.part.clearance_mm(PAD_MM)
    region = face.part.regions["nose_flank_left"]
    centre = face.part.mesh.vertices[region.vertex_indices].mean(0)
    found = face.skin.closest(
        centre + k * np.array([[0.0, 0.0, 4.0], [0.8, 1.2, 0.0], [0.5, 0.5, -5.0], [0.5, -0.8, 0.0]])
    )
    normal = face.part.mesh.face_normals[found.faces]
    radius = 1.7 * unit
    touching = found.points + (radius + room) * normal
    v = front.rolled.flat(centre[None])[0, 1]
    nasal = front.lens[front.lens[:, 0] < front.sizes.lens_middle]
    held = []
    for height in (v + 4.0 * k, v - 2.0 * k):
        lens_u = float(np.interp(height, *nasal[np.argsort(nasal[:, 1])].T[::-1]))
        held.append(front.world(lens_u - 0.5 * front.sizes.rim, height, -0.75 * front.thick))
    return rounded_block(np.concatenate([touching, np.stack(held)]), radius, face.skin, room, 0.7 * edge)


def _behind(mesh: Mesh, front: _Front) -> Bool[np.ndarray, " F"]:
    """Faces of temples and pads: what is behind the front's back."""
    centres = mesh.corners.mean(1)
    centres[:, 0] = np.abs(centres[:, 0])
    return front.rolled.flat(centres)[:, 2] < -front.thick - 0.05 * front.sizes.rim


def _frames(front: _Front, scale: float) -> tuple[MotifFrame, ...]:
    """The brow above the bridge for a motif; the whole front with its lens openings, to be drawn."""
    sizes = front.sizes
    up = front.rolled.axes[2]
    right = np.array([1.0, 0.0, 0.0])
    low, high = front.outline[:, 1].min(), front.outline[:, 1].max()
    middle = 0.5 * (low + high)
    lenses = (front.lens * [-1.0, 1.0] - [0.0, middle], front.lens - [0.0, middle])
    axis = (front.rolled.origin, up)
    whole = MotifFrame(
        "front",
        front.world(0.0, float(middle), PROUD_MM),
        right,
        up,
        (2.0 * sizes.half_width, float(high - low)),
        12.0 * scale,
        axis,
        lenses,
        depth_mm=front.thick + 2.0 * PROUD_MM,
    )
    top = float(front.outline[-1, 1])
    brow = MotifFrame(
        "brow",
        front.world(0.0, top, 0.0),
        right,
        up,
        (0.9 * sizes.half_width, 0.5 * sizes.lens_height),
        15.0 * scale,
        axis,
    )
    return brow, whole


_HEIGHTS: Mapping[str, float] = {"panto": 0.76, "round": 0.95, "square": 0.72, "cat-eye": 0.72}
"""B over A where nothing else is asked."""

KIND = Kind(
    "glasses",
    build,
    (
        Parameter("size", "", 0.0, 0.0, 'lens, bridge and temple as printed inside, "52-18-140"'),
        Parameter("shape", "", 0.0, 0.0, "of the lenses", tuple(SHAPES)),
        Parameter("lens_width", "mm", 10.0, 75.0, "of the box round a lens (A)"),
        Parameter("lens_height", "mm", 8.0, 70.0, "of the box round a lens (B)"),
        Parameter("bridge", "mm", 4.0, 30.0, "between the boxes (DBL)"),
        Parameter("rim", "mm", 1.6, 10.0, "width round the lenses"),
        Parameter("thickness", "mm", 1.6, 8.0, "of the front"),
        Parameter("temple_length", "mm", 30.0, 180.0, "from the hinge round the ear to the tip (TL)"),
        Parameter("tilt", "deg", 0.0, 20.0, "pantoscopic: the lower rim nearer to the cheeks"),
        Parameter("wrap", "deg", 0.0, 20.0, "of each lens round the face"),
        Parameter("groove", "mm", 0.0, 1.2, "depth of the groove for real lenses; 0 for none"),
    ),
    "Print the front face down; PA12 or PETG lets the temples spread.",
)
