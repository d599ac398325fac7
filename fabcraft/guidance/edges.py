"""A picture of a drawing becomes a `Drawing`: ink, closed outline, eyes, regions and strokes. Pixels
throughout.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float64, UInt8
from scipy import ndimage

from fabcraft.errors import InputError
from fabcraft.geometry.contour import inside
from fabcraft.guidance.curves import length_of
from fabcraft.guidance.drawing import Drawing
from fabcraft.guidance.eyes import find_eyes
from fabcraft.guidance.gaps import Bridge, Closed, close_gaps, close_loops
from fabcraft.guidance.ink import ink as ink_of
from fabcraft.guidance.ink import one_line, working_copy
from fabcraft.guidance.outline import Trimmed, fill_contour, outline_of, trim
from fabcraft.guidance.parts import parts_of
from fabcraft.guidance.strokes import trace_strokes
from fabcraft.guidance.symmetry import mirror_axis

Mask = Bool[np.ndarray, "H W"]
Points = Float64[np.ndarray, "_ 2"]
CLOSE_IT = "Close the outline with a dark line; gaps up to a tenth of the drawing are closed for you."


@dataclass(frozen=True, eq=False)
class _Rim:
    """The outline and how it was got, in the coordinates of the padded page."""

    outline: Points
    ink: Mask
    gap_px: float
    blunt: bool
    """The gap was closed by growing lines together, not by a curve."""
    others: int
    """Other drawings on the page."""


def understand(rgba: UInt8[np.ndarray, "H W 4"]) -> Drawing:
    """The `Drawing` in a picture, (H, W, 4) uint8 RGBA of any size.

    Raises `InputError` when the page is blank or no outline is closed.
    """
    rgba = working_copy(rgba)
    page, width = one_line(ink_of(rgba))
    margin = int(4 * width) + 4  # lines may touch the border of the picture
    rim = _rim(np.pad(page, margin), width, margin)
    around = fill_contour(rim.outline, rim.ink.shape)
    parts = parts_of(close_loops(rim.ink, around, width), around, width)
    # From here on in the coordinates of the picture.
    silhouette, outline = around[margin:-margin, margin:-margin], rim.outline - margin
    loops = tuple(loop.moved(-float(margin)) for loop in parts.loops)
    axis = mirror_axis(silhouette)
    eyes = find_eyes(loops, silhouette, axis)
    openings = tuple(eye.contour for eye in eyes)
    others = [loop.contour for loop in loops if not any(loop is eye for eye in eyes)]
    outside = _lines_outside(page, silhouette, width)
    return Drawing(
        width=rgba.shape[1],
        height=rgba.shape[0],
        silhouette=silhouette,
        outline=outline,
        eyes=openings,
        holes=(),
        regions=tuple(r for r in others if not _lies_in(r, openings)),
        strokes=tuple(s - margin for s in parts.strokes if not _lies_in(s - margin, openings)),
        stroke_width_px=width,
        outline_closed=rim.gap_px == 0.0,
        gap_closed_px=rim.gap_px,
        symmetry_axis_px=axis.column_px,
        symmetry_tilt_deg=axis.tilt_deg,
        symmetry_iou=axis.iou,
        dropped=_dropped(outside, 0 if parts.solid else _marks_in(page, openings, width)),
        warnings=_warnings(rim, outline, page.shape, outside, width, bool(eyes) and eyes[0].spot),
    )


def _rim(page: Mask, width: float, margin: int) -> _Rim:
    """The closed outline of the largest drawing on the page."""
    closed = close_gaps(page, width, margin)
    shape = _main_shape(closed, page, width)
    bridges = _on_the_rim(closed.bridges, shape.mask, width)
    outline = outline_of(shape, width, np.vstack([b.points for b in bridges]) if bridges else None)
    gap = float(max([closed.closing_px, *(b.gap_px for b in bridges)]))
    return _Rim(outline, closed.ink, gap, closed.closing_px > 0, _others(closed, shape, width))


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
                f"the outline is open: the largest closed line is {span} px across, a longer one is open",
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


def _others(closed: Closed, shape: Trimmed, width: float) -> int:
    """How many other drawings are on the page: closed shapes of at least 8 % of the main one's area."""
    rest = closed.filled & ~shape.mask
    for count in range(9):
        other = trim(rest, width).mask
        if other.sum() < 0.08 * shape.mask.sum():
            return count
        rest &= ~other
    return 9


def _warnings(
    rim: _Rim, outline: Points, size: tuple[int, int], outside: list[float], width: float, spots: bool
) -> tuple[str, ...]:
    """What the user should know."""
    out = []
    if rim.others:
        out.append(
            f"The picture holds {rim.others + 1} drawings; the largest was used. "
            "Crop the picture to choose another one."
        )
    cut = outline.min() < 1.0 or bool((outline.max(0) > np.array(size[::-1]) - 1.0).any())
    if cut:
        out.append("The drawing reaches the border of the picture; what lies beyond is missing.")
    if rim.blunt:
        out.append(
            f"Gaps of up to {rim.gap_px:.0f} px in the outline were closed bluntly. "
            "Draw the missing line for a true edge."
        )
    elif rim.gap_px > 3 * width and not cut:
        out.append(f"A gap of {rim.gap_px:.0f} px in the outline was closed by a curve.")
    if outside and outside[0] > 0.3 * float(np.ptp(outline, axis=0).max()) and not rim.others:
        out.append(
            f"A line of {outside[0]:.0f} px lies outside the closed outline and was left out. "
            "If it is a part of the shape (an ear, a horn), close its gaps."
        )
    if spots:
        out.append("The eyes are drawn as filled spots; they are taken as openings.")
    return tuple(out)
