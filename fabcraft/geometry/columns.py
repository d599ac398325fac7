"""What stands under the overhangs of a mesh: vertical columns, one a pixel, from each overhang down to what is below it.

Every pixel's column is cut with all faces over it (a dexel, van Hook 1986); a support reaches from a cut with a face that
overhangs down to the next cut below, or to the bed at z = 0.
"""

import typing
from typing import NamedTuple

import numba as nb
import numpy as np
from jaxtyping import Bool, Float64, Int32

from fabcraft.geometry.raster import _edge, pixel_range

_SAME_MM = 1e-6
"""Cuts nearer to each other than this are one: a column through an edge meets both its faces."""


class Columns(NamedTuple):
    """Sums over all columns, gathered into upright cells as a slicer does."""

    cells: float
    """Cells with a column in them."""
    sides: float
    """Sides of cells without such a neighbour."""
    tops: float
    """Cells whose upper neighbour is none: what they carry lies on them."""
    feet: float
    """Cells that stand on the object."""
    grounded: float
    """Cells that stand on the bed."""
    kept_mm2: float
    """Area, seen from above, where columns touch faces that are to be kept clean."""


def support_columns(
    points: Float64[np.ndarray, "V 3"],
    faces: Int32[np.ndarray, "F 3"],
    overhangs: Bool[np.ndarray, " F"],
    kept: Bool[np.ndarray, " F"],
    pixel_mm: float,
    cell_mm: tuple[float, float],
) -> Columns:
    """The columns under `overhangs` of an object on the bed z = 0, all of it at z >= 0.

    points : mm.  kept : faces that are to be kept clean.  pixel_mm : side of a column.  cell_mm : side and height of a
    cell.
    """
    pixels = points.copy()
    pixels[:, :2] = (points[:, :2] - points[:, :2].min(0)) / pixel_mm
    width, height = (int(np.ceil(side)) + 1 for side in pixels[:, :2].max(0))
    side, rise = pixel_mm / cell_mm[0], cell_mm[1]
    shape = (int(height * side) + 3, int(width * side) + 3, int(points[:, 2].max() / rise) + 3)
    filled = np.zeros(shape, np.uint8)
    triangles = np.ascontiguousarray(faces, dtype=np.int32)
    touched = _columns(pixels, triangles, overhangs, kept, width, height, filled, side, rise)
    cells, sides, tops, feet, grounded = (float(one) for one in _counted(filled))
    return Columns(cells, sides, tops, feet, grounded, float(touched) * pixel_mm**2)


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def _walk(points, faces, width, height, counts, starts, depth, owner, fill):
    """Count the cuts of every column, or with `fill` store them."""
    for face in range(len(faces)):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        x0, y0, z0 = points[a, 0], points[a, 1], points[a, 2]
        x1, y1, z1 = points[b, 0], points[b, 1], points[b, 2]
        x2, y2, z2 = points[c, 0], points[c, 1], points[c, 2]
        area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
        if abs(area) < 1e-14:
            continue
        if area < 0.0:
            x1, y1, z1, x2, y2, z2, area = x2, y2, z2, x1, y1, z1, -area
        row, row_end = pixel_range(min(y0, y1, y2), max(y0, y1, y2), 0, height)
        col, col_end = pixel_range(min(x0, x1, x2), max(x0, x1, x2), 0, width)
        u0, v0, xr0, yr0, on0 = _edge(x1, y1, x2, y2)
        u1, v1, xr1, yr1, on1 = _edge(x2, y2, x0, y0)
        u2, v2, xr2, yr2, on2 = _edge(x0, y0, x1, y1)
        for r in range(row, row_end):
            py = r + 0.5
            for k in range(col, col_end):
                px = k + 0.5
                e0 = u0 * (py - yr0) - v0 * (px - xr0)
                e1 = u1 * (py - yr1) - v1 * (px - xr1)
                e2 = u2 * (py - yr2) - v2 * (px - xr2)
                if min(e0, e1, e2) < 0.0:
                    continue
                if (e0 > 0.0 or on0) and (e1 > 0.0 or on1) and (e2 > 0.0 or on2):
                    at = r * width + k
                    if fill:
                        place = starts[at] + counts[at]
                        depth[place] = (e0 * z0 + e1 * z1 + e2 * z2) / area
                        owner[place] = face
                    counts[at] += 1


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def _columns(points, faces, overhangs, kept, width, height, filled, side, rise):
    """Mark the cells of all columns in `filled` (1; 2 where one stands on the object); how often they touch `kept`."""
    counts = np.zeros(width * height, np.int64)
    starts = np.zeros(width * height + 1, np.int64)
    nothing, nobody = np.empty(0), np.empty(0, np.int64)
    _walk(points, faces, width, height, counts, starts, nothing, nobody, False)
    starts[1:] = np.cumsum(counts)
    depth, owner = np.empty(starts[-1]), np.empty(starts[-1], np.int64)
    counts[:] = 0
    _walk(points, faces, width, height, counts, starts, depth, owner, True)
    touched = 0
    for at in range(width * height):
        first, end = starts[at], starts[at + 1]
        if first == end:
            continue
        row, column = 1 + int((at // width + 0.5) * side), 1 + int((at % width + 0.5) * side)
        for place in range(first + 1, end):  # few: sorted by insertion
            z, face = depth[place], owner[place]
            while place > first and depth[place - 1] > z:
                depth[place], owner[place] = depth[place - 1], owner[place - 1]
                place -= 1
            depth[place], owner[place] = z, face
        for place in range(first, end):
            face = owner[place]
            if not overhangs[face]:
                continue
            z, floor = depth[place], 0.0
            below = place - 1
            while below >= first and z - depth[below] < _SAME_MM:
                below -= 1
            stands = below >= first
            if stands:
                floor = depth[below]
                touched += kept[owner[below]]
            touched += kept[face]
            lowest, highest = 1 + int(floor / rise), 1 + int(z / rise)
            for level in range(lowest, highest + 1):
                filled[row, column, level] |= 1
            if stands:
                filled[row, column, lowest] |= 2
    return touched


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def _counted(filled):
    """Cells, bare sides, tops, feet on the object, feet on the bed."""
    cells = sides = tops = feet = grounded = 0
    rows, columns, levels = filled.shape
    for r in range(1, rows - 1):
        for c in range(1, columns - 1):
            for k in range(1, levels - 1):
                if not filled[r, c, k]:
                    continue
                cells += 1
                sides += (filled[r - 1, c, k] == 0) + (filled[r + 1, c, k] == 0)
                sides += (filled[r, c - 1, k] == 0) + (filled[r, c + 1, k] == 0)
                tops += filled[r, c, k + 1] == 0
                feet += filled[r, c, k] > 1
                grounded += k == 1
    return cells, sides, tops, feet, grounded
