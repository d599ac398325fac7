"""The mask: a sheet in front of the face, from above the brows to under the chin, with two eye openings.

Placement (mm on an adult of 123 mm menton-sellion, scaled to the face): from glabella + 30 down to menton - 5, laterally
to 0.85 of the zygion; openings 36 x 24 centred on the eyes. Clearance to the skin: 2.0 in general, 4 before
the lips, 0.3 where it rests (forehead band, cheekbones, nose bridge); before the eyes are openings.  On a character every
length goes with the size of its head, and the openings are wide enough for its eyes.

The sheet does not copy the face: it is the smoothest surface in front of it, held where it rests, so that the wearer's
lips and nostrils do not show through.
"""

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from jaxtyping import Float64
from scipy.ndimage import binary_closing, gaussian_filter

from fabcraft.body.body import Body
from fabcraft.body.contacts import resting_on
from fabcraft.errors import InputError
from fabcraft.geometry.heights import front_heights, lifted_over, raised, smoothest_over
from fabcraft.geometry.plane import Plane
from fabcraft.geometry.triangulate import triangulate
from fabcraft.mesh import Mesh
from fabcraft.template.catalogue import Kind, Settings
from fabcraft.template.template import FrontSurface, Parameter, Template

CONTACTS = ("forehead", "cheekbone_left", "cheekbone_right", "nose_bridge")
LANDMARKS = ("sellion", "glabella", "menton", "zygion_left", "zygion_right", "eye_left", "eye_right")
GENERAL_MM, RESTING_MM = 2.0, 0.3
ROOM_WALLS = 2.5
"""Width of material around the openings, in walls."""
WALL_MM = (1.6, 5.0)
"""Thinnest and thickest wall: it must carry the beads, and still be a wall."""
DEFAULT_WALL_MM = 2.4
_WALL_SHARE = 0.02
"""Wall of a character's mask over the size of its head."""
ADULT_FACE_MM = 123.0  # menton to sellion, median man (ANSUR II)
SIGHT_MM = 6.0
"""Skin that is this far behind the frontmost is still met by a mask."""
_SLACK_MM = 0.15  # the height fields are grids; what they miss between pixels stays under this


def natural_wall_mm(body: Body) -> float:
    """The wall that a mask for `body` has when none is asked: 2.4 mm for people, by the head's size for characters."""
    return _natural_wall_mm(_worn_by(body))


def _natural_wall_mm(head: Body) -> float:
    if head.kind != "character":
        return DEFAULT_WALL_MM
    return float(np.clip(_WALL_SHARE * head.mesh.size_mm[2], *WALL_MM))


def _worn_by(body: Body) -> Body:
    """The head of `body`, or itself where it is one already."""
    return body.part("head") if "neck_root" in body.joints and body.kind != "scan" else body


def mask(body: Body, wall_mm: float | None = None) -> Template:
    """The mask for `body` (a whole person or character, a head part, or a scanned head).

    wall_mm : thickness of the finished wall, 1.6-5; the natural one when left out.
    Raises `InputError` for a body without a face, or a wall outside.
    """
    head = _worn_by(body)
    if wall_mm is None:
        wall_mm = _natural_wall_mm(head)
    if not WALL_MM[0] <= wall_mm <= WALL_MM[1]:
        raise InputError(
            f"a mask's wall of {wall_mm} mm was asked",
            f"Choose between {WALL_MM[0]:g} and {WALL_MM[1]:g} mm.",
        )
    missing = [name for name in LANDMARKS if name not in head.landmarks]
    if missing:
        raise InputError(
            f"body {body.name} has no landmark {', '.join(missing)}, so a mask cannot be placed on it",
            "Use a head scan or one of the built-in people.",
        )
    scale = head.scale
    if head.kind != "character":
        scale = (head.landmarks["sellion"][2] - head.landmarks["menton"][2]) / ADULT_FACE_MM
    front = _front_surface(head, wall_mm, scale)
    edge_mm = 2.6 * scale
    openings = _openings(head, scale)
    flat = triangulate([_outline(head, scale, openings, ROOM_WALLS * wall_mm), *openings], edge_mm)
    height = front.base_at(flat.points)
    sheet = Mesh(np.column_stack([flat.points[:, 0], -height, flat.points[:, 1]]), flat.faces, "mask")
    rims = tuple(loop.astype(np.int32) for loop in flat.loops)
    resting_mm = head.clearance_mm(RESTING_MM)
    return Template(
        "mask",
        head,
        sheet,
        rims,
        front,
        wall_mm,
        len(rims) - 1,
        resting_on(head, CONTACTS),
        edge_mm,
        listed_mm=(resting_mm, head.clearance_mm(GENERAL_MM)),
        resting_mm=resting_mm,
        opening_share=0.7 if head.kind != "character" else 1.0,
    )


def build(body: Body, settings: Settings) -> Template:
    """The mask for `body`, its wall the one asked for or the natural one."""
    wall = KIND.settled(settings).get("wall")
    return mask(body, None if wall is None else float(wall))


KIND = Kind("mask", build, (Parameter("wall", "mm", *WALL_MM, "thickness"),))


def _outline(head: Body, scale: float, openings: list[np.ndarray], room_mm: float) -> np.ndarray:
    """A superellipse, narrower towards the chin, counter-clockwise in (x, z).

    Where eyes stand far apart or high up (the frog's) it is widened and raised until it has `room_mm` around them.
    """
    top = head.landmarks["glabella"][2] + 30.0 * scale
    bottom = head.landmarks["menton"][2] - 5.0 * scale
    half = 0.85 * 0.5 * (head.landmarks["zygion_left"][0] - head.landmarks["zygion_right"][0])
    middle = 0.5 * (head.landmarks["zygion_left"][0] + head.landmarks["zygion_right"][0])
    angle = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
    cosine, sine = np.cos(angle), np.sin(angle)
    x = np.sign(cosine) * np.abs(cosine) ** 0.8
    z = np.sign(sine) * np.abs(sine) ** 0.8
    chin = 1.0 - 0.22 * np.clip(-z, 0.0, 1.0) ** 1.5
    while True:
        height = top - bottom
        outline = np.column_stack([middle + half * x * chin, 0.5 * (top + bottom) + 0.5 * height * z])
        if room_around(outline, openings) >= room_mm:
            return outline
        half, top = 1.02 * half, top + 0.02 * height


def room_around(outline: Float64[np.ndarray, "N 2"], openings: Sequence[Float64[np.ndarray, "_ 2"]]) -> float:
    """Least distance from the openings to the outline, mm, negative where one sticks out."""
    polygon = outline.astype(np.float32).reshape(-1, 1, 2)
    return min(cv2.pointPolygonTest(polygon, (float(x), float(z)), True) for x, z in np.concatenate(openings))


def _openings(head: Body, scale: float) -> list[np.ndarray]:
    """36 x 24 mm ellipses before the eyes, the wearer's right one (left in the picture) first."""
    angle = np.linspace(0.0, 2.0 * np.pi, 240, endpoint=False)
    half = np.array([18.0, 12.0]) * scale
    if head.kind == "character":  # its eyes may be larger than a person's, and look out of the openings
        eye = head.mesh.vertices[head.regions["eye_left"].vertex_indices] - head.landmarks["eye_left"]
        half = np.maximum(half, np.linalg.norm(eye, axis=1).max() + head.clearance_mm(GENERAL_MM))
    ellipse = np.column_stack([np.cos(angle), np.sin(angle)]) * half
    return [head.landmarks[name][[0, 2]] + ellipse for name in ("eye_right", "eye_left")]


def _front_surface(head: Body, wall_mm: float, scale: float) -> FrontSurface:
    """The height fields on a 2 mm grid wide enough for long ears; the skin is dilated on a 1 mm grid.

    Both are of people; for a character they are as fine as its head is small.
    """
    landmarks = head.landmarks
    middle = 0.5 * (landmarks["eye_left"] + landmarks["eye_right"])
    half, below, above = 150.0 * scale, 190.0 * scale, 240.0 * scale
    pixel = head.scale
    width, height = 2 * round(half / pixel), 2 * round((above + below) / (2.0 * pixel))
    fine = Plane(middle[0] - half, middle[2] + above, pixel, width, height)
    plane = Plane(fine.left_mm, fine.top_mm, 2.0 * pixel, fine.width // 2, fine.height // 2)
    general, rest, slack = (
        head.clearance_mm(GENERAL_MM),
        head.clearance_mm(RESTING_MM),
        0.5 * wall_mm + _SLACK_MM * pixel,
    )
    skin = front_heights(head.mesh, fine)
    rests = _rests(head, fine, rest, 5.0 * scale)
    wish = np.max([np.zeros(skin.shape), *(weight * near for _, weight, near in rests)], axis=0)
    resting = wish > 0.0
    floor = raised(np.where(resting | _domes(head, fine), -np.inf, skin), general + slack, pixel)
    for distance_mm in sorted({distance_mm for distance_mm, _, _ in rests}):
        here = np.any([near for distance, _, near in rests if distance == distance_mm], axis=0)
        floor = np.maximum(floor, raised(np.where(here, skin, -np.inf), distance_mm + slack, pixel))
    clearance = np.full(skin.shape, general)
    for distance_mm, _, near in sorted(_rests(head, fine, rest, 9.0 * scale), key=lambda one: -one[0]):
        clearance[near] = distance_mm
    clearance = gaussian_filter(clearance, 2.0)
    for distance_mm, zone, asked in _zones(head, fine, skin):
        floor = np.maximum(floor, raised(np.where(zone, skin, -np.inf), distance_mm + slack, pixel))
        if asked:  # a promise to the wearer, kept by the wall too
            clearance = np.maximum(clearance, np.where(zone, distance_mm, 0.0))
    contact, wish = gaussian_filter(resting.astype(np.float64), 2.5), gaussian_filter(wish, 2.5)
    floor, skin = _coarser(floor, np.max), _coarser(skin, np.max)
    clearance, contact, wish = (_coarser(field, np.mean) for field in (clearance, contact, wish))
    core = _core(head, floor, plane, scale)
    wanted = np.where(core, floor, _around_head(floor, core, plane))
    pull = np.where(core, 0.4 + 8.0 * gaussian_filter(wish, 3.0 * scale), 0.04)
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


def _domes(head: Body, plane: Plane) -> np.ndarray:
    """Pixels of a character's eyes, which stand out of its face, and out of the openings."""
    if head.kind != "character":
        return np.zeros((plane.height, plane.width), dtype=bool)
    return _near(head, ("eye_left", "eye_right"), plane, plane.pixel_mm)


def _rests(
    head: Body, plane: Plane, least_mm: float, radius_mm: float
) -> list[tuple[float, float, np.ndarray]]:
    """(distance to the skin, weight, pixels) of every region that it rests on."""
    regions = [head.regions[name] for name in resting_on(head, CONTACTS)]
    return [
        (max(least_mm, region.never_closer_mm), region.weight, _near(head, (region.name,), plane, radius_mm))
        for region in regions
    ]


def _zones(head: Body, plane: Plane, skin: np.ndarray) -> list[tuple[float, np.ndarray, bool]]:
    """(distance, pixels, whether the wearer asked) of what keeps farther away than the rest: lips, and the like.

    The eyes look out of openings and ears are beside the mask, so both count only when asked for; what the wearer asked
    for counts only where it can be seen from the front.
    """
    found = []
    for name, region in sorted(head.regions.items()):
        asked = name in head.asked
        far = region.weight == 0.0 and region.never_closer_mm > head.clearance_mm(GENERAL_MM)
        if not far or (name.startswith(("ear", "eye")) and not asked):
            continue
        points = head.mesh.vertices[region.vertex_indices]
        if asked:
            points = points[-points[:, 1] > plane.sample(skin, points[:, [0, 2]]) - SIGHT_MM * head.scale]
        found.append((region.never_closer_mm, _pixels_near(points, plane, 3.0 * head.scale), asked))
    return found


def _near(head: Body, names: Sequence[str], plane: Plane, radius_mm: float) -> np.ndarray:
    """Pixels within `radius_mm` of a vertex of the regions, in the front view."""
    points = [head.mesh.vertices[head.regions[name].vertex_indices] for name in names]
    return _pixels_near(np.concatenate(points), plane, radius_mm)


def _pixels_near(points: Float64[np.ndarray, "N 3"], plane: Plane, radius_mm: float) -> np.ndarray:
    seen = np.zeros((plane.height, plane.width), dtype=np.uint8)
    for column, row in np.floor(plane.to_pixels(points[:, [0, 2]])).astype(int):
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
