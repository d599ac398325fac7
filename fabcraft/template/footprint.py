"""The foot as a last: seen from above in its own frame, the outline of a sole and the room of an upper.

Frame: x across, y from the heel forward along the foot, z up from the floor, mm.  The room is a solid of cells under the
foot's heights, so drawn back towards the heel that the foot can slide out of it, longer at the toes; the outline is the
foot's print, closed over its arch.  Both are blurred signed distances, negative inside.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from scipy.ndimage import distance_transform_edt, gaussian_filter, grey_dilation, map_coordinates, spline_filter

from fabcraft.geometry.heights import front_heights
from fabcraft.geometry.implicit import GridField
from fabcraft.geometry.plane import Plane
from fabcraft.geometry.voxels import Grid
from fabcraft.mesh import Mesh

Points = Float64[np.ndarray, "N 3"]

_PIXEL_MM, _CELL_MM = 1.0, 2.5
_MARGIN_MM = 40.0
_LOW = 0.36
"""Of the foot's length: what is higher is leg."""


@dataclass(frozen=True, eq=False)
class Frame:
    """Where a foot stands."""

    heel: Float64[np.ndarray, "3"]
    """On the floor under the hindmost point of the foot, mm."""
    axes: Float64[np.ndarray, "3 3"]
    """Unit rows: across, forward, up; right-handed."""
    length: float
    """Of the foot, mm."""

    def inside(self, points: Points) -> Points:
        """Points of the body's space in the frame."""
        return (points - self.heel) @ self.axes.T

    def outside(self, points: Points) -> Points:
        """Points of the frame in the body's space."""
        return points @ self.axes + self.heel


def standing(mesh: Mesh, heel: Float64[np.ndarray, "3"], toe: Float64[np.ndarray, "3"]) -> Frame:
    """The frame of the foot `mesh` that points from `heel` to `toe`."""
    forward = (toe - heel) * [1.0, 1.0, 0.0]
    forward = forward / np.linalg.norm(forward)
    axes = np.stack([np.cross(forward, [0.0, 0.0, 1.0]), forward, [0.0, 0.0, 1.0]])
    local = mesh.vertices @ axes.T
    low = local[local[:, 2] < local[:, 2].min() + _LOW * np.ptp(local[:, 1])]
    middle = 0.5 * (low[:, 0].min() + low[:, 0].max())
    floor = np.array([middle, low[:, 1].min(), low[:, 2].min()])
    return Frame(floor @ axes, axes, float(np.ptp(low[:, 1])))


@dataclass(frozen=True, eq=False)
class Last:
    """What a slipper is built around."""

    outline: Float64[np.ndarray, "H W"]
    """Spline coefficients of the distance from the print's outline."""
    plane: Plane
    """The grid of `outline`; its z is the frame's y."""
    room: GridField
    heights: Float64[np.ndarray, " M"]
    """Height of the foot over the floor along its middle, per mm of y from the heel."""

    def beside(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Distance from the outline of the print, negative on it."""
        column, row = (self.plane.to_pixels(points[:, :2]) - 0.5).T
        return map_coordinates(self.outline, [row, column], order=3, mode="nearest", prefilter=False)


def last(foot: Mesh, scale: float, behind: float, toe_mm: float, over_toes_mm: float, blur_mm: float) -> Last:
    """The last for a `foot` in its frame.

    scale : over a median man's foot.  behind : y from which on the room goes back straight, as a tunnel.
    toe_mm, over_toes_mm : room before and over the toes, beside what goes around the last.
    """
    pixel = _PIXEL_MM * scale
    length = float(foot.vertices[foot.vertices[:, 2] < _LOW * np.ptp(foot.vertices[:, 1]), 1].max())
    low = foot.submesh((foot.corners[:, :, 2] < _LOW * length).all(1))
    plane = Plane.around(low.vertices[:, :2], pixel, _MARGIN_MM * scale + 0.3 * length)
    heights = front_heights(Mesh(low.vertices[:, [0, 2, 1]] * [1.0, -1.0, 1.0], low.faces), plane)
    seen = np.isfinite(heights)
    y = plane.centres()[1]
    ahead = round(toe_mm / pixel)
    # towards the toes rows are counted down: a step forward is a step up in the image
    longer = _moved_forward(seen & (y > 0.55 * length), ahead)
    outline = _closed(seen | longer, 0.35 * length / pixel)
    beside = gaussian_filter(_signed(outline) * pixel, blur_mm / pixel)
    solid = _room(heights, plane, scale, behind, length, ahead, over_toes_mm)
    middle = np.abs(plane.centres()[0]) < 0.12 * length
    ridge = np.where(middle & seen, heights, 0.0).max(1)[::-1]
    start = plane.top_mm - plane.height * pixel
    along = np.interp(np.arange(0.0, length), start + (np.arange(len(ridge)) + 0.5) * pixel, ridge)
    return Last(spline_filter(beside, order=3, mode="nearest"), plane, _blurred(*solid, blur_mm), along)


def _room(
    heights: np.ndarray, plane: Plane, scale: float, behind: float, length: float, ahead: int, over_toes_mm: float
) -> tuple[Bool[np.ndarray, "X Y Z"], Grid]:
    """Cells under the foot, from its toes back to `behind` and straight on from there."""
    y = plane.centres()[1][:, 0]
    low = np.where(np.isfinite(heights), heights, -np.inf)
    over = np.where((y > 0.8 * length)[:, None], low + over_toes_mm, low)
    # longer by the room before the toes, then drawn back: what is ahead has to pass
    grown = over
    for step in range(1, ahead + 1):
        grown = np.maximum(grown, np.where((y > 0.6 * length + step * plane.pixel_mm)[:, None], np.roll(over, -step, axis=0), -np.inf))
    start = int(np.searchsorted(-y, -behind))
    swept = np.maximum.accumulate(grown[: start + 1], axis=0)
    tunnel = np.vstack([swept, np.repeat(swept[-1:], len(y) - start - 1, axis=0)])
    cell = _CELL_MM * scale
    grid = Grid.around(
        np.array([[plane.left_mm, y[-1], -20.0 * scale], [-plane.left_mm, y[0], _LOW * length + 40.0 * scale]]), cell, 0.0
    )
    centres = grid.positions(np.arange(grid.size))
    column, row = np.floor(plane.to_pixels(centres[:, :2])).astype(int).T
    inside = (column >= 0) & (column < plane.width) & (row >= 0) & (row < plane.height)
    top = np.full(grid.size, -np.inf)
    top[inside] = tunnel[row[inside], column[inside]]
    return (centres[:, 2] < top).reshape(grid.shape), grid


def _blurred(solid: Bool[np.ndarray, "X Y Z"], grid: Grid, blur_mm: float) -> GridField:
    """The distance to cells, smooth."""
    values = gaussian_filter(_signed(solid) * grid.cell_mm, blur_mm / grid.cell_mm, mode="nearest")
    return GridField(grid, spline_filter(values, order=3, mode="nearest"), False)


def _signed(mask: np.ndarray) -> np.ndarray:
    """Signed distance to the border between cells, in cells, negative inside."""
    return np.where(mask, 0.5 - distance_transform_edt(mask), distance_transform_edt(~mask) - 0.5)


def _closed(mask: np.ndarray, radius: float) -> np.ndarray:
    """The mask with every hollow that a disc of `radius` cannot enter."""
    grown = distance_transform_edt(~mask) <= radius
    return distance_transform_edt(grown) > radius


def _moved_forward(mask: np.ndarray, steps: int) -> np.ndarray:
    """The mask together with itself up to `steps` rows further forward."""
    return grey_dilation(mask.astype(np.uint8), footprint=np.ones((2 * steps + 1, 1)) * (np.arange(2 * steps + 1) >= steps)[:, None]) > 0
