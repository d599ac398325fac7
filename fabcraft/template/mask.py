"""The mask: a sheet in front of the face, from above the brows to under the chin, with two eye openings.

Placement (mm on an adult of 123 mm menton-sellion, scaled to the face): from glabella + 30 down to menton - 5, laterally
to 0.85 of the zygion; openings 36 x 24 centred on the eyes. Clearance to the skin: 2.0 in general, 4 before
the lips, 0.3 where it rests (forehead band, cheekbones, nose bridge); before the eyes are openings.

The sheet does not copy the face: it is the smoothest surface in front of it, held where it rests, so that the wearer's
lips and nostrils do not show through.
"""

from collections.abc import Callable

import cv2
import numpy as np
from scipy.ndimage import binary_closing, gaussian_filter

from fabcraft.body.body import Body
from fabcraft.errors import InputError
from fabcraft.geometry.heights import front_heights, lifted_over, raised, smoothest_over
from fabcraft.geometry.plane import Plane
from fabcraft.geometry.triangulate import triangulate
from fabcraft.mesh import Mesh
from fabcraft.template.template import FrontSurface, Template

CONTACTS = ("forehead", "cheekbone_left", "cheekbone_right", "nose_bridge")
LANDMARKS = ("sellion", "glabella", "menton", "zygion_left", "zygion_right", "eye_left", "eye_right")
GENERAL_MM, RESTING_MM = 2.0, 0.3
WALL_MM = (1.6, 5.0)
"""Thinnest and thickest wall: it must carry the beads, and still be a wall."""
ADULT_FACE_MM = 123.0  # menton to sellion, median man (ANSUR II)
_SLACK_MM = 0.15  # the height fields are grids; what they miss between pixels stays under this


def mask(body: Body, wall_mm: float = 2.4) -> Template:
    """The mask for `body` (a whole person, a head part, or a scanned head).

    wall_mm : thickness of the finished wall, 1.6-5.  Raises `InputError` for a body without a face, or a wall outside.
    """
    if not WALL_MM[0] <= wall_mm <= WALL_MM[1]:
        raise InputError(
            f"a mask's wall of {wall_mm} mm was asked",
            f"Choose between {WALL_MM[0]:g} and {WALL_MM[1]:g} mm.",
        )
    head = body.part("head") if "neck_root" in body.joints and body.kind == "human" else body
    missing = [name for name in LANDMARKS if name not in head.landmarks]
    if missing:
        raise InputError(
            f"body {body.name} has no landmark {', '.join(missing)}, so a mask cannot be placed on it",
            "Use a head scan or one of the built-in people.",
        )
    scale = (head.landmarks["sellion"][2] - head.landmarks["menton"][2]) / ADULT_FACE_MM
    front = _front_surface(head, wall_mm, scale)
    edge_mm = 2.6 * max(scale, 0.6)
    flat = triangulate([_outline(head, scale), *_openings(head, scale)], edge_mm)
    height = front.base_at(flat.points)
    sheet = Mesh(np.column_stack([flat.points[:, 0], -height, flat.points[:, 1]]), flat.faces, "mask")
    rims = tuple(loop.astype(np.int32) for loop in flat.loops)
    return Template("mask", head, sheet, rims, front, wall_mm, len(rims) - 1, CONTACTS, edge_mm)


def _outline(head: Body, scale: float) -> np.ndarray:
    """A superellipse, narrower towards the chin, counter-clockwise in (x, z)."""
    top = head.landmarks["glabella"][2] + 30.0 * scale
    bottom = head.landmarks["menton"][2] - 5.0 * scale
    half = 0.85 * 0.5 * (head.landmarks["zygion_left"][0] - head.landmarks["zygion_right"][0])
    middle = 0.5 * (head.landmarks["zygion_left"][0] + head.landmarks["zygion_right"][0])
    angle = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
    cosine, sine = np.cos(angle), np.sin(angle)
    x = np.sign(cosine) * np.abs(cosine) ** 0.8
    z = np.sign(sine) * np.abs(sine) ** 0.8
    chin = 1.0 - 0.22 * np.clip(-z, 0.0, 1.0) ** 1.5
    return np.column_stack([middle + half * x * chin, 0.5 * (top + bottom) + 0.5 * (top - bottom) * z])


def _openings(head: Body, scale: float) -> list[np.ndarray]:
    """36 x 24 mm ellipses before the eyes, the wearer's right one (left in the picture) first."""
    angle = np.linspace(0.0, 2.0 * np.pi, 240, endpoint=False)
    ellipse = np.column_stack([18.0 * np.cos(angle), 12.0 * np.sin(angle)]) * scale
    return [head.landmarks[name][[0, 2]] + ellipse for name in ("eye_right", "eye_left")]


def _front_surface(head: Body, wall_mm: float, scale: float) -> FrontSurface:
    """The height fields on a 2 mm grid wide enough for long ears; the skin is dilated on a 1 mm grid."""
    landmarks = head.landmarks
    middle = 0.5 * (landmarks["eye_left"] + landmarks["eye_right"])
    half, below, above = 150.0 * scale, 190.0 * scale, 240.0 * scale
    fine = Plane(middle[0] - half, middle[2] + above, 1.0, 2 * round(half), 2 * round((above + below) / 2.0))
    plane = Plane(fine.left_mm, fine.top_mm, 2.0, fine.width // 2, fine.height // 2)
    skin = front_heights(head.mesh, fine)
    zones = _zones(head, fine)
    resting = _near(head, CONTACTS, fine, 5.0 * scale)
    general = np.where(resting, -np.inf, skin)
    floor = np.maximum(
        raised(general, GENERAL_MM + wall_mm / 2 + _SLACK_MM, 1.0),
        raised(np.where(resting, skin, -np.inf), RESTING_MM + wall_mm / 2 + _SLACK_MM, 1.0),
    )
    for distance_mm, zone in zones:
        before = raised(np.where(zone, skin, -np.inf), distance_mm + wall_mm / 2 + _SLACK_MM, 1.0)
        floor = np.maximum(floor, before)
    clearance = gaussian_filter(
        np.where(_near(head, CONTACTS, fine, 9.0 * scale), RESTING_MM, GENERAL_MM), 2.0
    )
    contact = gaussian_filter(resting.astype(np.float64), 2.5)
    floor, skin = _coarser(floor, np.max), _coarser(skin, np.max)
    clearance, contact = _coarser(clearance, np.mean), _coarser(contact, np.mean)
    core = _core(head, floor, plane, scale)
    wanted = np.where(core, floor, _around_head(floor, core, plane))
    pull = np.where(core, 0.4 + 8.0 * gaussian_filter(contact, 3.0 * scale), 0.04)
    sheet = smoothest_over(floor, wanted, pull, plane.pixel_mm, 16.0 * scale, 60.0 * scale)
    base = lifted_over(sheet, floor, plane.pixel_mm, 4.0 * scale)
    return FrontSurface(plane, skin, floor, base, clearance, contact, core)


def _around_head(floor: np.ndarray, core: np.ndarray, plane: Plane) -> np.ndarray:
    """Where the sheet would like to be beside the face: the paraboloid of the face, going on at a limited slope.

    Sideways it wraps around the head (slope up to 0.65); up and down it stays nearly upright (0.25), as ears should.
    """
    x, z = plane.centres()
    middle_x, middle_z = x[core].mean(), z[core].mean()
    dx, dz = x - middle_x, z - middle_z
    terms = np.column_stack([np.ones(core.sum()), dz[core], dz[core] ** 2, dx[core] ** 2])
    level, tilt, bend_z, bend_x = np.linalg.lstsq(terms, floor[core], rcond=None)[0]
    reach_x, low, high = np.abs(dx[core]).max(), dz[core].min(), dz[core].max()
    near_x, near_z = np.clip(dx, -reach_x, reach_x), np.clip(dz, low, high)
    slope_x = np.clip(2.0 * bend_x * near_x, -0.65, 0.65)
    slope_z = np.clip(tilt + 2.0 * bend_z * near_z, -0.25, 0.25)
    inner = level + tilt * near_z + bend_z * near_z**2 + bend_x * near_x**2
    return inner + slope_x * (dx - near_x) + slope_z * (dz - near_z)


def _core(head: Body, floor: np.ndarray, plane: Plane, scale: float) -> np.ndarray:
    """The front of the face where it is not too steep to carry a sheet: at most about 45 degrees."""
    x, z = plane.centres()
    landmarks = head.landmarks
    filled = np.where(np.isfinite(floor), floor, np.nan)
    down, across = np.gradient(
        gaussian_filter(np.nan_to_num(filled, nan=np.nanmin(filled)), 1.0), plane.pixel_mm
    )
    middle = 0.5 * (landmarks["zygion_left"][0] + landmarks["zygion_right"][0])
    half = 0.5 * (landmarks["zygion_left"][0] - landmarks["zygion_right"][0])
    core = np.isfinite(floor) & (np.hypot(across, down) < 1.1) & (np.abs(x - middle) < 0.9 * half)
    core &= (z < landmarks["glabella"][2] + 38.0 * scale) & (z > landmarks["menton"][2] - 2.0 * scale)
    return binary_closing(core, iterations=3) & np.isfinite(floor)


def _zones(head: Body, plane: Plane) -> list[tuple[float, np.ndarray]]:
    """(distance, pixels) of the regions that keep farther from the sheet than the rest: lips, and the like."""
    return [
        (region.never_closer_mm, _near(head, (name,), plane, 3.0))
        for name, region in sorted(head.regions.items())
        if region.never_closer_mm > GENERAL_MM and not name.startswith(("ear", "eye"))
    ]


def _near(head: Body, names: tuple[str, ...], plane: Plane, radius_mm: float) -> np.ndarray:
    """Pixels within `radius_mm` of a vertex of the regions, in the front view."""
    seen = np.zeros((plane.height, plane.width), dtype=np.uint8)
    for name in names:
        points = head.mesh.vertices[head.regions[name].vertex_indices][:, [0, 2]]
        for column, row in np.floor(plane.to_pixels(points)).astype(int):
            cv2.circle(seen, (int(column), int(row)), max(1, round(radius_mm / plane.pixel_mm)), 1, -1)
    return seen.astype(bool)


def _coarser(field: np.ndarray, reduce: Callable[..., np.ndarray]) -> np.ndarray:
    """Blocks of 2 x 2 pixels reduced to one."""
    height, width = field.shape
    return reduce(
        field.reshape(height // 2, 2, width // 2, 2)
        .transpose(0, 2, 1, 3)
        .reshape(height // 2, width // 2, 4),
        axis=2,
    )
