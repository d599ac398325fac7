"""What is drawn inside the outline: loops, filled spots, and strokes.

A piece of ink whose filled shape survives an opening by a line's width is a loop when much of it is bare
paper inside and a spot when it is ink; the rest are strokes. On a solid silhouette the bare paper plays the
part of the ink.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64
from scipy import ndimage

from fabcraft.guidance.gaps import fill
from fabcraft.guidance.outline import Trimmed, fill_contour, largest, outline_of, trim
from fabcraft.guidance.strokes import trace_strokes

Mask = Bool[np.ndarray, "H W"]
Points = Float64[np.ndarray, "_ 2"]
Depth = Float32[np.ndarray, "H W"]


@dataclass(frozen=True, eq=False)
class Loop:
    """A closed shape inside the outline."""

    contour: Points
    area: float
    centre: Float64[np.ndarray, "2"]
    spot: bool
    """Filled with ink, not a line around bare paper."""

    def moved(self, by: float | Float64[np.ndarray, "2"]) -> "Loop":
        """The same loop shifted by `by`."""
        return replace(self, contour=self.contour + by, centre=self.centre + by)


@dataclass(frozen=True, eq=False)
class Parts:
    """The inside of a drawing."""

    loops: tuple[Loop, ...]
    strokes: tuple[Points, ...]
    solid: bool
    """The silhouette is filled with ink."""


def is_solid(ink: Mask, silhouette: Mask, width: float) -> bool:
    """The silhouette is mostly ink, not mostly bare paper; or ink much thicker than a line around a wide opening."""
    core = silhouette & (_depth(silhouette) > 2 * width)
    thick = core & (_depth(ink) > 2 * width)
    return bool(core.any() and (ink[core].mean() > 0.6 or thick.sum() > 0.3 * core.sum()))


def parts_of(ink: Mask, silhouette: Mask, width: float) -> Parts:
    """Loops, largest first, and strokes, longest first."""
    depth = _depth(silhouette)
    solid = is_solid(ink, silhouette, width)
    if solid:
        inner = silhouette & ~ink & (depth > 0.5 * width)
    else:
        inner = ink & (depth > _rim_width(ink, silhouette, depth, width) + 0.3 * width)
    loops, left = _loops(inner, ink, width, solid)
    if not solid:
        loops += _cells_at_the_rim(ink, silhouette, depth, loops, width)
    strokes = [p for p in trace_strokes(left, width) if not _runs_along_the_rim(p, depth, width)]
    return Parts(tuple(sorted(loops, key=lambda item: -item.area)), tuple(strokes), solid)


def _depth(mask: Mask) -> Depth:
    return cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]


def _rim_width(ink: Mask, silhouette: Mask, depth: Depth, width: float) -> float:
    """How deep the line of the outline reaches: where less than a third of the pixels at that depth are
    ink.
    """
    for d in np.arange(0.5 * width, 4 * width, 0.15 * width):
        ring = silhouette & (depth >= d) & (depth < d + 1.5)
        if not ring.any() or ink[ring].mean() < 0.33:
            return float(d)
    return 1.5 * width


def _loops(inner: Mask, ink: Mask, width: float, solid: bool) -> tuple[list[Loop], Mask]:
    """Loops and spots among the pieces of inner ink, and the ink that is left for strokes."""
    labels, count = ndimage.label(inner, np.ones((3, 3)))
    whole, _ = ndimage.label(ink, np.ones((3, 3)))
    size = np.bincount(whole.ravel())
    left, found = inner.copy(), []
    for k, box in enumerate(ndimage.find_objects(labels, count), start=1):
        pad = int(2 * width) + 3
        piece = np.pad(labels[box] == k, pad)
        corner = np.array([box[1].start - pad, box[0].start - pad], float)
        filled = fill(piece)
        alone = size[whole[box][labels[box] == k].max()] < 1.2 * piece.sum()  # not cut off a longer line
        if not solid and alone and _is_dot(piece, filled, width):
            found.append(_loop(filled, filled, 0.5 * width, 0.0, True).moved(corner))
            left[box] &= labels[box] != k
            continue
        for shape in _thick_pieces(filled, width):
            bare = (shape & ~piece).sum() / shape.sum()
            spot = bool(bare < 0.25)
            if spot and _depth(shape).max() < (1.0 if solid else 1.3) * width:
                continue
            for loop in _as_loops(shape, piece, filled, width, spot, solid):
                found.append(loop.moved(corner))
                line = np.round(found[-1].contour - 0.5).astype(np.int32)
                gone = np.zeros(inner.shape, np.uint8)
                cv2.polylines(gone, [line], True, 1, round((0.8 if spot else 1.8) * width))
                if spot:
                    cv2.fillPoly(gone, [line], 1)
                left &= gone == 0
    return found, left


def _is_dot(piece: Mask, filled: Mask, width: float) -> bool:
    """About as long as it is wide, and small: a freckle, or a pearl with a speck of paper in it, not a
    stroke.
    """
    (_, sides, _) = cv2.minAreaRect(np.argwhere(filled).astype(np.float32))
    short, long = min(sides), max(sides)
    full = bool(filled.sum() > max(0.6 * short * long, 0.8 * width**2, 8))
    pearl = long < 4.5 * width and long < 1.5 * short and bool(piece.sum() > 0.75 * filled.sum())
    return full and (pearl or (long < 2.6 * width and long < 2 * short + 2))


def _thick_pieces(filled: Mask, width: float) -> list[Mask]:
    """The parts of a filled shape that are thicker than a line, without hairs, each alone."""
    pieces: list[Mask] = []
    rest = filled
    while True:
        piece = trim(rest, width).mask
        if piece.sum() < (2.2 * width) ** 2:
            return pieces
        pieces.append(piece)
        rest = rest & ~ndimage.binary_dilation(piece, iterations=2)


def _as_loops(shape: Mask, piece: Mask, filled: Mask, width: float, spot: bool, solid: bool) -> list[Loop]:
    """One loop around the shape, or one for each cell when they only lean on each other (a figure of
    eight).
    """
    if spot:
        return [_loop(shape, filled, width, 0.0, not solid)]
    cells, count = ndimage.label(shape & ~piece)
    area = np.bincount(cells.ravel(), minlength=count + 1)[1:]
    big = np.flatnonzero(area > 0.2 * area.max()) + 1
    hull = cv2.convexHull(np.argwhere(shape)[:, ::-1].astype(np.int32))
    if len(big) > 1 and shape.sum() < 0.8 * cv2.contourArea(hull):
        return [_loop(cells == k, cells == k, width, -width / 2, False) for k in big]
    return [_loop(shape, filled, width, width / 2, False)]


def _loop(mask: Mask, filled: Mask, width: float, inward: float, spot: bool) -> Loop:
    """The shape with its tips (as far as `filled` goes), shrunk by `inward` (grown when negative),
    smoothed.
    """
    contour = outline_of(Trimmed(mask, filled, np.zeros((0, 2))), width)
    if inward:
        whole = fill_contour(contour, mask.shape)
        # A pixel's centre is half a pixel nearer to the edge than to the first centre beyond it.
        depth, away = _depth(whole), cv2.distanceTransform((~whole).astype(np.uint8), cv2.DIST_L2, 5)
        shifted = largest(depth - 0.5 > inward) if inward > 0 else away - 0.5 < -inward
        if shifted.any():
            contour = outline_of(Trimmed(shifted, shifted, np.zeros((0, 2))), width)
    moment = cv2.moments(contour.astype(np.float32))
    centre = np.array([moment["m10"], moment["m01"]]) / max(moment["m00"], 1e-9)
    return Loop(contour, float(moment["m00"]), centre, spot)


def _cells_at_the_rim(
    ink: Mask, silhouette: Mask, depth: Depth, known: list[Loop], width: float
) -> list[Loop]:
    """Small closed cells that lean on the outline or on a stroke from it, such as an inner ear drawn as a
    V.
    """
    taken = np.zeros(ink.shape, bool)
    for loop in known:
        taken |= fill_contour(loop.contour, ink.shape)
    cells, count = ndimage.label(silhouette & ~ink & ~taken)
    found, whole = [], silhouette.sum()
    for k, box in enumerate(ndimage.find_objects(cells, count), start=1):
        pad = int(2 * width) + 3
        cell = np.pad(cells[box] == k, pad)
        if not (3 * width) ** 2 < cell.sum() < 0.2 * whole or _depth(cell).max() < 1.2 * width:
            continue
        edge = (cell & ~ndimage.binary_erosion(cell))[pad:-pad, pad:-pad]
        if (depth[box][edge] < 3 * width).mean() < 0.6:
            corner = np.array([box[1].start - pad, box[0].start - pad], float)
            found.append(_loop(cell, cell, width, -width / 2, False).moved(corner))
    return found


def _runs_along_the_rim(points: Points, depth: Depth, width: float) -> bool:
    """A second line drawn beside the outline, not a stroke of its own."""
    at = np.clip(points.astype(int), 0, np.array(depth.shape[::-1]) - 1)
    return bool(np.percentile(depth[at[:, 1], at[:, 0]], 85) < 3.2 * width)
