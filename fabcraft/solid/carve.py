"""Clearance to the body for a solid: cut away what is nearer to the body than the clearance.

The cutter is the surface at clearance distance from the body, taken from the body's exact distance on a
grid over the solid, not a mesh whose vertices were moved: that one would lose the chords of its facets.
"""

import manifold3d
import numpy as np

from fabcraft.geometry.edges import split_edges
from fabcraft.geometry.voxels import BAND_CELLS, Grid, isosurface, narrow_band, samples
from fabcraft.mesh import Mesh
from fabcraft.solid.manifolds import to_manifold, to_mesh
from fabcraft.solid.sheet import KeepOut

_MARGIN_MM = 0.01


def clearance_min_mm(mesh: Mesh, keep: KeepOut) -> float:
    """Smallest distance to the body less the clearance, on points at most 1 mm apart; < 0: too near."""
    return float(keep.excess(split_edges(mesh, 1.0).vertices).min())


def carve(solid: manifold3d.Manifold, keep: KeepOut, cell_mm: float) -> manifold3d.Manifold:
    """The solid without what lies nearer to the body than the clearance."""
    mesh = to_mesh(solid)
    cutter = keep_out_mesh(mesh.bounds, keep, cell_mm)
    return solid if cutter is None else solid - to_manifold(cutter)


def keep_out_mesh(bounds: np.ndarray, keep: KeepOut, cell_mm: float) -> Mesh | None:
    """The space within the clearance of the body, cut to a box around `bounds`; None when it is empty."""
    lower, upper = bounds[0] - 2 * cell_mm, bounds[1] + 2 * cell_mm
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)

    def field(points: np.ndarray) -> np.ndarray:
        value: np.ndarray = (np.abs(points - middle) - half).max(1)
        inner = value <= 0.0  # outside of the box nobody asks how near the body is
        value[inner] = np.maximum(keep.excess(points[inner]) - _MARGIN_MM, value[inner])
        return value

    grid = Grid.around(np.stack([lower, upper]), cell_mm, 2 * cell_mm)
    marked = np.zeros(grid.shape, bool)
    body = keep.body.mesh
    reach = BAND_CELLS * cell_mm
    corners = body.corners
    around = ((corners.max(1) > lower - 20) & (corners.min(1) < upper + 20)).all(1)
    if around.any():
        points, owners = samples(corners[around], cell_mm)
        points = points + keep.clearance_mm(points)[:, None] * body.face_normals[around][owners]
        inside = ((points > lower - reach) & (points < upper + reach)).all(1)
        grid.near(points[inside], reach, marked)
    # The cut faces of the box are part of the surface wherever they lie in the body.
    for axis, plane in [(axis, float(side[axis])) for axis in range(3) for side in (lower, upper)]:
        nodes = grid.origin[axis] + cell_mm * np.arange(grid.shape[axis])
        marked[(slice(None),) * axis + (np.abs(nodes - plane) < 1.5 * cell_mm,)] = True
    volume = narrow_band(grid, marked, field)
    return isosurface(grid, volume) if (volume < 0).any() else None
