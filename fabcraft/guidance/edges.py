"""A picture of a drawing becomes a `Drawing`: ink, closed outline, eyes, regions and strokes.  Pixels throughout."""

import cv2
import numpy as np
from jaxtyping import Bool, Float64, UInt8
from scipy import ndimage

from fabcraft.errors import InputError
from fabcraft.geometry.contour import inside
from fabcraft.guidance.curves import length_of
from fabcraft.guidance.drawing import Drawing
from fabcraft.guidance.gaps import Bridge, Closed, close_gaps, close_loops
from fabcraft.guidance.ink import ink as ink_of
from fabcraft.guidance.ink import one_line, working_copy
from fabcraft.guidance.outline import Trimmed, fill_contour, outline_of, trim
from fabcraft.guidance.parts import find_eyes, parts_of
from fabcraft.guidance.strokes import trace_strokes
from fabcraft.guidance.symmetry import mirror_axis

Mask = Bool[np.ndarray, "H W"]
Points = Float64[np.ndarray, "_ 2"]
CLOSE_IT = "Close the outline with a dark line, then try again (gaps up to a tenth of the drawing are closed for you)."


def understand(rgba: UInt8[np.ndarray, "H W 4"]) -> Drawing:
    """The `Drawing` in a picture, (H, W, 4) uint8 RGBA of any size.

    Raises `InputError` when the page is blank or no outline is closed.
    """
    rgba = working_copy(rgba)
    bare, width = one_line(ink_of(rgba))
    margin = int(4 * width) + 4  # lines may touch the border of the picture
    page = np.pad(bare, margin)
    closed = close_gaps(page, width, margin)
    shape = _main_shape(closed, page, width)
    bridges = _on_the_rim(closed.bridges, shape.mask, width)
    outline = outline_of(shape, width, np.vstack([b.points for b in bridges]) if bridges else None)
    silhouette = fill_contour(outline, page.shape)
    parts = parts_of(close_loops(closed.ink, silhouette, width), silhouette, width)
    # From here on in the coordinates of the picture.
    page, silhouette = bare, silhouette[margin:-margin, margin:-margin]
    outline, loops = outline - margin, tuple(loop.moved(-margin) for loop in parts.loops)
    axis = mirror_axis(silhouette)
    eyes = find_eyes(loops, silhouette, axis)
    openings = tuple(eye.contour for eye in eyes)
    gap = float(max([closed.closing_px, *(b.gap_px for b in bridges)]))
    outside = _lines_outside(page, silhouette, width)
    return Drawing(
        width=rgba.shape[1],
        height=rgba.shape[0],
        silhouette=silhouette,
        outline=outline,
        eyes=openings,
        holes=(),
        regions=tuple(
            r.contour for r in loops if all(r is not e for e in eyes) and not _lies_in(r.contour, openings)
        ),
        strokes=tuple(s - margin for s in parts.strokes if not _lies_in(s - margin, openings)),
        stroke_width_px=width,
        outline_closed=gap == 0.0,
        gap_closed_px=gap,
        symmetry_axis_px=axis.column_px,
        symmetry_tilt_deg=axis.tilt_deg,
        symmetry_iou=axis.iou,
        dropped=_dropped(outside, _marks_in(page, openings, width) if not parts.solid else 0),
        warnings=(
            *_about_the_page(closed, shape, outline, bare.shape, width),
            *_about_the_outline(outside, outline, gap, closed.closing_px, width),
            *(
                ("The eyes are drawn as filled spots; they are taken as openings.",)
                if eyes and eyes[0].spot
                else ()
            ),
        ),
    )


def _main_shape(closed: Closed, page: Mask, width: float) -> Trimmed:
    """The largest closed shape.  Raises `InputError` when it is not the drawing's outline."""
    shape = trim(closed.filled, width)
    if shape.mask.sum() < max(0.004 * page.size, 30 * width**2):
        raise InputError("no line in the picture closes on itself, so there is no outline", CLOSE_IT)
    span = max(_sides(shape.mask))
    labels, count = ndimage.label(page & ~shape.mask, np.ones((3, 3)))
    for k, box in enumerate(ndimage.find_objects(labels, count), start=1):
        if min(_sides(labels[box] == k)) > span:
            raise InputError(
                f"the outline is open: the largest closed line is only {span} px across, and a longer one is not closed",
                CLOSE_IT,
            )
    return shape


def _sides(mask: Mask) -> tuple[int, int]:
    """Height and width of what is set."""
    rows, cols = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return int(np.ptp(rows)) + 1, int(np.ptp(cols)) + 1


def _on_the_rim(bridges: tuple[Bridge, ...], mask: Mask, width: float) -> list[Bridge]:
    """Those bridges that lie on the edge of the shape, not in its inside nor somewhere else on the page."""
    depth = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5)
    return [b for b in bridges if 0 < np.median(depth[_pixels(b.points, mask)]) < 1.5 * width]


def _pixels(points: Points, mask: Mask) -> tuple[np.ndarray, np.ndarray]:
    at = np.clip(points.astype(int), 0, np.array(mask.shape[::-1]) - 1)
    return at[:, 1], at[:, 0]


def _lies_in(points: Points, contours: tuple[Points, ...]) -> bool:
    """Most of the points lie in one of the contours."""
    return any(inside(points, [contour]).mean() > 0.6 for contour in contours)


def _lines_outside(page: Mask, silhouette: Mask, width: float) -> list[float]:
    """Lengths of the lines that lie outside the silhouette, longest first, pixels."""
    away = cv2.distanceTransform((~silhouette).astype(np.uint8), cv2.DIST_L2, 5)
    return [length_of(p) for p in trace_strokes(page & (away > 0.4 * width), width)]


def _marks_in(page: Mask, openings: tuple[Points, ...], width: float) -> int:
    """Pieces of ink inside the eyes, their own line not counted."""
    marks = 0
    for contour in openings:
        depth = cv2.distanceTransform(fill_contour(contour, page.shape).astype(np.uint8), cv2.DIST_L2, 5)
        labels, count = ndimage.label(page & (depth > 1.4 * width), np.ones((3, 3)))
        marks += int((np.bincount(labels.ravel(), minlength=count + 1)[1:] > 1.5 * width**2).sum())
    return marks


def _dropped(outside: list[float], marks: int) -> tuple[str, ...]:
    """What was seen and left out, in words."""
    out = []
    if outside:
        what = "1 stroke" if len(outside) == 1 else f"{len(outside)} strokes"
        out.append(f"{what} outside the outline, longest {outside[0]:.0f} px (such as whiskers)")
    if marks:
        out.append(f"{marks} {'mark' if marks == 1 else 'marks'} inside the eyes (such as pupils)")
    return tuple(out)


def _about_the_page(
    closed: Closed, shape: Trimmed, outline: Points, size: tuple[int, int], width: float
) -> list[str]:
    """More than one drawing; a drawing cut by the border."""
    out, others, rest = [], 0, closed.filled & ~shape.mask
    while others < 9:
        other = trim(rest, width).mask
        if other.sum() < 0.08 * shape.mask.sum():
            break
        others, rest = others + 1, rest & ~other
    if others:
        out.append(
            f"The picture holds {others + 1} drawings; the largest was used. Crop the picture to choose another one."
        )
    if outline.min() < 1.0 or (outline.max(0) > np.array(size[::-1]) - 1.0).any():
        out.append("The drawing reaches the border of the picture; what lies beyond is missing.")
    return out


def _about_the_outline(
    others: bool, outside: list[float], outline: Points, gap: float, closing_px: float, width: float
) -> list[str]:
    """Where the outline may not be what was meant."""
    out = []
    if closing_px:
        out.append(
            f"Gaps of up to {gap:.0f} px in the outline were closed bluntly. Draw the missing line for a true edge."
        )
    elif gap > 3 * width:
        out.append(f"A gap of {gap:.0f} px in the outline was closed by a curve.")
    longest = 0.3 * float(np.ptp(outline, axis=0).max())
    if outside and outside[0] > longest and not others:
        out.append(
            f"A line of {outside[0]:.0f} px lies outside the closed outline and was left out. If it is a part of the shape "
            "(an ear, a horn), close its gaps."
        )
    return out
