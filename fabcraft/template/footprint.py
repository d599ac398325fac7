"""The foot as a last: seen from above in its own frame, the outline of a sole and the room of an upper.

Frame: x across, y from the heel forward along the foot, z up from the floor, mm.  The room is a solid of cells under the
foot's heights, so drawn back towards the heel that the foot can slide out of it, longer at the toes; the outline is the
foot's print, closed over its arch.  Both are blurred signed distances, negative inside.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.ndimage import (
    distance_transform_edt,
    gaussian_filter,
    gaussian_filter1d,
    grey_closing,
    map_coordinates,
    spline_filter,
)
from scipy.spatial import ConvexHull

from fabcraft.geometry.heights import front_heights
from fabcraft.geometry.implicit import GridField
from fabcraft.geometry.plane import Plane
from fabcraft.geometry.voxels import Grid
from fabcraft.mesh import Mesh

Points = Float64[np.ndarray, "N 3"]

_PIXEL_MM, _CELL_MM = 1.0, 2.5
_MARGIN_MM = 30.0
_SIDES_BACK, _HEEL = 0.11, 0.14
"""How much farther back than its top an upper ends at the sole, and where the sole is the heel's again, in lengths."""
_STEEPEST, _OVER_TOES = 0.26, 1.35
"""Height of the foot where an upper ends at the latest, over its length, and over the height of its toes."""
_PAST_END = 0.012
"""How far behind its end the upper's inner side still has to clear the foot, over the length."""
_CONVEX = 0.9
"""Of the sole's outline between the print (0) and its hull (1)."""
_SOFT = 0.035
"""Sigma, in lengths, of what evens the sides of the sole."""
_WALL_HIGH = 0.7
"""Least height of the room, over the height of the toes."""
_BETWEEN_TOES = 0.16
"""Hollows narrower than this share of the length are bridged by the upper."""
_DEEP_CELLS = 12
"""How far below the floor the room's grid goes."""
_PRINT, _LEG = 0.2, 1.35
"""What is under this height, over the foot's length, makes the outline behind; what is above this share of the greatest
height under an upper is leg."""
_UP = np.array([0.0, 0.0, 1.0])


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


def standing(mesh: Mesh, ball: Float64[np.ndarray, "3"]) -> Frame:
    """The frame of the foot `mesh`, which points from the middle of its heel to the middle of its `ball`."""
    floor = float(mesh.vertices[:, 2].min())
    print_ = mesh.vertices[
        mesh.vertices[:, 2] < floor + _PRINT * float(np.ptp(mesh.vertices[:, :2], axis=0).max())
    ]
    heel = 0.5 * (print_.min(0) + print_.max(0))
    for _ in range(3):  # a heel's hindmost point may lie to one side
        forward = (ball - heel) * [1.0, 1.0, 0.0]
        forward = forward / np.linalg.norm(forward)
        along = print_ @ forward
        back = print_[along < along.min() + 0.15 * np.ptp(along)]
        heel = 0.5 * (back.min(0) + back.max(0))
    axes = np.stack([np.cross(forward, _UP), forward, _UP])
    local = print_ @ axes.T
    middle = 0.5 * (local[:, 0].min() + local[:, 0].max())
    return Frame(np.array([middle, local[:, 1].min(), floor]) @ axes, axes, float(np.ptp(local[:, 1])))


@dataclass(frozen=True, eq=False)
class Last:
    """What a slipper is built around."""

    length: float
    """Of the foot, mm."""
    outline: Float64[np.ndarray, "H W"]
    """Spline coefficients of the distance from the print's outline."""
    plane: Plane
    """The grid of `outline`; its z is the frame's y."""
    room: GridField
    end: tuple[float, float]
    """(y, z) of the foot where the upper ends over its middle."""

    def beside(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Distance from the outline of the print, negative on it."""
        column, row = (self.plane.to_pixels(points[:, :2]) - 0.5).T
        return map_coordinates(self.outline, [row, column], order=3, mode="nearest", prefilter=False)


def last(
    foot: Mesh,
    length: float,
    scale: float,
    cover: float,
    toe_mm: float,
    over_toes_mm: float,
    off_leg_mm: float,
    blur_mm: float,
) -> Last:
    """The last for a `foot` in its frame.

    length : of the foot; scale : over a median man's.  cover : share of the length that the upper covers, less where the
    foot is too high for it.  toe_mm, over_toes_mm : room before and over the toes, beside what goes around the last.
    off_leg_mm : distance of the upper's end from where the leg rises.
    """
    pixel = _PIXEL_MM * scale
    low = foot.submesh(foot.corners[:, :, 2].max(axis=1) < _PRINT * length)
    plane = Plane.around(low.vertices[:, :2], pixel, _MARGIN_MM * scale + 0.3 * length)
    x, y = plane.centres()
    rows, ahead, toes = y[:, 0], round(toe_mm / pixel), y > 0.6 * length
    heights = _standing_heights(foot, plane)
    ridge = np.where((np.abs(x) < 0.12 * length) & np.isfinite(heights), heights, 0.0).max(1)
    toes_mm = float(ridge[(rows > 0.82 * length) & (rows < 0.92 * length)].max())
    end, leg = _upper_end(ridge, rows, length, cover, off_leg_mm, toes_mm)
    opening = end - _SIDES_BACK * length
    cut = float(foot.vertices[:, 2].max()) - 0.01 * length
    known = np.isfinite(heights) & (heights < min(leg, cut)) & (y > opening)
    seen = known | np.isfinite(front_heights(_laid(low), plane))
    left, right = _sides(_closed(_forward(seen, ahead, toes), 0.3 * length / pixel), rows, opening)
    columns = np.arange(plane.width)
    beside = gaussian_filter(_signed((columns >= left) & (columns <= right)) * pixel, 2.0 * blur_mm / pixel)
    between = round(_BETWEEN_TOES * length / pixel)
    over = grey_closing(np.where(known, heights, 0.0), (between, between))
    higher = over_toes_mm * np.clip((y / length - 0.6) / 0.3, 0.0, 1.0)
    over = _filled(over + higher, known, 2.0 * blur_mm / pixel)
    reached = np.where(_forward(known, ahead, toes), _forward(over, ahead, toes), -np.inf)
    swept = np.maximum.accumulate(reached, axis=0)  # what is ahead has to pass
    start = int(np.searchsorted(-rows, -(end - _PAST_END * length)))
    swept[start:] = swept[start]
    side = beside.copy()
    side[start:] = side[start]
    tops = _filled(swept, np.isfinite(swept), 1.5 * blur_mm / pixel)
    # walls stand upright before they bend over
    room = _room(side, np.maximum(tops, _WALL_HIGH * toes_mm), plane, _CELL_MM * scale, blur_mm)
    top = float(np.interp(end, rows[::-1], ridge[::-1]))
    return Last(length, spline_filter(beside, order=3, mode="nearest"), plane, room, (end, top))


def _upper_end(
    ridge: np.ndarray, rows: np.ndarray, length: float, cover: float, off_leg_mm: float, toes_mm: float
) -> tuple[float, float]:
    """y where an upper ends over the middle of the foot, as far back as asked or before the foot becomes too high; and the
    height from which on it is leg."""
    most = max(_STEEPEST * length, _OVER_TOES * toes_mm)
    end = float(rows[ridge > most].max(initial=0.0)) + off_leg_mm
    return float(np.clip(end, (1.0 - cover) * length, 0.85 * length)), _LEG * most


def _standing_heights(mesh: Mesh, plane: Plane) -> np.ndarray:
    """How high what stands on the floor is over every pixel: up to the first surface that looks up; -inf beside it.

    Seen from below, so that a leg or a belly that leans over the toes hides nothing.
    """
    upward = _laid(mesh.submesh(mesh.face_normals[:, 2] > 0.0))
    heights = -front_heights(upward, plane)
    return np.where(np.isfinite(heights), heights, -np.inf)


def _laid(mesh: Mesh) -> Mesh:
    """The mesh with its underside to the front."""
    return Mesh(mesh.vertices[:, [0, 2, 1]], mesh.faces)


def _filled(values: np.ndarray, known: np.ndarray, blur: float) -> np.ndarray:
    """The values, the nearest known ones where there are none, blurred."""
    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return gaussian_filter(values[tuple(nearest)], blur)


def _sides(
    mask: np.ndarray, rows: np.ndarray, opening: float
) -> tuple[Float64[np.ndarray, "H 1"], Float64[np.ndarray, "H 1"]]:
    """First and last column of the sole in every row: between the print and its hull, and wide enough to pass.

    Down to `opening` no row is narrower than the one before it; from there the sole narrows to the heel.
    """
    filled = mask.max(axis=1)
    first, end = int(filled.argmax()), int(len(filled) - 1 - filled[::-1].argmax())
    sides: list[Float64[np.ndarray, "H 1"]] = []
    for side in (mask.argmax(1), mask.shape[1] - 1 - mask[:, ::-1].argmax(1)):
        sign = 1.0 if len(sides) else -1.0
        out = sign * side[first : end + 1].astype(np.float64)
        index = np.arange(len(out), dtype=np.float64)
        ring = ConvexHull(
            np.column_stack([np.append(index, [0.0, index[-1]]), np.append(out, [out.min() - 1.0] * 2)])
        )
        corners = np.sort(ring.vertices[ring.vertices < len(out)])
        wide = _CONVEX * np.interp(index, corners, out[corners]) + (1.0 - _CONVEX) * out
        y = rows[first : end + 1]
        passing = np.maximum.accumulate(wide)
        at_opening = int(np.searchsorted(-y, -opening))
        share = np.clip((y - _HEEL * y[0]) / (opening - _HEEL * y[0]), 0.0, 1.0)
        heel = float(np.interp(_HEEL * y[0], y[::-1], wide[::-1]))
        waist = heel + np.sin(0.5 * np.pi * share) * (passing[at_opening] - heel)
        narrowing = np.where(share > 0.0, np.maximum(waist, wide), wide)
        wide = np.where(np.arange(len(y)) < at_opening, passing, narrowing)
        whole = np.full(len(filled), -np.inf)
        whole[first : end + 1] = gaussian_filter1d(wide, _SOFT * len(wide), mode="nearest")
        sides.append(sign * whole[:, None])
    return sides[0], sides[1]


def _forward(values: np.ndarray, steps: int, there: np.ndarray) -> np.ndarray:
    """The largest of the values at a pixel and up to `steps` behind it, where `there`; forward is up in the image."""
    grown = values.copy()
    for step in range(1, steps + 1):
        grown = np.where(there, np.maximum(grown, np.roll(values, -step, axis=0)), grown)
    return grown


def _room(
    side: Float64[np.ndarray, "H W"],
    tops: Float64[np.ndarray, "H W"],
    plane: Plane,
    cell_mm: float,
    blur_mm: float,
) -> GridField:
    """The blurred distance to what is within the outline (`side` < 0) and under the heights, also below the floor."""
    deep, top = _DEEP_CELLS * cell_mm, float(tops[side < 0.0].max()) + 0.5 * _DEEP_CELLS * cell_mm
    right, back = plane.left_mm + plane.width * plane.pixel_mm, plane.top_mm - plane.height * plane.pixel_mm
    grid = Grid.around(np.array([[plane.left_mm, back, -deep], [right, plane.top_mm, top]]), cell_mm, 0.0)
    down, across = np.gradient(tops, plane.pixel_mm)
    x, y, z = (grid.origin[k] + cell_mm * np.arange(grid.shape[k]) for k in range(3))
    columns = np.column_stack([axis.ravel() for axis in np.meshgrid(x, y, indexing="ij")])
    beside, height, steep = (
        plane.sample(values, columns).reshape(len(x), len(y), 1)
        for values in (side, tops, np.sqrt(1.0 + down**2 + across**2))
    )
    values = np.maximum(beside, (z - height) / steep)
    values = gaussian_filter(values, blur_mm / cell_mm, mode="nearest")
    return GridField(grid, spline_filter(values, order=3, mode="nearest"), False)


def _signed(mask: np.ndarray) -> np.ndarray:
    """Signed distance to the border between cells, in cells, negative inside."""
    return np.where(mask, 0.5 - distance_transform_edt(mask), distance_transform_edt(~mask) - 0.5)


def _closed(mask: np.ndarray, radius: float) -> np.ndarray:
    """The mask with every hollow that a disc of `radius` cannot enter."""
    grown = distance_transform_edt(~mask) <= radius
    return distance_transform_edt(grown) > radius
