"""Glasses: a front with two lens openings before the eyes, temples over the ears, pads on the nose.

The front is a plate in a picture plane, tilted (pantoscopic) and rolled round a standing axis (wrap); its back stands 13 mm
before the corneas, or as far as brow, nose and cheeks ask.  A = PD - DBL, B = 0.72 A, DBL 18 mm for adults; "52-18-140"
names A, DBL and the length of the temples.  Everything is symmetric to x = 0: the left half is made and reflected.
"""

import re
from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool

from fabcraft.body.body import Body, fan_closed
from fabcraft.errors import InputError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.isotropic import reflected
from fabcraft.mesh import Mesh
from fabcraft.template.catalogue import Kind, Settings
from fabcraft.template.front import (
    HEAD_MM,
    LEAST_MM,
    PAD_MM,
    PD_MM,
    Face,
    Front,
    behind_front,
    front_of,
    groove_depth,
    temple_start,
    way_of,
)
from fabcraft.template.hinge import FLARE, PLAY_MM, STYLES, Hinge, hinge_of, hinged
from fabcraft.template.lenses import SHAPES
from fabcraft.template.melt import melted
from fabcraft.template.nose_pad import rounded_block
from fabcraft.template.plate import Rim, plate
from fabcraft.template.template import DonningPath, MotifFrame, Parameter, Template
from fabcraft.template.temples import Temple, temple
from fabcraft.template.whole import PROUD_MM

EDGE_MM = 1.4
SPREAD_MM = 10.0
"""How far each temple may be spread to put them on."""
_DROP_MM = 38.0
_PAD_RADIUS = 0.75
"""Least radius of a pad before its edges are softened, over the least wall."""
_POSES = 40
_PLACES = ("sellion", "eye_left", "eye_right", "ear_root_top_left")


def build(body: Body, settings: Settings) -> Template:
    """Glasses for `body`.  Raises `InputError` for a body without a nose or ears to rest on, and for a size without room."""
    chosen = _named(KIND.settled(settings))
    face = _face(body)
    front = front_of(face, chosen)
    groove = groove_depth(front, chosen)
    drop = _DROP_MM * face.scale
    style = str(chosen.get("hinge", STYLES[0]))
    way = way_of(face) if style == "rigid" else way_of(face, FLARE)
    start = temple_start(front, way.thickness)
    side = temple(start, way, drop)
    if "temple_length" in chosen:
        drop += float(chosen["temple_length"]) - side.length
        if not 15.0 * face.scale <= drop <= 75.0 * face.scale:
            shortest, longest = (side.length + d * face.scale - _DROP_MM * face.scale for d in (15.0, 75.0))
            raise InputError(
                f"temples of {chosen['temple_length']} mm do not reach round this ear, or too far",
                f"Choose {np.ceil(shortest):.0f} to {np.floor(longest):.0f} mm.",
            )
        side = temple(start, way, drop)
    edge = EDGE_MM * (1.0 if face.part.kind != "character" else float(np.clip(face.scale, 0.3, 1.0)))
    edge = min(edge, EDGE_MM * front.unit)
    play = float(chosen.get("hinge_play", PLAY_MM))
    hinge = None if style == "rigid" else hinge_of(side, behind_front(front, side), style, play)
    mesh = _assembled(face, front, side, groove, edge, hinge)
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
        wall_mm=min(sizes.rim - groove, front.thick, side.thickness, *([hinge.wall_mm] if hinge else [])),
        genus=2 + (2 * hinge.genus if hinge else 0),
        parts=3 if hinge else 1,
        hinges=hinge.axes if hinge else (),
        contacts=tuple(
            f"{name}_{s}"
            for name in ("nose_flank", "ear_root")
            for s in ("left", "right")
            if f"{name}_{s}" in face.part.regions
        ),
        edge_mm=edge,
        path=DonningPath(path, spread, f"each temple spreads by {spread:.0f} mm"),
        locked=_behind(mesh, front),
        holds=False,
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
            **({"hinge_play": hinge.play} if hinge else {}),
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


def _face(body: Body) -> Face:
    part, at = KIND.worn(body, "head", _PLACES)
    pd = float(np.linalg.norm(at["eye_left"] - at["eye_right"]))
    scale = part.scale if part.kind == "character" else pd / PD_MM
    corners = part.mesh.corners
    near = (corners[:, :, 1].min(1) < at["ear_root_top_left"][1]) & (corners[:, :, 0].max(1) > -1.0)
    corners = corners[near & (np.abs(corners[:, :, 2].mean(1) - at["sellion"][2]) < 70.0 * scale)]
    points = np.concatenate(
        [corners.reshape(-1, 3), corners.mean(1), 0.5 * (corners + np.roll(corners, 1, 1)).reshape(-1, 3)]
    )
    return Face(part, at, SurfaceDistance(part.mesh), np.unique(points, axis=0), pd, scale)


def _assembled(
    face: Face, front: Front, side: Temple, groove: float, edge: float, hinge: Hinge | None
) -> Mesh:
    """The left half of the front with its temple and pad, hinged or not, and its mirror image."""
    unit = front.unit
    rims = [Rim(0.8 * unit, 1.2 * unit), Rim(0.6 * unit, 0.6 * unit, groove)]
    flat = plate([front.outline, front.lens], front.thick, rims, edge, half=True)
    places = front.rolled.world(flat.points - [0.0, 0.0, front.thick])
    places[np.abs(flat.points[:, 0]) < 1e-9, 0] = 0.0
    solid = fan_closed(Mesh(places, flat.faces, KIND.name))
    solid = melted(solid, side.mesh(edge), 1.8 * unit, edge, KIND.name, half=True)
    solid = melted(solid, _pad(face, front, edge), 1.6 * unit, edge, KIND.name, half=True)
    if hinge is not None:
        solid = hinged(solid, hinge)
    cut = (np.abs(solid.corners[:, :, 0]) < 1e-7).all(1)
    return reflected(solid.submesh(~cut), 1e-6)


def _pad(face: Face, front: Front, edge: float) -> Mesh:
    """The left pad: a rounded block from the back of the rim to the flank of the nose, shaped by the skin."""
    k, unit = face.scale, front.unit
    room = face.part.clearance_mm(PAD_MM)
    region = face.part.regions["nose_flank_left"]
    centre = face.part.mesh.vertices[region.vertex_indices].mean(0)
    found = face.skin.closest(
        centre + k * np.array([[0.0, 0.0, 4.0], [0.8, 1.2, 0.0], [0.5, 0.5, -5.0], [0.5, -0.8, 0.0]])
    )
    normal = face.part.mesh.face_normals[found.faces]
    radius = max(1.7 * unit, _PAD_RADIUS * LEAST_MM)
    touching = found.points + (radius + room) * normal
    v = front.rolled.flat(centre[None])[0, 1]
    nasal = front.lens[front.lens[:, 0] < front.sizes.lens_middle]
    held = []
    for height in (v + 4.0 * k, v - 2.0 * k):
        lens_u = float(np.interp(height, *nasal[np.argsort(nasal[:, 1])].T[::-1]))
        held.append(front.world(lens_u - 0.5 * front.sizes.rim, height, -0.75 * front.thick))
    return rounded_block(np.concatenate([touching, np.stack(held)]), radius, face.skin, room, 0.7 * edge)


def _behind(mesh: Mesh, front: Front) -> Bool[np.ndarray, " F"]:
    """Faces of temples and pads: what is behind the front's back."""
    centres = mesh.corners.mean(1)
    centres[:, 0] = np.abs(centres[:, 0])
    return front.rolled.flat(centres)[:, 2] < -front.thick - 0.05 * front.sizes.rim


def _frames(front: Front, scale: float) -> tuple[MotifFrame, ...]:
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
        Parameter(
            "hinge", "", 0.0, 0.0, "none, a pin printed in place, or knuckles for an M1.4 screw", STYLES
        ),
        Parameter("hinge_play", "mm", 0.2, 1.0, "between what moves in a hinge; the printer's own"),
    ),
    "Print the front face down; PA12 or PETG lets the temples spread.",
    play="hinge_play",
)
