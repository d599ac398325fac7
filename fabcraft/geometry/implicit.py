"""Surfaces where a function of space is zero: smooth distances to a body, and the closed skin of a field.

Convention: negative inside, and near the surface about one millimetre of value for a millimetre of way, so that
`f − 3` is a wall's other side.  A wall round a middle surface m = 0 that ends where e = 0 (e > 0 beyond the end) and
has half the thickness h is `round_wall`: hypot(m, max(e, 0)) − h, with a half round of radius h as its rim.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter
from scipy.spatial import ConvexHull

from fabcraft.errors import SolidError
from fabcraft.geometry.voxels import Field, Grid, isosurface
from fabcraft.mesh import Mesh

_COARSER = 4
"""A field is sought on nodes this many cells apart first."""
_ROWS = 4096
_NEAR = 3.0
"""Cells from the surface to which a field is worked out exactly."""


@dataclass(frozen=True, eq=False)
class GridField:
    """Values on a grid, cubic between the nodes, constant beyond them."""

    grid: Grid
    coefficients: Float64[np.ndarray, "X Y Z"]
    mirrored: bool
    """Whether the grid holds the half at x > 0 only."""

    def __call__(self, points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        """The field at points, mm."""
        places = points.copy()
        if self.mirrored:
            places[:, 0] = np.abs(places[:, 0])
        places = (places - np.array(self.grid.origin)) / self.grid.cell_mm
        return map_coordinates(self.coefficients, places.T, order=3, mode="nearest", prefilter=False)


def blurred(
    field: Field,
    bounds: Float64[np.ndarray, "2 3"],
    blur_mm: float,
    cell_mm: float,
    mirrored: bool = False,
) -> GridField:
    """The mean of `field` over a Gaussian of sigma `blur_mm`, within `bounds`, on a grid of `cell_mm`.

    A mean of distances never changes faster than the way, so the space between two of its level sets is at least the
    difference of the levels.  mirrored : the field is symmetric to x = 0, and half the work is done.
    """
    bounds = np.array(bounds)
    margin = 3.0 * blur_mm
    if mirrored:
        bounds[0, 0] = margin
    grid = Grid.around(bounds, cell_mm, margin)
    values = field(grid.positions(np.arange(grid.size))).reshape(grid.shape)
    if mirrored:  # what lies beyond the plane is reflected, and only a rim of it kept
        half = values[round((0.5 * cell_mm - grid.origin[0]) / cell_mm) :]
        values = gaussian_filter(np.concatenate([half[::-1], half]), blur_mm / cell_mm, mode="nearest")
        values = values[len(half) - 4 :]
        x, y, z = values.shape
        grid = Grid((-3.5 * cell_mm, grid.origin[1], grid.origin[2]), cell_mm, (x, y, z))
    else:
        values = gaussian_filter(values, blur_mm / cell_mm, mode="nearest")
    return GridField(grid, spline_filter(values, order=3, mode="nearest"), mirrored)


@dataclass(frozen=True, eq=False)
class Convex:
    """The convex hull of points as a field: the largest of the distances to its planes.

    Exact inside; outside it is the distance to the hull with its edges mitred instead of rounded.
    """

    normals: Float64[np.ndarray, "K 3"]
    offsets: Float64[np.ndarray, " K"]
    mirrored: bool
    """Whether it is symmetric to x = 0, and the planes are those that face x >= 0."""

    @staticmethod
    def around(points: Float64[np.ndarray, "N 3"], mirrored: bool = False) -> "Convex":
        """The hull of `points`, mm; with their mirror images where `mirrored`."""
        if mirrored:
            points = np.concatenate([points, points * [-1.0, 1.0, 1.0]])
        planes = np.unique(np.round(ConvexHull(points).equations, 9), axis=0)
        if mirrored:
            planes = planes[planes[:, 0] > -1e-6]
        return Convex(planes[:, :3], planes[:, 3], mirrored)

    def __call__(self, points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        """Signed distance, mm, negative inside."""
        if self.mirrored:
            points = np.column_stack([np.abs(points[:, 0]), points[:, 1:]])
        values = np.empty(len(points))
        for start in range(0, len(points), _ROWS):
            rows = slice(start, start + _ROWS)
            values[rows] = (points[rows] @ self.normals.T + self.offsets).max(1)
        return values


def round_wall(
    middle: Float[np.ndarray, " N"], beyond: Float[np.ndarray, " N"], half_mm: Float[np.ndarray, " N"] | float
) -> Float[np.ndarray, " N"]:
    """A wall of twice `half_mm` round the surface where `middle` is 0, rounded off where `beyond` passes 0."""
    return np.hypot(middle, np.maximum(beyond, 0.0)) - half_mm


def smooth_union(
    one: Float[np.ndarray, " N"], other: Float[np.ndarray, " N"], fillet_mm: float
) -> Float[np.ndarray, " N"]:
    """Both solids, with a fillet of about `fillet_mm` where they meet (Quilez's polynomial minimum)."""
    share = np.maximum(fillet_mm - np.abs(one - other), 0.0) / fillet_mm
    return np.minimum(one, other) - 0.25 * fillet_mm * share**2


def smooth_common(
    one: Float[np.ndarray, " N"], other: Float[np.ndarray, " N"], round_mm: float
) -> Float[np.ndarray, " N"]:
    """What is in both solids, with the edge between them rounded by about `round_mm`."""
    return -smooth_union(-one, -other, round_mm)


def sheet(
    field: Field, bounds: Float64[np.ndarray, "2 3"], cell_mm: float, mirrored: bool = False, name: str = ""
) -> Mesh:
    """The surface where `field` is zero within `bounds`, by marching cubes, mm; open where it leaves them.

    mirrored : only x > 0 and a little beyond.
    The field is worked out on a coarse grid everywhere, and on the fine one near what was found.
    Raises `SolidError` when it is zero nowhere.
    """
    bounds = np.array(bounds)
    if mirrored:
        bounds[0, 0] = 0.0
    coarse, fine = Grid.around(bounds, _COARSER * cell_mm, 0.0), Grid.around(bounds, cell_mm, 0.0)
    values = field(coarse.positions(np.arange(coarse.size))).reshape(coarse.shape)
    axes = [
        np.clip(
            (fine.origin[k] + cell_mm * np.arange(fine.shape[k]) - coarse.origin[k]) / coarse.cell_mm,
            0,
            coarse.shape[k] - 1,
        )
        for k in range(3)
    ]
    for axis, places in enumerate(axes):  # linear between coarse nodes, one axis after the other
        low = np.minimum(places.astype(int), values.shape[axis] - 2)
        share = (places - low).reshape([-1 if k == axis else 1 for k in range(3)])
        values = (1.0 - share) * np.take(values, low, axis) + share * np.take(values, low + 1, axis)
    near = np.flatnonzero(np.abs(values) < _NEAR * cell_mm)
    values.reshape(-1)[near] = field(fine.positions(near))
    return isosurface(fine, values, name)


def settled(mesh: Mesh, field: Field, reach_mm: float, rounds: int = 2) -> Mesh:
    """The vertices moved onto the surface where `field` is zero, by Newton's steps of at most `reach_mm`."""
    points = np.array(mesh.vertices)
    gradient = slope(field, points, 0.05 * reach_mm)
    for _ in range(rounds):
        move = -(field(points) / np.maximum((gradient**2).sum(1), 0.25))[:, None] * gradient
        length = np.linalg.norm(move, axis=1, keepdims=True)
        points += move * np.minimum(1.0, reach_mm / np.maximum(length, 1e-12))
    return mesh.with_vertices(points)


def met(
    field: Field, start: Float64[np.ndarray, "3"], direction: Float64[np.ndarray, "3"], reach_mm: float
) -> Float64[np.ndarray, "3"]:
    """The last place where `field` becomes positive on the way from `start`, mm.

    Raises `SolidError` when it does not on the first `reach_mm`.
    """
    along = np.linspace(0.0, reach_mm, 400)
    inside = field(start + along[:, None] * direction) < 0.0
    leaving = np.flatnonzero(inside[:-1] & ~inside[1:])
    if not len(leaving):
        raise SolidError("a ray meets no surface where one was expected", "Check the body's landmarks.")
    low, high = along[leaving[-1]], along[leaving[-1] + 1]
    for _ in range(40):
        middle = 0.5 * (low + high)
        if field((start + middle * direction)[None])[0] < 0.0:
            low = middle
        else:
            high = middle
    return start + low * direction


def slope(field: Field, points: Float64[np.ndarray, "N 3"], step_mm: float) -> Float64[np.ndarray, "N 3"]:
    """The gradient of `field` by central differences of `step_mm` either way."""
    ways = step_mm * np.eye(3)
    return np.stack([(field(points + way) - field(points - way)) / (2.0 * step_mm) for way in ways], axis=1)
