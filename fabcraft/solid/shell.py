"""The wall of a fitted sheet: the inner side is the wearer's, the outer side is the drawing's.

The sheet is the middle of a wall of even thickness. On the outer side the relief's beads and cushions are added; on the
inner side, where the template rests on the body, a soft pad fills the gap to the skin, and the body's clearance, taken
out of the same field, gives the pad the shape of the face.
"""

import numpy as np
from jaxtyping import Float64
from scipy.ndimage import gaussian_filter, grey_dilation

from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.subdivide import loop_matrix
from fabcraft.guidance.inflate import Relief
from fabcraft.mesh import Mesh
from fabcraft.solid.sheet import SheetSide
from fabcraft.solid.slots import StrapSlot
from fabcraft.solid.thicken import SolidResult, SolidSettings, solidify
from fabcraft.template.template import Template

PAD_SKIRT_MM = 9.0
"""A pad runs out into the wall over about this width.  These lengths are a person's, and scale with the template."""
PAD_LIMIT_MM = 13.0
"""A gap deeper than this is left open; from 3 mm less the pad thins out."""
PAD_EDGE_MM, HARD_PAD_EDGE_MM = 1.5, 0.75
"""The edges of a pad, which lie on skin, are rounded over about this much; on a character, which does not give way when the
mask is taken off, over less: the rounding is material."""

PAD_ROOM_MM = 11.0
"""From this far inside every rim on, a pad has its full height."""


def shell(
    sheet: Mesh,
    template: Template,
    relief: Relief,
    body: SurfaceDistance,
    settings: SolidSettings,
    slots: tuple[StrapSlot, ...] = (),
) -> SolidResult:
    """The closed object around a fitted sheet (mm, faces to the viewer).

    slots : cut through the wall, see `strap_slots`.  Raises `SolidError` when no closed manifold comes out.
    """
    matrix, faces = loop_matrix(sheet.faces, len(sheet.vertices))
    # Loop's limit surface has no facets; its rim is a cubic spline through almost the same contour
    fine = Mesh(matrix @ sheet.vertices, faces, sheet.name)
    pads = _pads(template, relief)
    edge_mm = template.scale * (HARD_PAD_EDGE_MM if template.body.kind == "character" else PAD_EDGE_MM)
    front = template.front

    def outer_mm(points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        return relief.detail_at(points[:, [0, 2]])

    def inner_mm(points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        share = front.at(pads, points[:, [0, 2]])
        height = np.zeros(len(points))
        near = share > 1e-3
        if near.any():
            gap = body.signed(points[near]) - 0.5 * template.wall_mm
            # more than the gap: the clearance cuts the rest away, in the shape of the skin
            open_mm = (PAD_LIMIT_MM * template.scale - gap) / (3.0 * template.scale)
            height[near] = share[near] * smoothstep(open_mm) * np.maximum(gap + edge_mm, 0.0)
        return height

    def clearance_mm(points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        return front.at(front.clearance, points[:, [0, 2]])

    def hole_mm(points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        return np.min([slot.distance(points[:, [0, 2]]) for slot in slots], axis=0)

    side = SheetSide(outer_mm, inner_mm, edge_mm, hole_mm if slots else None)
    return solidify(fine, settings, body, side, clearance_mm)


def _pads(template: Template, relief: Relief) -> Float64[np.ndarray, "H W"]:
    """Share of the gap that is filled, per pixel of the front surface: 1 where it rests, 0 near any rim."""
    front = template.front
    pixel = front.plane.pixel_mm
    skirt = gaussian_filter(
        grey_dilation(front.contact, size=(5, 5)), 0.5 * PAD_SKIRT_MM * template.scale / pixel
    )
    x, z = front.plane.centres()
    inside = relief.room_at(np.column_stack([x.ravel(), z.ravel()])).reshape(x.shape)
    # a pad that reached a rim would show beside it, or narrow the view through an opening
    return smoothstep(1.4 * skirt - 0.1) * smoothstep((inside / template.scale - 3.0) / (PAD_ROOM_MM - 3.0))


def smoothstep(share: Float64[np.ndarray, "..."]) -> Float64[np.ndarray, "..."]:
    """0 below 0, 1 above 1, with no kink between."""
    clipped = np.clip(share, 0.0, 1.0)
    return clipped * clipped * (3.0 - 2.0 * clipped)
