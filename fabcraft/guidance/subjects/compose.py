"""The drawing that a wish asks for: a subject alone, with another one as a detail on it, or two side by side."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Bool, Float64

from fabcraft.errors import InputError
from fabcraft.guidance.drawing import Drawing
from fabcraft.guidance.outline import fill_contour, outline_of, trim
from fabcraft.guidance.subjects.library import MARGIN, PEN, Subject, drawing_of, objects
from fabcraft.guidance.subjects.words import Wish
from fabcraft.guidance.symmetry import mirror_axis

Points = Float64[np.ndarray, "_ 2"]
ROOM = 0.085
"""Least radius of the free place for a detail, in shares of the drawing's longer side."""
AIR = 0.86
"""How much of that place a detail fills."""
OVERLAP = 0.09
"""How far two drawings side by side run into each other, in shares of their height."""


def composed(wish: Wish, template: str = "mask", reading: str = "") -> Drawing:
    """The drawing for a template: of the subject as a motif, or (`reading` "object") as the whole object.

    Raises `InputError` where the drawings do not allow it.
    """
    if reading == "object" and template != "mask":
        return drawing_of(_whole(wish, template))
    first = drawing_of(wish.subject)
    if wish.other is None:
        return first
    second = drawing_of(wish.other)
    if wish.how == "with":
        return _with_detail(first, second, wish)
    if template == "mask":
        raise InputError(
            f"{wish.words}: two drawings side by side are no mask, which has one outline before a face",
            f"Say '{wish.subject.name} with {wish.other.name}', or name one of them.",
        )
    return _side_by_side(first, second)


def _whole(wish: Wish, template: str) -> Subject:
    known = objects()
    name = f"{wish.subject.name} {template}"
    if wish.other is not None or name not in known:
        raise InputError(
            f"the library has no drawing of the whole {template} for '{wish.words}'",
            f"As whole objects it has: {', '.join(known)}. Leave --as out to work a motif into the {template}.",
        )
    return known[name]


def _with_detail(base: Drawing, detail: Drawing, wish: Wish) -> Drawing:
    """The outline of the detail where the base has room for it; strokes in its way are left out.

    Raises `InputError` when there is no room.
    """
    side = float(np.ptp(base.outline, axis=0).max())
    lines = [(one, False) for one in base.strokes]
    loops = [(one, True) for one in (*base.regions, *base.holes, *base.eyes)]
    centre, radius = _room(base, [*loops, *lines])
    kept = base.strokes
    if radius < ROOM * side:
        centre, radius = _room(base, loops)
        kept = tuple(one for one in base.strokes if np.linalg.norm(one - centre, axis=1).min() > radius)
    if radius < ROOM * side:
        raise InputError(
            f"{wish.words}: the drawing of the {wish.subject.name} has no room for another one on it",
            "Choose a subject with a plain part, such as heart, cat or shield, or name one of them.",
        )
    (x, y), reach = cv2.minEnclosingCircle(detail.outline.astype(np.float32))
    laid = centre + (detail.outline - [x, y]) * (AIR * radius / reach)
    return replace(base, regions=(*base.regions, laid), strokes=kept)


def _room(base: Drawing, lines: Sequence[tuple[Points, bool]]) -> tuple[Float64[np.ndarray, "2"], float]:
    """(centre, radius) of the largest free circle, on the mirror axis where that costs little."""
    free = base.silhouette.astype(np.uint8)
    for line, closed in lines:
        at = np.round(line).astype(np.int32)
        if closed:
            cv2.fillPoly(free, [at], 0)
        cv2.polylines(free, [at], closed, 0, round(2 * PEN))
    depth = cv2.distanceTransform(free, cv2.DIST_L2, 5)
    if base.symmetry_iou > 0.97:
        column = int(base.symmetry_axis_px)
        row = int(depth[:, column].argmax())
        if depth[row, column] > 0.7 * depth.max():
            return np.array([base.symmetry_axis_px, row + 0.5]), float(depth[row, column])
    row, column = (int(one) for one in np.unravel_index(int(depth.argmax()), depth.shape))
    return np.array([column + 0.5, row + 0.5]), float(depth.max())


def _side_by_side(first: Drawing, second: Drawing) -> Drawing:
    """Both equally high, the second to the right, run into each other so that they are one piece."""
    height = 700.0
    left, right = _scaled(first, height, 0.0), _scaled(second, height, 0.0)
    gap = _least_gap(left, right)
    right = _scaled(second, height, -OVERLAP * height - gap)
    size = (int(height + 2 * MARGIN), int(right.outline[:, 0].max() + MARGIN))
    both: Bool[np.ndarray, "H W"] = fill_contour(left.outline, size) | fill_contour(right.outline, size)
    outline = outline_of(trim(both, PEN), PEN)
    silhouette = fill_contour(outline, size)
    axis = mirror_axis(silhouette)
    return replace(
        left,
        width=size[1],
        height=size[0],
        silhouette=silhouette,
        outline=outline,
        eyes=(),
        holes=(*left.holes, *right.holes),
        regions=(*left.regions, *left.eyes, *right.regions, *right.eyes),
        strokes=(*left.strokes, *right.strokes),
        symmetry_axis_px=axis.column_px,
        symmetry_tilt_deg=axis.tilt_deg,
        symmetry_iou=axis.iou,
    )


def _scaled(drawing: Drawing, height: float, left: float) -> Drawing:
    """The drawing `height` high, with `MARGIN` above and `MARGIN` + `left` before it."""
    lower, upper = drawing.outline.min(0), drawing.outline.max(0)
    scale = height / float(upper[1] - lower[1])

    def laid(points: Points) -> Points:
        return (points - lower) * scale + MARGIN + [left, 0.0]

    return replace(
        drawing,
        outline=laid(drawing.outline),
        eyes=tuple(map(laid, drawing.eyes)),
        holes=tuple(map(laid, drawing.holes)),
        regions=tuple(map(laid, drawing.regions)),
        strokes=tuple(map(laid, drawing.strokes)),
    )


def _least_gap(left: Drawing, right: Drawing) -> float:
    """Least distance, row by row, from the right edge of one to the left edge of the other; negative where they overlap."""
    rows = np.arange(0.0, 2000.0, 4.0)
    edge = np.full(len(rows), -np.inf)
    start = np.full(len(rows), np.inf)
    np.maximum.at(edge, (left.outline[:, 1] / 4.0).astype(int), left.outline[:, 0])
    np.minimum.at(start, (right.outline[:, 1] / 4.0).astype(int), right.outline[:, 0])
    return float((start - edge).min())
