"""A fitted plate becomes part of the solid that carries it.

The plate's wall is made like a mask's, in picture space; what lies between it and the carrier is filled, and where it
hangs over the carrier's edge it is as thick as the printer needs. Mapped back to the body, it is one with the carrier.
"""

import numpy as np
from jaxtyping import Float64

from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.subdivide import loop_matrix
from fabcraft.guidance.inflate import Relief
from fabcraft.mesh import Mesh
from fabcraft.solid.manifolds import SPECK_MM3, joined, without_specks
from fabcraft.solid.sheet import SheetSide
from fabcraft.solid.simplify import simplify_manifold
from fabcraft.solid.thicken import SolidResult, SolidSettings, solidify
from fabcraft.template.picture_space import PictureSpace
from fabcraft.template.template import Template

FILL = 12.0
"""Deepest gap between plate and carrier that is filled, picture units."""
SUNK = 1.0
"""How far the filling reaches into the carrier, picture units: the two must overlap, not touch."""
CELL = 0.8


def mount(
    sheet: Mesh,
    plate: Template,
    relief: Relief,
    space: PictureSpace,
    carrier: Mesh,
    body: SurfaceDistance,
    least_mm: float,
    clearance_mm: float,
    simplify_mm: float = 0.01,
) -> tuple[SolidResult, Mesh]:
    """(the carrier with the plate on it, mm; the plate alone, in picture units).

    sheet : the fitted plate, picture units.  body : of the wearer in the body's space, mm.
    least_mm : thinnest that the plate may be where nothing is behind it.  clearance_mm : distance kept from the body.
    Raises `SolidError` when no closed manifold comes out.
    """
    matrix, faces = loop_matrix(sheet.faces, len(sheet.vertices))
    fine = Mesh(matrix @ sheet.vertices, faces, plate.name)
    front = plate.front
    behind = np.where(np.isfinite(front.skin), front.skin, -1e3)
    overhang = max(space.scale * least_mm - plate.wall_mm, 0.0)

    def outer(points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        return relief.detail_at(points[:, [0, 2]])

    def inner(points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        gap = -points[:, 1] - 0.5 * plate.wall_mm - front.at(behind, points[:, [0, 2]])
        filled = np.where(gap < FILL, np.maximum(gap, 0.0) + SUNK, 0.0)
        return np.maximum(filled, overhang)

    seen = SurfaceDistance(space.seen(body.mesh))
    settings = SolidSettings(
        wall_mm=plate.wall_mm,
        cell_mm=CELL,
        clearance_mm=space.scale * clearance_mm,
        simplify_mm=max(0.02, space.scale * simplify_mm),
    )
    made = solidify(fine, settings, seen, SheetSide(outer, inner))
    placed = made.mesh.with_vertices(space.outside(made.mesh.vertices))
    whole, _ = without_specks(joined(carrier, placed), SPECK_MM3)
    mesh, tolerance = simplify_manifold(whole, simplify_mm, carrier.name)
    numbers = {**made.numbers, "simplify_mm": tolerance, "volume_mm3": mesh.volume_mm3}
    return SolidResult(mesh, made.notes, numbers), made.mesh
