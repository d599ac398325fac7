"""A drawn object as an even plate: the fitted sheet is its front, its outline goes straight back behind it.

The plate is one distance field in picture space: within the outline, behind the front, before the back, edges rounded;
the body with its clearance, and what else must stay free, is taken out of the field before the surface is drawn.
"""

from collections.abc import Callable
from dataclasses import dataclass

import manifold3d
import numpy as np
from jaxtyping import Float64
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.heights import front_heights
from fabcraft.geometry.implicit import sheet as zero_surface
from fabcraft.geometry.implicit import smooth_common
from fabcraft.geometry.plane import Plane
from fabcraft.geometry.raster import silhouette_mask
from fabcraft.geometry.subdivide import loop_matrix
from fabcraft.guidance.inflate import Relief
from fabcraft.mesh import Mesh
from fabcraft.solid.manifolds import SPECK_MM3, joined, to_manifold, to_mesh, without_specks
from fabcraft.solid.simplify import simplify_manifold
from fabcraft.solid.thicken import SolidResult
from fabcraft.template.picture_space import PictureSpace
from fabcraft.template.template import Template

_CELL, _CELLS = 0.9, 3.0
"""Largest cell of the field's grid, picture units, and how many go through the plate at least."""
_PIXEL = 0.5
_STEP = 0.05
_ROUND_MM, _ROUND_SHARE = 0.5, 0.4
"""Radius of the edges: in mm, and at most this share of the plate's thickness."""
_BEYOND = 0.5
"""How far lenses are cut beyond the plate on either side, over its thickness."""
_LONG = 3.0
"""Longest edges of what is rolled, picture units."""


def slab(
    sheet: Mesh,
    plate: Template,
    relief: Relief,
    space: PictureSpace,
    carrier: Mesh,
    body: SurfaceDistance,
    clearance_mm: float,
    simplify_mm: float = 0.01,
) -> tuple[SolidResult, Mesh]:
    """(the carrier with the drawn plate, mm; the plate alone, in picture units).

    sheet : the fitted front, picture units.  body : of the wearer, mm.  Raises `SolidError` when no closed manifold
    comes out.
    """
    depth = space.scale * space.frame.depth_mm
    cell = min(_CELL, depth / _CELLS)
    shape = _Shape.of(sheet, plate, relief, depth, min(_ROUND_MM * space.scale, _ROUND_SHARE * depth))
    keep = [(SurfaceDistance(space.seen(body.mesh)), space.scale * clearance_mm)]
    if space.frame.free is not None:
        keep.append((SurfaceDistance(space.seen(space.frame.free)), 0.0))

    def field(points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        value = shape(points)
        near = np.flatnonzero(value < 2.0 * cell)
        for surface, clearance in keep:
            value[near] = np.maximum(value[near], clearance - surface.signed(points[near]))
        return value

    made = zero_surface(field, shape.bounds(4.0 * cell), cell, name=plate.name)
    alone, _ = without_specks(to_manifold(made), SPECK_MM3 * space.scale**3)
    small, _ = simplify_manifold(alone, 0.02 * cell, plate.name)
    whole = joined(carrier, small.with_vertices(space.outside(small.vertices)))
    if len(relief.openings) > 1:  # lenses; a single opening is the carrier's own bore
        for opening in relief.openings:
            whole = whole - _through(opening, depth, space)
    whole, specks = without_specks(whole, SPECK_MM3)
    mesh, tolerance = simplify_manifold(whole, simplify_mm, carrier.name)
    notes = (f"{specks} bodies or voids below {SPECK_MM3:g} mm³ dropped",) if specks else ()
    return SolidResult(mesh, notes, {"simplify_mm": tolerance, "volume_mm3": mesh.volume_mm3}), small


@dataclass(frozen=True, eq=False)
class _Shape:
    """The plate without what must stay free, a field in picture units."""

    plane: Plane
    outside: Float64[np.ndarray, "H W"]
    """Signed distance to the drawn outline and openings, positive outside."""
    front: Float64[np.ndarray, "H W"]
    """Height of the front, going on beyond the outline."""
    back: Float64[np.ndarray, "H W"]
    """Height of the back, which knows nothing of what swells in front."""
    detail: Callable[[Float64[np.ndarray, "N 2"]], Float64[np.ndarray, " N"]]
    radius: float

    @staticmethod
    def of(sheet: Mesh, plate: Template, relief: Relief, depth: float, radius: float) -> "_Shape":
        """From the fitted sheet, which is the middle of a wall: its rim is half a wall within the outline."""
        matrix, faces = loop_matrix(sheet.faces, len(sheet.vertices))
        fine = Mesh(matrix @ sheet.vertices, faces, plate.name)
        flat = fine.vertices[:, [0, 2]]
        half = 0.5 * plate.wall_mm
        plane = Plane.around(flat, _PIXEL, half + 8.0 * _CELL)
        inside = silhouette_mask(plane.to_pixels(flat), faces, plane.width, plane.height) >= 0.5
        centres = np.stack(plane.centres(), -1).reshape(-1, 2)
        away = cKDTree(_rim_points(flat, faces)).query(centres)[0].reshape(inside.shape)
        heights = front_heights(fine, plane)
        known = np.isfinite(heights)
        nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
        front = heights[tuple(nearest)] + half
        back = plate.front.base_at(centres).reshape(inside.shape) + half - depth
        return _Shape(plane, np.where(inside, -away, away) - half, front, back, relief.detail_at, radius)

    def __call__(self, points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        """Negative inside."""
        flat = points[:, [0, 2]]
        beside = self.plane.sample(self.outside, flat)
        before = -points[:, 1] - self.plane.sample(self.front, flat) - self.detail(flat)
        behind = points[:, 1] + self.plane.sample(self.back, flat)
        return smooth_common(np.maximum(before, behind), beside, 2.0 * self.radius)

    def bounds(self, margin: float) -> Float64[np.ndarray, "2 3"]:
        """A box around the plate."""
        x, z = self.plane.centres()
        within = self.outside < 0.0
        top, deep = float(self.front[within].max()) + 6.0, float(self.back[within].min())
        lower = np.array([x[within].min(), -top, z[within].min()]) - margin
        return np.stack([lower, np.array([x[within].max(), -deep, z[within].max()]) + margin])


def _rim_points(flat: Float64[np.ndarray, "V 2"], faces: np.ndarray) -> Float64[np.ndarray, "N 2"]:
    """Points all along the borders of a sheet."""
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(np.int64)
    code, twin = edges @ [len(flat), 1], edges[:, ::-1] @ [len(flat), 1]
    a, b = flat[edges[~np.isin(code, twin)]].transpose(1, 0, 2)
    share = np.linspace(0.0, 1.0, max(2, int(np.linalg.norm(b - a, axis=1).max() / _STEP)), endpoint=False)
    return (a[:, None] + share[None, :, None] * (b - a)[:, None]).reshape(-1, 2)


def _through(opening: Float64[np.ndarray, "N 2"], depth: float, space: PictureSpace) -> manifold3d.Manifold:
    """The prism of an opening, from before the plate to behind it, mm."""
    start, end = -_BEYOND * depth, (1.0 + _BEYOND) * depth
    upright = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, end], [0.0, 1.0, 0.0, 0.0]])
    prism = manifold3d.CrossSection([opening]).extrude(end - start).transform(upright)
    if space.frame.axis is not None:
        prism = prism.refine_to_length(_LONG)
    mesh = to_mesh(prism, "opening")
    return to_manifold(mesh.with_vertices(space.outside(mesh.vertices)))
