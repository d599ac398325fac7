"""From a guidance mesh to a relief: a mesh, turned to face the viewer, is a drawing with heights.

Its silhouette takes the place of the drawn outline and its eye holes that of the drawn eyes, so that it is sized and laid
on the face by the same rules (`placement`). Its front heights become the relief: waves longer than about 1.5 mm the sheet,
the rest, as far as it stands out, the detail. Along the view the mesh comes to rest on the template's floor.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from scipy.ndimage import binary_dilation, distance_transform_edt, gaussian_filter

from fabcraft.errors import InputError
from fabcraft.geometry.align import Similarity
from fabcraft.geometry.contour import level_contours, smooth
from fabcraft.geometry.heights import front_heights, lifted_over, smoothest_over
from fabcraft.geometry.plane import Plane
from fabcraft.guidance.clean import cleaned
from fabcraft.guidance.drawing import Drawing
from fabcraft.guidance.facing import (
    WORST_RESIDUAL,
    Facing,
    Silhouette,
    eye_pair,
    faced,
    laid,
    silhouette,
    too_deep,
    turn_deg,
)
from fabcraft.guidance.inflate import Relief, solid_mask
from fabcraft.guidance.placement import PlacedDrawing, PlacementSettings, place
from fabcraft.guidance.symmetry import mirror_axis
from fabcraft.mesh import Mesh
from fabcraft.template.template import Template

DETAIL_LIMIT_MM = 3.0
_FINE_MM = 1.5  # waves shorter than about this are detail
_STEEP = 2.2  # a steeper flank has too few pixels to be a height field; the sheet goes on smoothly instead
_NOTABLE_MM2 = 80.0


@dataclass(frozen=True, eq=False)
class TargetRelief:
    """What a guidance mesh asks for."""

    relief: Relief
    notes: tuple[str, ...]
    """What was made of it, in sentences."""
    mesh: Mesh
    """What was used of it, where it lies on the body, mm; where it would touch the face, the relief is before it."""
    placed: Similarity
    """What brought it there from its file."""
    residual: float
    """By how much it misses the template; see `Facing`."""
    limit: float = WORST_RESIDUAL
    """More than that is refused."""


def target_relief(
    mesh: Mesh,
    template: Template,
    settings: PlacementSettings | None = None,
    transform: Similarity | None = None,
    force: bool = False,
) -> TargetRelief:
    """The relief that a guidance mesh asks for.

    mesh : any scale, up axis and facing; open, closed, a double shell or several pieces.
    transform : where its user says that it lies; found when None.  force : take one that misses the template by much.
    Raises `InputError` for a mesh without a surface, one that resembles no mask, and one without room for the eyes.
    """
    settings = settings or PlacementSettings()
    if "eye_left" not in template.body.landmarks:
        raise InputError(f"body {template.body.name} has no eyes to place a mask by", "Use a head.")
    clean = cleaned(mesh)
    facing = (
        faced(clean.mesh, template, force) if transform is None else laid(clean.mesh, template, transform)
    )
    turned = _turn(facing.pose.rotation) if transform is None else "placed by its transform"
    notes = [
        *clean.notes,
        f"The guidance mesh was {turned}; it misses the template by {100.0 * facing.residual:.1f} % of its size.",
        *facing.notes,
    ]
    seen = silhouette(
        facing.mesh, template, float(np.ptp(facing.mesh.vertices[:, [0, 2]], axis=0).max()) / 900.0
    )
    drawing = _drawing(seen, template, notes)
    placed = place(drawing, template, settings, seen.plane if facing.exact else None)
    heights, fine, pose = _heights(facing, drawing, placed, seen.plane, template)
    soft, detail = _split(heights, fine)
    sheet, plane = _sheet(soft, fine, placed.outline)
    height, forward_mm = _rested(sheet, np.isfinite(sheet), plane, template, facing.exact, notes)
    relief = Relief(placed.outline, placed.openings, plane, height, fine, detail)
    pose = Similarity(1.0, np.eye(3), np.array([0.0, -forward_mm, 0.0])).after(pose)
    moved = clean.mesh.with_vertices(pose.points(clean.mesh.vertices))
    return TargetRelief(relief, (*notes, *placed.notes), moved, pose, facing.residual)


def _turn(rotation: np.ndarray) -> str:
    """The turn in words."""
    if turn_deg(rotation) < 0.5:
        return "left as it stands"
    names = np.array([["-x", "x"], ["-y", "y"], ["-z", "z"]])

    def axis(direction: np.ndarray) -> str:
        most = int(np.abs(direction).argmax())
        about = "" if abs(direction[most]) > 0.999 else "about "
        return about + str(names[most, int(direction[most] > 0)])

    return f"turned (its up is {axis(rotation[2])}, its front {axis(-rotation[1])})"


def _drawing(seen: Silhouette, template: Template, notes: list[str]) -> Drawing:
    """The front view as if it had been drawn: outline and eyes, without strokes."""
    pixel_mm = seen.plane.pixel_mm
    field = np.where(binary_dilation(seen.shape, np.ones((3, 3)), 2), seen.coverage, 0.0)
    outline = _contour(np.where(seen.shape & (field < 0.5), 1.0, field), pixel_mm)
    pair = eye_pair(seen, template)
    if seen.dropped_mm2 > _NOTABLE_MM2:
        notes.append(
            f"Pieces apart from the largest one were left out ({seen.dropped_mm2:.0f} mm² seen from the front)."
        )
    if pair is None:
        notes.append(
            "The guidance mesh has no opening before each eye; the template's own openings are used."
        )
    others = [hole.sum() * pixel_mm**2 for i, hole in enumerate(seen.holes) if pair is None or i not in pair]
    closed = [area for area in others if area > _NOTABLE_MM2]
    if closed:
        notes.append(
            f"Other holes of the guidance mesh were closed: {len(closed)}, up to {max(closed):.0f} mm²."
        )
    eyes = tuple(
        _contour(
            np.where(binary_dilation(seen.holes[i], np.ones((3, 3)), 2), 1.0 - seen.coverage, 0.0), pixel_mm
        )
        for i in pair or ()
    )
    axis = mirror_axis(seen.shape)
    return Drawing(
        width=seen.plane.width,
        height=seen.plane.height,
        silhouette=seen.shape,
        outline=outline,
        eyes=eyes,
        holes=(),
        regions=(),
        strokes=(),
        stroke_width_px=1.8 / pixel_mm,
        outline_closed=True,
        gap_closed_px=0.0,
        symmetry_axis_px=axis.column_px,
        symmetry_tilt_deg=axis.tilt_deg,
        symmetry_iou=axis.iou,
    )


def _contour(coverage: np.ndarray, pixel_mm: float) -> np.ndarray:
    """The longest contour of half coverage, pixels, freed of pixel stairs."""
    contours = level_contours(coverage, 0.5, soften=0.7)
    if not contours:
        raise InputError(
            "the guidance mesh is too thin to be seen from the front", "Give a mesh of a mask's front."
        )
    return smooth(contours[0], 0.8 / pixel_mm, corner_reach=3.0 / pixel_mm)


def _heights(
    facing: Facing, drawing: Drawing, placed: PlacedDrawing, plane: Plane, template: Template
) -> tuple[Float64[np.ndarray, "H W"], Plane, Similarity]:
    """Front heights, mm, of the mesh laid as its outline was, on a 0.25 mm grid, and what laid it there from its file.

    The heights are -inf outside and in holes.
    """
    scale = placed.pixel_mm / plane.pixel_mm
    # place() scales and shifts but never turns: the mean of the outline tells the shift
    shift = placed.outline.mean(0) - plane.to_mm(drawing.outline).mean(0) * scale
    fine = Plane.around(placed.outline, 0.25, 3.0)
    pose = Similarity(scale, np.eye(3), np.array([shift[0], 0.0, shift[1]]))
    heights = front_heights(facing.mesh.with_vertices(pose.points(facing.mesh.vertices)), fine)
    heights = np.where(solid_mask(placed.outline, (), fine), heights, -np.inf)
    known = np.isfinite(heights)
    if not facing.exact:
        x, z = fine.centres()
        base = template.front.at(template.front.base, np.column_stack([x[known], z[known]]))
        forward_mm = float(np.median(base - heights[known]))
        heights[known] += forward_mm
        pose = Similarity(scale, np.eye(3), pose.translation - [0.0, forward_mm, 0.0])
    return np.where(too_deep(heights, fine, template), -np.inf, heights), fine, pose.after(facing.pose)


def _split(
    heights: Float64[np.ndarray, "H W"], fine: Plane
) -> tuple[Float64[np.ndarray, "H W"], Float64[np.ndarray, "H W"]]:
    """Heights without waves shorter than about 1.5 mm, and what stands out of them, mm.

    The heights are -inf where unknown and on flanks too steep to be seen; there is no detail there.
    """
    known = np.isfinite(heights)
    sigma = _FINE_MM / fine.pixel_mm
    level = float(np.median(heights[known]))
    given = np.where(known, heights - level, 0.0)
    soft = gaussian_filter(given, sigma) / np.maximum(gaussian_filter(known.astype(np.float64), sigma), 1e-9)
    down, across = np.gradient(np.where(known, soft, 0.0), fine.pixel_mm)
    steep = known & (np.hypot(down, across) >= _STEEP)
    gentle = (distance_transform_edt(known) > 1.0) & ~steep
    usable = gentle if gentle.sum() > 0.5 * known.sum() else known
    # beside a flank the residue is the flank's own bend
    beside = distance_transform_edt(~steep) * fine.pixel_mm if steep.any() else np.full(steep.shape, np.inf)
    detail = np.where(usable, np.clip(given - soft, 0.0, DETAIL_LIMIT_MM), 0.0)
    detail *= np.clip(0.5 * beside - 0.5, 0.0, 1.0)
    return np.where(usable, level + soft, -np.inf), gaussian_filter(detail, 0.2 / fine.pixel_mm)


def _sheet(
    soft: Float64[np.ndarray, "H W"], fine: Plane, outline: Float64[np.ndarray, "N 2"]
) -> tuple[Float64[np.ndarray, "h w"], Plane]:
    """The soft heights at the centres of a 1 mm grid of even size; -inf where unknown."""
    plane = Plane.around(outline, 1.0, 12.0)
    plane = Plane(
        plane.left_mm, plane.top_mm, 1.0, plane.width + plane.width % 2, plane.height + plane.height % 2
    )
    usable = np.isfinite(soft)
    x, z = plane.centres()
    xz = np.column_stack([x.ravel(), z.ravel()])
    weight = fine.sample(usable.astype(np.float64), xz).reshape(x.shape)
    total = fine.sample(np.where(usable, soft, 0.0), xz).reshape(x.shape)
    return np.where(weight > 0.5, total / np.maximum(weight, 0.5), -np.inf), plane


def _rested(
    sheet: Float64[np.ndarray, "H W"],
    known: Bool[np.ndarray, "H W"],
    plane: Plane,
    template: Template,
    exact: bool,
    notes: list[str],
) -> tuple[Float64[np.ndarray, "H W"], float]:
    """(the sheet everywhere: going on smoothly where it is unknown, as near the floor as it can be, never below it;
    how far forward it was moved, mm).

    exact : it stays where it is, but for what would touch the face.
    """
    x, z = plane.centres()
    xz = np.column_stack([x.ravel(), z.ravel()])
    front = template.front
    floor = front.at(np.where(np.isfinite(front.floor), front.floor, -1e3), xz).reshape(x.shape)
    core = known & (front.at(front.core.astype(np.float64), xz).reshape(x.shape) > 0.5)
    height = _extended(sheet, known, plane)
    if core.any():
        # the whole moves until it is clear, but for a spot deeper than 2 mm: that one bulges the sheet
        missing = (floor - height)[core]
        shift = min(float(missing.max()), float(np.quantile(missing, 0.99)) + 2.0)
    else:
        shift = float(np.median((front.base_at(xz).reshape(x.shape) - height)[known]))
    if exact:
        shift = max(shift, 0.0)
    height = height + shift
    lift = lifted_over(np.zeros_like(height), floor - height, plane.pixel_mm, 3.0)
    if known.any() and lift[known].max() > 3.0:
        notes.append(
            f"The guidance was raised by up to {lift[known].max():.0f} mm where it would touch the face."
        )
    rests = core & (front.at(front.contact, xz).reshape(x.shape) > 0.5)
    if rests.any():
        gap = float((height + lift - floor)[rests].mean())
        if gap > 6.0:
            notes.append(
                f"The guidance stands {gap:.0f} mm before the forehead, cheekbones and nose where a mask rests."
            )
    return height + lift, shift


def _extended(
    sheet: Float64[np.ndarray, "H W"], known: Bool[np.ndarray, "H W"], plane: Plane
) -> Float64[np.ndarray, "H W"]:
    """The sheet where it is known, and the smoothest way on where it is not (solved at 2 mm)."""
    coarse = Plane(plane.left_mm, plane.top_mm, 2.0, plane.width // 2, plane.height // 2)
    blocks = (coarse.height, 2, coarse.width, 2)
    whole = np.asarray(
        known.reshape(blocks).all((1, 3))
    )  # the mean of a part of a block is not the height at its centre
    wanted = np.where(whole, np.where(known, sheet, 0.0).reshape(blocks).mean((1, 3)), -np.inf)
    free, weight = np.full(wanted.shape, -np.inf), whole.astype(np.float64)
    smooth_way = smoothest_over(free, wanted, weight, coarse.pixel_mm, 5.0, 60.0)
    x, z = plane.centres()
    way = coarse.sample(smooth_way, np.column_stack([x.ravel(), z.ravel()]), order=3).reshape(x.shape)
    # the smooth surface takes over within the last millimetres, so that no step is left at the border
    inner = np.clip((distance_transform_edt(known) - 2.0) * plane.pixel_mm / 3.0, 0.0, 1.0)
    return way + inner**2 * (3.0 - 2.0 * inner) * np.where(known, sheet - way, 0.0)
