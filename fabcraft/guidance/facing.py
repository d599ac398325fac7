"""Which way a guidance mesh faces, and what is seen of it from the front.

Axis conventions of mesh files differ, so all 24 rotations that map axes onto axes are tried: what is visible from the
front of each is brought onto the placed template by a similarity (trimmed ICP, scale within 0.5-2 of the ratio of the
boxes). The one that is left with the least residual is taken, unlikeness to its mirror image counted in; where two holes
can be eyes, half of the residual is the distance to the template's surface with these eyes over the wearer's. Among near
equals the more usual axes stand. A whole head without eye holes is like a mask from many sides: its axes count for more,
and where it is the wearer's own head, that alone places it.

A shape with eyes is then levelled: eyes over eyes, until its distance to the template's surface has no slope. Without
eyes only the ICP is left, which cannot tell a small tilt from the shape itself: turns below 25 degrees are not taken over.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64
from scipy.ndimage import binary_fill_holes, label, sum_labels
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from fabcraft.errors import InputError
from fabcraft.geometry.align import Similarity, axis_rotations, similarity_icp, spread_points
from fabcraft.geometry.contour import inside
from fabcraft.geometry.heights import front_heights
from fabcraft.geometry.plane import Plane
from fabcraft.geometry.raster import rasterize, silhouette_mask
from fabcraft.guidance.alignment import aligned
from fabcraft.guidance.clean import simplified
from fabcraft.mesh import Mesh
from fabcraft.template.template import Template

WORST_RESIDUAL = 0.15
BEHIND_MM = 60.0
_TURN_DEG = 25.0
_LEVEL_DEG = 5.0  # a smaller tilt of a shape with eyes is taken for its design
_NO_EYES = 1.5  # a direction without eyes must suit that much better than one with eyes
_DOUBT = (1.0, 1.0, 1.05, 1.05, 1.25)  # by how unusual the axes are
_TIE = 1.05
_DEEP_DOUBT = (1.0, 1.0, 1.3, 1.3, 2.0)
_DEEP = 0.6  # a mesh whose shortest side is that share of its longest is more than a front
_OWN_HEAD = 0.04  # the head of another animal misses a person's by 0.047 and more
_DOUBTFUL = (
    "It is a whole head without eye holes, which looks like a mask from many sides: its front and up are those that its "
    "file's axes suggest. If that is wrong, say where it lies (--guidance-transform)."
)
_SEARCH_FACES = 12_000
_MOST_HOLES = 12
_HOLE_MM2 = 30.0


@dataclass(frozen=True, eq=False)
class Facing:
    """A guidance mesh turned to the viewer and brought to about its place and size."""

    mesh: Mesh
    """mm, z up, seen from -y, near the template."""
    residual: float
    """Root mean square of what the trimmed ICP left, over the template's longest side; of a head on the wearer's the mean
    distance of the two over its longest side."""
    pose: Similarity
    """What brought it there from its file."""
    exact: bool = False
    """It lies where it is to be worn already; otherwise place and size are still to be found."""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Silhouette:
    """The largest piece of a mesh in the front view."""

    plane: Plane
    coverage: Float32[np.ndarray, "H W"]
    """Share of every pixel that is covered, all pieces."""
    shape: Bool[np.ndarray, "H W"]
    """The largest piece, its holes filled."""
    holes: tuple[Bool[np.ndarray, "H W"], ...]
    """Holes of more than 30 mm² in that piece, largest first."""
    dropped_mm2: float
    """Area of the other pieces."""


def faced(mesh: Mesh, template: Template, force: bool = False) -> Facing:
    """`mesh`, of any scale, up axis and facing, in front of the template's body.

    force : one that misses the template by too much is taken nevertheless.
    Raises `InputError` for a mesh without a surface, and for one that resembles the template in no direction.
    """
    file, (mesh, sized) = mesh, _of_usual_size(mesh)
    deep = bool(mesh.size_mm.min() > _DEEP * mesh.size_mm.max())
    if deep and (own := _on_head(file, template)) is not None:
        return own
    rotation, visible, eyed = _best_axes(simplified(mesh, _SEARCH_FACES), template, deep)
    pose = _brought(*visible, template, 40, 1200)
    residual = pose.rms / _longest(template.mesh)
    if not residual <= WORST_RESIDUAL and not force:
        raise InputError(
            f"the guidance mesh does not resemble a mask from any side: it misses the template by {100 * residual:.0f} % "
            f"of its size, at most {100 * WORST_RESIDUAL:.0f} % was expected",
            "Turn it so that its front looks along -y with +z up, and cut off what is not the mask; or say where it lies "
            "(--guidance-transform), or take it as it is (--force).",
        )
    level = _levelled(_moved(mesh, pose, rotation), template)
    if level is None:
        pose = _upright(pose, visible[0])
    elif turn_deg(level @ pose.rotation) < _LEVEL_DEG:
        pose = _upright(pose, visible[0], most_deg=180.0)
    else:
        middle = pose.points(visible[0].mean(0)[None])[0]
        turned = level @ pose.rotation
        pose = Similarity(pose.scale, turned, middle - pose.scale * turned @ visible[0].mean(0), pose.rms)
    turned = Similarity(pose.scale, pose.rotation @ rotation, pose.translation, pose.rms)
    notes = () if eyed or not deep else (_DOUBTFUL,)
    return Facing(_moved(mesh, pose, rotation), residual, turned.after(sized), notes=notes)


def laid(mesh: Mesh, template: Template, pose: Similarity) -> Facing:
    """`mesh` where its user says that it lies on the body."""
    moved = mesh.with_vertices(pose.points(mesh.vertices))
    points, _ = _seen(moved, np.eye(3))
    distances, _ = cKDTree(template.mesh.vertices).query(points)
    if not len(points) or not np.isfinite(distances).all():
        raise InputError("the guidance mesh shows no surface from the front", "Check its transform.")
    return Facing(moved, _trimmed_rms(distances) / _longest(template.mesh), pose, exact=True)


def _on_head(mesh: Mesh, template: Template) -> Facing | None:
    """A mesh of the wearer's own head on it; None for any other."""
    body = template.body.mesh
    head = body.submesh((body.corners[:, :, 2] > template.outline[:, 1].min()).all(1))
    if not len(head.faces):
        return None
    found = aligned(mesh, head, force=True)
    return (
        Facing(found.mesh, found.residual, found.placed, exact=True) if found.residual < _OWN_HEAD else None
    )


def silhouette(mesh: Mesh, template: Template, pixel_mm: float) -> Silhouette:
    """The front view of a mesh in its place, without what is seen far behind the template's surface: through the eyes of
    a helmet one sees its back.

    Raises `InputError` when nothing is seen.
    """
    xz = mesh.vertices[:, [0, 2]]
    plane = Plane.around(xz, pixel_mm, 6.0 * pixel_mm)
    finer = 4 if pixel_mm < 0.5 else 2
    coverage = silhouette_mask(plane.to_pixels(xz), mesh.faces, plane.width, plane.height, finer)
    coverage = np.where(too_deep(front_heights(mesh, plane), plane, template), np.float32(0.0), coverage)
    pieces, count = label(coverage >= 0.5, np.ones((3, 3)))
    if count == 0:
        raise InputError(
            "the guidance mesh shows no surface from the front", "Give a mesh of a mask's front."
        )
    areas = sum_labels(np.ones_like(pieces), pieces, np.arange(1, count + 1)) * pixel_mm**2
    largest = pieces == 1 + int(areas.argmax())
    shape = binary_fill_holes(largest)
    gaps, count = label(shape & ~largest)
    sizes = (
        sum_labels(np.ones_like(gaps), gaps, np.arange(1, count + 1)) * pixel_mm**2 if count else np.zeros(0)
    )
    order = [int(i) for i in np.argsort(-sizes, kind="stable") if sizes[i] > _HOLE_MM2]
    return Silhouette(
        plane, coverage, shape, tuple(gaps == 1 + i for i in order), float(areas.sum() - areas.max())
    )


def too_deep(
    heights: Float64[np.ndarray, "H W"], plane: Plane, template: Template
) -> Bool[np.ndarray, "H W"]:
    """Pixels where something is seen, but far behind the template's surface."""
    x, z = plane.centres()
    base = template.front.at(template.front.base, np.column_stack([x.ravel(), z.ravel()])).reshape(x.shape)
    return np.isfinite(heights) & (heights < base - BEHIND_MM)


def eye_pair(seen: Silhouette, template: Template) -> tuple[int, int] | None:
    """Indices of the two holes that are the eyes, the wearer's right one first; None where no two holes can be.

    Two holes can be eyes that lie level, are alike in size, 0.45-1.9 of the wearer's eye distance apart and on either side
    of the middle of the shape; of several pairs the one most alike and nearest to the wearer's eyes is taken.
    """
    eyes = _eyes(template)
    apart = float(np.linalg.norm(eyes[1] - eyes[0]))
    middle = _centre(seen.shape, seen.plane)[0]
    centres = [_centre(hole, seen.plane) for hole in seen.holes[:_MOST_HOLES]]
    best, least = None, np.inf
    for i, right in enumerate(centres):
        for j, left in enumerate(centres):
            across, up = left - right
            if not 0.45 * apart < across < 1.9 * apart or abs(up) > 0.35 * across:
                continue
            sizes = seen.holes[i].sum() / seen.holes[j].sum()
            between = 0.5 * (left + right)
            if not 1.0 / 3.5 < sizes < 3.5 or abs(between[0] - middle) > 0.35 * across:
                continue
            unlike = abs(np.log(sizes)) + abs(np.log(across / apart)) + abs(up) / across
            cost = unlike + float(np.linalg.norm(between - eyes.mean(0))) / apart
            if cost < least:
                best, least = (i, j), cost
    return best


def _eyes(template: Template) -> np.ndarray:
    """(2, 2) x and z of the wearer's right and left eye, mm."""
    return np.stack([template.body.landmarks[name][[0, 2]] for name in ("eye_right", "eye_left")])


def _centre(region: np.ndarray, plane: Plane) -> np.ndarray:
    rows, columns = np.nonzero(region)
    return plane.to_mm(np.array([[columns.mean() + 0.5, rows.mean() + 0.5]]))[0]


def _of_usual_size(mesh: Mesh) -> tuple[Mesh, Similarity]:
    """The mesh about its centre, 200 mm long, and what made it so.  Raises `InputError` where it has no surface."""
    if len(mesh.faces) == 0:
        raise InputError(
            "the guidance mesh has no faces", "Check that the file holds a surface and not only points."
        )
    points = mesh.vertices[np.unique(mesh.faces)]
    lower, upper = points.min(0), points.max(0)
    longest = float((upper - lower).max())
    scale = 200.0 / longest if longest > 0.0 else 0.0
    pose = Similarity(scale, np.eye(3), -0.5 * scale * (lower + upper))
    sized = mesh.with_vertices(pose.points(mesh.vertices))
    if sized.area_mm2 < 400.0:  # a hundredth of the square of that length
        raise InputError(
            "the guidance mesh has next to no surface", "Give a mesh with the area of a mask's front."
        )
    return sized, pose


def _best_axes(
    mesh: Mesh, template: Template, deep: bool
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray], bool]:
    """The best of the 24 rotations, the points and normals that are visible after it, and whether it shows eyes."""
    doubt = _DEEP_DOUBT if deep else _DOUBT
    views: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
    found = []
    for rotation in sorted(axis_rotations(), key=_unusual):
        away = rotation[1].tobytes()
        if away not in views:
            views[away] = _seen(mesh, rotation)
        points, normals = (part @ rotation.T for part in views[away])
        if len(points) < 50:  # edge-on
            continue
        pose = _brought(points, normals, template, 15, 300)
        shown = _moved(mesh, _upright(pose, points), rotation)
        score, eyed = _score(pose, points, shown, template)
        score *= (_DOUBT if eyed else doubt)[_unusual(rotation)]
        found.append((score, rotation, (points, normals), eyed))
    if not found:
        raise InputError(
            "the guidance mesh shows no surface from any side", "Give a mesh of at least a mask's front."
        )
    least = min(score for score, *_ in found)
    return next((turn, visible, eyed) for score, turn, visible, eyed in found if score <= _TIE * least)


def _unusual(rotation: np.ndarray) -> int:
    """How unusual the axes are that a rotation supposes: z up and facing -y, y up and facing z, z up, y up, others."""
    up, away = rotation[2], rotation[1]
    if up[2] == 1.0:
        return 0 if away[1] == 1.0 else 2
    if up[1] == 1.0:
        return 1 if away[2] == -1.0 else 3
    return 4


def _seen(mesh: Mesh, rotation: np.ndarray, pixels: int = 72) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals (towards the viewer) of what is visible after the rotation, in the axes of the mesh."""
    turned = mesh.vertices @ rotation.T
    xz = turned[:, [0, 2]]
    plane = Plane.around(xz, float(np.ptp(xz, axis=0).max()) / pixels, 0.0)
    if min(plane.width, plane.height) < 1:
        return np.zeros((0, 3)), np.zeros((0, 3))
    raster = rasterize(
        np.column_stack([plane.to_pixels(xz), turned[:, 1]]), mesh.faces, plane.width, plane.height
    )
    hit = raster.face_id >= 0
    x, z = plane.centres()
    points = np.column_stack([x[hit], raster.depth[hit].astype(np.float64), z[hit]])
    normals = mesh.face_normals[raster.face_id[hit]] @ rotation.T
    normals = np.where(normals[:, 1:2] > 0.0, -normals, normals)
    return points @ rotation, normals @ rotation


def _brought(
    points: np.ndarray, normals: np.ndarray, template: Template, iterations: int, count: int
) -> Similarity:
    """The similarity from visible points to the template's sheet."""
    goal, goal_normals = template.mesh.vertices, template.mesh.vertex_normals
    some, few = spread_points(goal, count), spread_points(points, count)
    goal, goal_normals, points, normals = goal[some], goal_normals[some], points[few], normals[few]
    size, goal_size = np.ptp(points, axis=0), np.ptp(goal, axis=0)
    ratio = float(np.hypot(*goal_size[[0, 2]]) / np.hypot(*size[[0, 2]]))
    shift = 0.5 * (goal.min(0) + goal.max(0)) - ratio * 0.5 * (points.min(0) + points.max(0))
    shift[1] = np.median(goal[:, 1]) - ratio * np.median(points[:, 1])
    start = Similarity(ratio, np.eye(3), shift)
    return similarity_icp(
        points, goal, normals, goal_normals, start, iterations, scale_range=(0.5 * ratio, 2.0 * ratio)
    )


def _score(pose: Similarity, points: np.ndarray, shown: Mesh, template: Template) -> tuple[float, bool]:
    """How badly a candidate suits: what the ICP left, more where it turned far, since another candidate starts nearer;
    how unlike its mirror image it is; with eyes, how far it stands from the template's surface.  And whether it has any.
    """
    longest = _longest(template.mesh)
    residual = pose.rms / longest * (1.0 + max(0.0, turn_deg(pose.rotation) - _TURN_DEG) / 45.0)
    few = points[spread_points(points, 300)]
    middle = 0.5 * (points[:, 0].min() + points[:, 0].max())
    unlike, _ = cKDTree(points).query([2.0 * middle, 0.0, 0.0] + few * [-1.0, 1.0, 1.0])
    uneven = pose.scale * _trimmed_rms(unlike) / longest
    laid = _by_eyes(shown, template)
    if laid is None:
        return _NO_EYES * residual + uneven, False
    gap = _gap(laid[0], template)
    return 0.5 * (residual + _trimmed_rms(gap - np.median(gap)) / longest) + uneven, True


def _by_eyes(mesh: Mesh, template: Template) -> tuple[np.ndarray, float] | None:
    """What is visible of a mesh near its place, brought with its eyes over the wearer's, and how much the eyes lean
    (radians, up to the wearer's left); None without eyes.
    """
    seen = silhouette(mesh, template, 1.0)
    pair = eye_pair(seen, template)
    if pair is None:
        return None
    right, left = (_centre(seen.holes[index], seen.plane) for index in pair)
    eyes = _eyes(template)
    scale = float(np.linalg.norm(eyes[1] - eyes[0]) / np.linalg.norm(left - right))
    points, _ = _seen(mesh, np.eye(3))
    points = points[_gap(points, template) < BEHIND_MM]
    shift = eyes.mean(0) - 0.5 * scale * (right + left)
    return points * scale + [shift[0], 0.0, shift[1]], float(np.arctan2(*(left - right)[::-1]))


def _gap(points: np.ndarray, template: Template) -> np.ndarray:
    """How far points lie behind the template's surface, mm."""
    return template.front.base_at(points[:, [0, 2]]) + points[:, 1]


def _levelled(mesh: Mesh, template: Template, rounds: int = 4) -> np.ndarray | None:
    """The rotation that levels a mesh near its place; None where it has no eyes."""
    total, middle = np.eye(3), mesh.vertices.mean(0)
    for _ in range(rounds):
        laid = _by_eyes((mesh.with_vertices((mesh.vertices - middle) @ total.T + middle)), template)
        if laid is None:
            return None
        points, lean = laid
        terms = np.column_stack([np.ones(len(points)), points[:, 0], points[:, 2]])
        gap = _gap(points, template)
        within = inside(points[:, [0, 2]], [template.outline])
        used = within
        for _ in range(4):  # robust: a drawn nose or muzzle must not tilt it
            if used.sum() < 30:
                return None
            fitted = np.linalg.lstsq(terms[used], gap[used], rcond=None)[0]
            off = np.abs(gap - terms @ fitted)
            used = within & (off <= np.quantile(off[used], 0.8))
        yaw, pitch = np.arctan(fitted[1:])
        total = Rotation.from_euler("xyz", [pitch, lean, -yaw]).as_matrix() @ total
    return total


def _trimmed_rms(values: np.ndarray, keep: float = 0.75) -> float:
    nearest = np.sort(np.abs(values))[: max(1, int(keep * len(values)))]
    return float(np.sqrt((nearest**2).mean()))


def _upright(pose: Similarity, points: np.ndarray, most_deg: float = _TURN_DEG) -> Similarity:
    """The pose without its turn, if it is below `most_deg`; the middle of the points stays where it was."""
    if turn_deg(pose.rotation) >= most_deg:
        return pose
    middle = points.mean(0)
    return Similarity(pose.scale, np.eye(3), pose.points(middle[None])[0] - pose.scale * middle, pose.rms)


def _moved(mesh: Mesh, pose: Similarity, rotation: np.ndarray) -> Mesh:
    return mesh.with_vertices(pose.points(mesh.vertices @ rotation.T))


def turn_deg(rotation: Float64[np.ndarray, "3 3"]) -> float:
    """Angle of a rotation, degrees."""
    return float(np.degrees(np.arccos(np.clip(0.5 * (np.trace(rotation) - 1.0), -1.0, 1.0))))


def _longest(mesh: Mesh) -> float:
    return float(mesh.size_mm.max())
