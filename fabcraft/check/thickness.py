"""How thick is the wall everywhere?  The opening thickness, with an inward ray as second opinion.

T(p) is the largest t such that for every s <= t some ball of diameter s wholly inside the solid comes within
0.37 s of the surface point p. 0.37 = (sqrt 3 - 1)/2 is the gap that a ball leaves in the corner of a cube, so
right angles never count as thin, while wedges sharper than about 60 degrees do; "for every s" keeps a thin
rib from borrowing the ball of the block that it stands on.

Computed from tangent balls: the largest ball inside that touches the surface at a sample q has the diameter
D(q); it holds a smaller ball of every s <= D(q) at the same gap from p. So q vouches for p on the interval
[gap/0.37, D(q)], and T(p) is where the union of these intervals, begun at zero, first breaks off. Diameters
come from shrinking balls (Ma, Bae, Choi, "3D medial axis point approximation using nearest neighbors and the
normal field", 2012) against the exact distance to the mesh; intervals are joined level by level. Values stop
at `limit_mm`: thicker is not measured.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.spatial import cKDTree

from fabcraft.check.balls import (
    Balls,
    chosen,
    joined,
    levels_up_to,
    opening_values,
    spread,
    stopped_by_edge,
    tangent_balls,
)
from fabcraft.check.thin import ThinRegion, thin_regions, thinnest
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.rays import Rays
from fabcraft.mesh import Mesh

_FINE_SPACING = 0.15  # of the minimum wall, where edges need it
_MOST_SAMPLES = 100_000
_MOST_FINE = 1_000_000  # before those far from an edge are left out


@dataclass(frozen=True, eq=False)
class Thickness:
    """Wall thickness of a mesh, at samples spread evenly over its surface."""

    limit_mm: float
    """Values stop here."""
    points: Float64[np.ndarray, "N 3"]
    faces: Int64[np.ndarray, " N"]
    """Face of every sample."""
    areas: Float64[np.ndarray, " N"]
    """Surface that every sample stands for, mm²."""
    values_mm: Float64[np.ndarray, " N"]
    """Opening thickness at every sample."""
    ray_mm: Float64[np.ndarray, " N"]
    """Way from every sample through the wall along the normal."""
    thin: Bool[np.ndarray, " N"]
    """Samples under the minimum that holds for them."""
    regions: tuple[ThinRegion, ...]
    """Patches of at least `smallest_mm2`, the largest first."""

    @property
    def ok_share(self) -> float:
        """Share of the surface at or above the minimum wall."""
        return 1.0 - float(self.areas[self.thin].sum() / self.areas.sum())

    @property
    def min_mm(self) -> float:
        """The thinnest place of at least 1 mm² (or 0.1 % of a small surface), mm."""
        return thinnest(self.values_mm, self.areas)

    @property
    def ray_min_mm(self) -> float:
        """The same by the ray alone, but for the thinnest 1 %: at edges a slanting ray leaves early."""
        return thinnest(self.ray_mm, self.areas, at_least=0.01 * float(self.areas.sum()))

    def face_values(self, mesh: Mesh) -> Float64[np.ndarray, " F"]:
        """The thinnest sample of every face, mm; the limit for faces without area."""
        values = np.full(len(mesh.faces), self.limit_mm)
        np.minimum.at(values, self.faces, self.values_mm)
        return values

    def vertex_values(self, mesh: Mesh) -> Float64[np.ndarray, " V"]:
        """For a heat map: the mean over the faces around every vertex, mm."""
        corners = mesh.faces.reshape(-1)
        total = np.bincount(corners, np.repeat(self.face_values(mesh), 3), minlength=len(mesh.vertices))
        count = np.bincount(corners, minlength=len(mesh.vertices))
        return np.where(count > 0, total / np.maximum(count, 1), self.limit_mm)


def measure_thickness(
    mesh: Mesh,
    minimum_mm: float,
    supported_minimum_mm: float | None = None,
    limit_mm: float | None = None,
    smallest_mm2: float = 1.0,
    distance: SurfaceDistance | None = None,
) -> Thickness:
    """The opening thickness of a closed, outward-looking mesh against the minimum wall.

    `minimum_mm`: for walls with a free border; `supported_minimum_mm`: for the others (default the same);
    `limit_mm`: up to which thickness is measured (default twice the minimum); `smallest_mm2`: smaller patches
    are not listed. Edges finer than 0.15 of the minimum are not resolved.
    """
    supported_mm = minimum_mm if supported_minimum_mm is None else supported_minimum_mm
    need = max(minimum_mm, supported_mm)
    limit = max(2.0 * need if limit_mm is None else limit_mm, need)
    distance, rays, areas = distance or SurfaceDistance(mesh), Rays(mesh), mesh.face_areas
    coarse = max(0.2 * need, float(np.sqrt(areas.sum() / _MOST_SAMPLES)))
    balls = tangent_balls(mesh, spread(mesh, areas, coarse), distance, rays, limit)
    values = opening_values(balls, balls, levels_up_to(need, limit), limit, 0.5 * coarse)
    # Next to edges the coarse samples only suggest; finer ones decide wherever it is about the minimum.
    edge = stopped_by_edge(balls, 0.9, limit) & (balls.diameters < need)
    if edge.any():
        finer, spacing = _fine_balls(mesh, areas, balls.points[edge], need, limit, distance, rays)
        fine = joined(balls, finer)
        asked = edge | (values < need)
        slack = 0.7 * spacing
        values[asked] = opening_values(chosen(balls, asked), fine, levels_up_to(need, limit), limit, slack)
    thin, regions = thin_regions(balls, values, minimum_mm, supported_mm, coarse, smallest_mm2)
    return Thickness(
        limit_mm=limit,
        points=balls.points,
        faces=balls.faces,
        areas=balls.areas,
        values_mm=values,
        ray_mm=np.minimum(balls.ray_mm, limit),
        thin=thin,
        regions=regions,
    )


def _fine_balls(
    mesh: Mesh,
    areas: np.ndarray,
    edge_points: np.ndarray,
    need: float,
    limit: float,
    distance: SurfaceDistance,
    rays: Rays,
) -> tuple[Balls, float]:
    """Balls at finer samples around the points that an edge keeps under the minimum, and the samples' spacing, mm."""
    middles = mesh.corners.mean(1)
    reach = np.linalg.norm(mesh.corners - middles[:, None], axis=2).max(1) + 1.4 * need
    edges = cKDTree(edge_points, balanced_tree=False)
    gap, _ = edges.query(middles, distance_upper_bound=float(reach.max()), workers=2)
    near = gap <= reach
    spacing = max(_FINE_SPACING * need, float(np.sqrt(areas[near].sum() / _MOST_FINE)))
    samples = spread(mesh, areas, spacing, near)
    gap, _ = edges.query(samples[0], distance_upper_bound=1.4 * need, workers=2)
    kept = tuple(part[np.isfinite(gap)] for part in samples)
    return tangent_balls(mesh, kept, distance, rays, limit), spacing
