"""Height fields in the front view: how far towards the viewer (-y, so h = -y, mm) a surface stands over each pixel.

Ray hits, the height of an offset surface, and the smoothest sheet over an obstacle.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Bool, Float64
from scipy.ndimage import gaussian_filter, grey_dilation
from scipy.sparse.linalg import LinearOperator, cg, splu

from fabcraft.geometry.plane import Plane
from fabcraft.geometry.raster import rasterize
from fabcraft.mesh import Mesh

_STIFF = 300.0
"""Of the springs that keep a sheet off its obstacle, beside a pull of 1."""
_ROUNDS = 30
_COARSEST = 4000
"""Pixels from which on a sheet is sought on a grid of half the resolution first."""
_ITERATIONS = 25
"""Of conjugate gradients: where more are needed, a new factorisation is cheaper."""
_SETTLING, _SETTLED = 1e-7, 1e-10
"""Residuals while it is sought which springs hold, and of the sheet in the end."""


def front_heights(mesh: Mesh, plane: Plane) -> Float64[np.ndarray, "H W"]:
    """Height of the frontmost surface over every pixel centre, mm; -inf where the view misses the mesh."""
    pixels = plane.to_pixels(mesh.vertices[:, [0, 2]])
    _, _, depth = rasterize(
        np.column_stack([pixels, mesh.vertices[:, 1]]), mesh.faces, plane.width, plane.height
    )
    return -depth.astype(np.float64)


def raised(
    heights: Float64[np.ndarray, "H W"], distance_mm: float, pixel_mm: float
) -> Float64[np.ndarray, "H W"]:
    """Height of the surface `distance_mm` in front of the given one: grey dilation by a ball, mm."""
    if distance_mm <= 0.0:
        return heights.copy()
    reach = int(np.floor(distance_mm / pixel_mm))
    rows, columns = np.mgrid[-reach : reach + 1, -reach : reach + 1] * pixel_mm
    square = distance_mm**2 - rows**2 - columns**2
    ball = np.sqrt(np.maximum(square, 0.0))
    low = -1e9
    filled = np.where(np.isfinite(heights), heights, low)
    grown = grey_dilation(filled, footprint=square >= 0, structure=ball, mode="nearest")
    return np.where(grown > 0.5 * low, grown, -np.inf)


def smoothest_over(
    obstacle: Float64[np.ndarray, "H W"],
    wanted: Float64[np.ndarray, "H W"],
    weight: Float64[np.ndarray, "H W"],
    pixel_mm: float,
    stiffness_mm: float,
    decay_mm: float,
) -> Float64[np.ndarray, "H W"]:
    """The smooth height m, mm, that minimises ∫ w (m − wanted)² + ℓ⁴ (Δm)² + ℓ⁴/d² |∇m|²  with m ≥ obstacle.

    The obstacle gives by a spring's little; `lifted_over` makes the promise exact.

    obstacle : -inf where nothing is in the way.  wanted, weight w : where the sheet should be, and how much (0..1).
    stiffness_mm ℓ : features narrower than about ℓ are bridged.  decay_mm d : where nothing is wanted the sheet goes on
    as (Δ² − Δ/d²) m = 0, so a slope dies out over d.  The obstacle is kept by an active set of stiff springs, which is
    sought on a grid of half the resolution first.
    """
    known = np.isfinite(wanted)
    pull, aim = np.where(known, weight, 0.0), np.where(known, wanted, 0.0)
    return _refined(_Sought(obstacle, aim, pull, pixel_mm, stiffness_mm, decay_mm))[0]


@dataclass(frozen=True, eq=False)
class _Sought:
    """The smoothest sheet that is sought, on one grid; names as in `smoothest_over`."""

    obstacle: Float64[np.ndarray, "H W"]
    aim: Float64[np.ndarray, "H W"]
    pull: Float64[np.ndarray, "H W"]
    pixel_mm: float
    stiffness_mm: float
    decay_mm: float

    def coarser(self) -> "_Sought":
        """The same on a grid of half the resolution."""
        aims = _halved(self.pull * self.aim, np.sum) / np.maximum(_halved(self.pull, np.sum), 1e-12)
        return replace(
            self,
            obstacle=_halved(self.obstacle, np.max),
            aim=aims,
            pull=_halved(self.pull, np.mean),
            pixel_mm=2.0 * self.pixel_mm,
        )


def _refined(sought: _Sought) -> tuple[Float64[np.ndarray, "H W"], Bool[np.ndarray, "H W"]]:
    """The sheet and where it rests, from coarse grids to the given one: each tells the next where to begin."""
    rows, columns = sought.obstacle.shape
    touched = np.zeros((rows, columns), dtype=bool)
    if sought.obstacle.size > _COARSEST:
        _, half = _refined(sought.coarser())
        touched = np.repeat(np.repeat(half, 2, axis=0), 2, axis=1)[:rows, :columns]
        touched &= np.isfinite(sought.obstacle)
    return _resting(sought, touched)


def _resting(
    sought: _Sought, touched: Bool[np.ndarray, "H W"]
) -> tuple[Float64[np.ndarray, "H W"], Bool[np.ndarray, "H W"]]:
    """The sheet of `smoothest_over`, and where it rests on the obstacle, by an active set that starts as `touched`.

    The springs of one round differ little from those of the first, whose factorisation preconditions all the others.
    """
    obstacle, pull, stiff = sought.obstacle, sought.pull, sought.stiffness_mm**4
    rows, columns = obstacle.shape
    laplace = _grid_laplacian(rows, columns) / sought.pixel_mm**2
    bending = stiff * (laplace.T @ laplace) + (stiff / sought.decay_mm**2) * laplace
    below = np.isfinite(obstacle).ravel()
    floor = np.where(below, obstacle.ravel(), 0.0)
    active, height, factor = touched.ravel(), np.zeros(obstacle.size), None
    for _ in range(_ROUNDS):
        spring = _STIFF * active
        matrix = bending + sparse.diags(pull.ravel() + spring)
        right = (pull * sought.aim).ravel() + spring * floor
        if factor is not None:
            height, missed = cg(matrix, right, x0=height, rtol=_SETTLING, maxiter=_ITERATIONS, M=inverse)
        if factor is None or missed:  # too far from the round that was factorised
            factor = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
            inverse, height = LinearOperator(matrix.shape, factor.solve), factor.solve(right)
        # a spring that would have to pull downwards is let go; a point under the obstacle gets one
        changed = below & np.where(active, height <= floor + 1e-3, height < floor - 0.05)
        if (changed == active).all():
            break
        active = changed
    height, _ = cg(matrix, right, x0=height, rtol=_SETTLED, maxiter=_ITERATIONS, M=inverse)
    return height.reshape(rows, columns), active.reshape(rows, columns)


def _halved(
    values: Float64[np.ndarray, "H W"], pooled: Callable[..., np.ndarray]
) -> Float64[np.ndarray, "I J"]:
    """Blocks of 2 x 2 pixels made one; an odd last row or column is repeated."""
    rows, columns = values.shape
    even = np.pad(values, ((0, rows % 2), (0, columns % 2)), mode="edge")
    return pooled(even.reshape(even.shape[0] // 2, 2, even.shape[1] // 2, 2), axis=(1, 3))


def lifted_over(
    height: Float64[np.ndarray, "H W"], obstacle: Float64[np.ndarray, "H W"], pixel_mm: float, blend_mm: float
) -> Float64[np.ndarray, "H W"]:
    """`height` smoothed over `blend_mm` and lifted, in broad soft swells, until no pixel is under the obstacle, mm.

    The lift is the missing height, spread flat over three sigma and smoothed by one that is cut off at three: a mean of
    values that are each at least the missing height, so the promise is exact and no kink is left where the sheet rests.
    """
    sigma = blend_mm / pixel_mm
    soft = gaussian_filter(height, sigma, mode="nearest")
    missing = np.maximum(np.where(np.isfinite(obstacle), obstacle - soft, 0.0), 0.0)
    reach = int(3.0 * sigma + 0.5)
    # the filter's window is a square: the disc around it, or its corners would see less than the missing height
    across = int(np.ceil(reach * np.sqrt(2.0)))
    rows, columns = np.mgrid[-across : across + 1, -across : across + 1]
    spread = grey_dilation(missing, footprint=rows**2 + columns**2 <= across**2, mode="nearest")
    return soft + gaussian_filter(spread, sigma, mode="nearest", radius=reach)


def _grid_laplacian(rows: int, columns: int) -> sparse.csr_matrix:
    """Positive semi-definite 5-point Laplacian of the pixel grid with free (Neumann) borders."""

    def second_difference(count: int) -> sparse.csr_matrix:
        first = sparse.diags([-np.ones(count - 1), np.ones(count - 1)], [0, 1], shape=(count - 1, count))
        return (first.T @ first).tocsr()

    return (
        sparse.kron(sparse.identity(rows), second_difference(columns))
        + sparse.kron(second_difference(rows), sparse.identity(columns))
    ).tocsr()
