"""A drawn object as an even plate: the fitted sheet's wall in front, its outline carried back behind it.

Openings go through what carries it too. What has to stay free for the body is taken out, with the body's clearance.
"""

import manifold3d
import numpy as np
from jaxtyping import Float64

from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.subdivide import loop_matrix
from fabcraft.guidance.inflate import Relief
from fabcraft.mesh import Mesh
from fabcraft.solid.manifolds import to_manifold, to_mesh, without_specks
from fabcraft.solid.sheet import SheetSide, smooth_normals
from fabcraft.solid.simplify import simplify_manifold
from fabcraft.solid.thicken import SolidResult, SolidSettings, solidify
from fabcraft.template.picture_space import PictureSpace
from fabcraft.template.template import Template

CELL = 0.8
_ROUND_MM = 0.5
"""Radius of the edges at the back."""
_STEPS = 5
_SPECK_MM3 = 0.5
_BEYOND = 0.5
"""How far openings are cut beyond the plate on either side, over its thickness."""
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
    matrix, faces = loop_matrix(sheet.faces, len(sheet.vertices))
    fine = Mesh(matrix @ sheet.vertices, faces, plate.name)

    def outer(points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        return relief.detail_at(points[:, [0, 2]])

    front = solidify(
        fine,
        SolidSettings(wall_mm=plate.wall_mm, cell_mm=CELL, simplify_mm=max(0.02, space.scale * simplify_mm)),
        None,
        SheetSide(outer),
    )
    depth = max(space.scale * space.frame.depth_mm, plate.wall_mm)
    alone = (
        to_manifold(front.mesh) + _filled(fine, depth) + _behind(relief, space, 0.5 * plate.wall_mm, depth)
    )
    grown = body.mesh.with_vertices(body.mesh.vertices + clearance_mm * smooth_normals(body.mesh))
    part = _placed(alone, space) - to_manifold(grown)
    if space.frame.free is not None:
        part = part - to_manifold(space.frame.free)
    whole = to_manifold(carrier) + part
    if len(relief.openings) > 1:  # lenses; a single one is the carrier's own bore
        for opening in relief.openings:
            cut = _prism(manifold3d.CrossSection([opening]), -_BEYOND * depth, (1.0 + _BEYOND) * depth)
            whole = whole - _placed(cut, space)
    whole, _ = without_specks(whole, _SPECK_MM3)
    mesh, tolerance = simplify_manifold(whole, simplify_mm, carrier.name)
    numbers = {**front.numbers, "simplify_mm": tolerance, "volume_mm3": mesh.volume_mm3}
    return SolidResult(mesh, front.notes, numbers), to_mesh(alone, plate.name)


def _filled(sheet: Mesh, depth: float) -> manifold3d.Manifold:
    """What is between the sheet, where it swells out, and an even back."""
    count = len(sheet.vertices)
    edges = sheet.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(np.int64)
    code, twin = edges @ [count, 1], edges[:, ::-1] @ [count, 1]
    a, b = edges[~np.isin(code, twin)].T
    sides = np.concatenate([np.column_stack([a, a + count, b]), np.column_stack([b, a + count, b + count])])
    back = sheet.vertices.copy()
    back[:, 1] = 0.9 * depth
    faces = np.concatenate([sheet.faces, sheet.faces[:, ::-1] + count, sides]).astype(np.int32)
    return to_manifold(Mesh(np.concatenate([sheet.vertices, back]), faces, "filling"))


def _behind(relief: Relief, space: PictureSpace, start: float, depth: float) -> manifold3d.Manifold:
    """The drawn shape from `start` back to `depth`, its edges there rounded."""
    shape = manifold3d.CrossSection([relief.outline, *relief.openings], manifold3d.FillRule.EvenOdd)
    radius = min(_ROUND_MM * space.scale, 0.4 * (depth - start))
    solids = []
    for turn in np.linspace(0.0, 0.5 * np.pi, _STEPS):
        inset, back = radius * (1.0 - np.sin(turn)), depth - radius * (1.0 - np.cos(turn))
        smaller = (
            shape.offset(-inset, manifold3d.JoinType.Round, circular_segments=48) if inset > 1e-9 else shape
        )
        if not smaller.is_empty():
            solids.append(_prism(smaller, start, back))
    return manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add)


def _prism(shape: manifold3d.CrossSection, start: float, end: float) -> manifold3d.Manifold:
    """A shape (x, z) of the picture, from y = start to y = end."""
    upright = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, end], [0.0, 1.0, 0.0, 0.0]])
    return shape.extrude(end - start).transform(upright)


def _placed(solid: manifold3d.Manifold, space: PictureSpace) -> manifold3d.Manifold:
    """A solid of the picture in the body's space, mm."""
    if space.frame.axis is not None:
        solid = solid.refine_to_length(_LONG)
    return solid.warp_batch(lambda points: space.outside(np.asarray(points, dtype=np.float64)))
