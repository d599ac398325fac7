"""Surfaces where a function of space is zero: smooth distances to a body, and the closed skin of a field.

Convention: negative inside, and near the surface about one millimetre of value for a millimetre of way, so that
`f − 3` is a wall's other side.  A wall round a middle surface m = 0 that ends where e = 0 (e > 0 beyond the end) and
has half the thickness h is `round_wall`: hypot(m, max(e, 0)) − h, with a half round of radius h as its rim.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter

from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.voxels import Field, Grid, isosurface, narrow_band
from fabcraft.mesh import Mesh

_COARSER = 4
"""A field is sought on nodes this many cells apart first."""
_STEEP = 1.6
"""Steepest that a field may be in the places where the search may not miss its surface."""


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


def blurred_distance(
    mesh: Mesh,
    bounds: Float64[np.ndarray, "2 3"],
    blur_mm: float,
    cell_mm: float,
    mirrored: bool = False,
) -> GridField:
    """The signed distance to `mesh` within `bounds`, averaged over a ball of about `blur_mm` (a Gaussian's sigma).

    A mean of distances never changes faster than the way, so the space between two level sets is at least their difference.
    mirrored : the mesh is symmetric to x = 0, and half the work is done.
    """
    margin = 3.0 * blur_mm
    if mirrored:
        bounds = np.array(bounds)
        bounds[0, 0] = margin
    grid = Grid.around(bounds, cell_mm, margin)
    values = SurfaceDistance(mesh).signed(grid.positions(np.arange(grid.size))).reshape(grid.shape)
    if mirrored:  # from the nodes half a cell before the plane, the rest is reflected there
        first = round((0.5 * cell_mm - grid.origin[0]) / cell_mm)
        half = values[first:]
        values = gaussian_filter(np.concatenate([half[::-1], half]), blur_mm / cell_mm, mode="nearest")
        values = values[len(half) - 4 :]
        origin = (-3.5 * cell_mm, grid.origin[1], grid.origin[2])
        x, y, z = values.shape
        grid = Grid(origin, cell_mm, (x, y, z))
    else:
        values = gaussian_filter(values, blur_mm / cell_mm, mode="nearest")
    return GridField(grid, spline_filter(values, order=3, mode="nearest"), mirrored)


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


def skin(
    field: Field, bounds: Float64[np.ndarray, "2 3"], cell_mm: float, mirrored: bool = False, name: str = ""
) -> Mesh:
    """The surface where `field` is zero within `bounds`, by marching cubes, mm.

    mirrored : only x > 0 and a little beyond; the surface is open there.
    The field is sought on a coarse grid and worked out on the fine one near what was found.
    """
    bounds = np.array(bounds)
    if mirrored:
        bounds[0, 0] = 0.0
    coarse = Grid.around(bounds, _COARSER * cell_mm, 0.0)
    nodes = coarse.positions(np.arange(coarse.size))
    reach = 0.5 * np.sqrt(3.0) * _COARSER * cell_mm
    found = nodes[np.abs(field(nodes)) < _STEEP * reach]
    grid = Grid.around(bounds, cell_mm, 0.0)
    marked = np.zeros(grid.shape, dtype=bool)
    # a cube of fine nodes round every coarse one: together they leave no gap
    index = np.rint((found - np.array(grid.origin)) / cell_mm).astype(np.int64)
    span = np.arange(-(_COARSER // 2), _COARSER // 2 + 1)
    for offset in np.stack(np.meshgrid(span, span, span, indexing="ij"), -1).reshape(-1, 3):
        at = index + offset
        at = at[((at >= 0) & (at < grid.shape)).all(1)]
        marked[tuple(at.T)] = True
    return isosurface(grid, narrow_band(grid, marked, field), name)


def settled(mesh: Mesh, field: Field, reach_mm: float, rounds: int = 2) -> Mesh:
    """The vertices moved onto the surface where `field` is zero, by Newton's steps of at most `reach_mm`."""
    points = np.array(mesh.vertices)
    step = 0.05 * reach_mm
    for _ in range(rounds):
        value = field(points)
        slope = np.stack(
            [(field(points + way) - field(points - way)) / (2.0 * step) for way in step * np.eye(3)], axis=1
        )
        move = -(value / np.maximum((slope**2).sum(1), 0.25))[:, None] * slope
        length = np.linalg.norm(move, axis=1, keepdims=True)
        points += move * np.minimum(1.0, reach_mm / np.maximum(length, 1e-12))
    return mesh.with_vertices(points)
