"""How much support an object needs as it lies: columns under its overhangs, in what a slicer extrudes for them.

A slicer lays columns as the lines of a grid inside a sheath, and their ends as dense layers; the numbers are PrusaSlicer's
defaults for a 0.4 mm nozzle.  Held against its own support volume in tests/test_geometry_support.py.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int32

from fabcraft.geometry.columns import support_columns
from fabcraft.mesh import Mesh
from fabcraft.profile import PrinterProfile

CELL_MM = (2.95, 1.0)
"""Side of a slicer's support grid (2.5 mm between lines of 0.45 mm), and the height that columns are counted in."""
BEAD_MM = 0.45
INTERFACE_MM = 0.6
"""Height of the dense layers between support and object: three of 0.2 mm."""
FIRST_MM = 0.2
"""Height of the first layer, which is dense too."""


@dataclass(frozen=True)
class Support:
    """The support of an object as it lies."""

    volume_mm3: float
    """What a slicer extrudes for it, about."""
    kept_mm2: float
    """Of the faces to be kept clean, the area that support touches, seen from above."""


def support_of(
    mesh: Mesh, profile: PrinterProfile, kept: Bool[np.ndarray, " F"] | None = None, columns: int = 160
) -> Support:
    """The support of `mesh` on the bed under its lowest point.

    kept : faces to be kept clean.  columns : along the longer side of the bed that it covers.
    """
    points = mesh.vertices - [0.0, 0.0, float(mesh.vertices[:, 2].min())]
    return support_at(points, mesh.faces, mesh.face_normals[:, 2], profile, kept, columns)


def support_at(
    points: Float64[np.ndarray, "V 3"],
    faces: Int32[np.ndarray, "F 3"],
    upward: Float64[np.ndarray, " F"],
    profile: PrinterProfile,
    kept: Bool[np.ndarray, " F"] | None,
    columns: int,
) -> Support:
    """`support_of` the faces over `points`, the lowest at z = 0; `upward`: z of their unit normals."""
    steep = upward < -np.sin(np.radians(min(profile.max_overhang_deg + 0.5, 89.9)))
    heights = points[:, 2]
    foot = 1.5 * profile.layer_mm
    resting = (heights[faces[:, 0]] <= foot) & (heights[faces[:, 1]] <= foot) & (heights[faces[:, 2]] <= foot)
    nowhere = np.zeros(len(faces), dtype=bool)
    side, rise = CELL_MM
    pixel = min(max(float(np.ptp(points[:, :2], axis=0).max()) / columns, 0.1), 0.5 * side)
    overhangs, clean = steep & ~resting, nowhere if kept is None else kept
    found = support_columns(points, faces, overhangs, clean, pixel, CELL_MM)
    area = side**2
    sparse = found.cells * rise * area * BEAD_MM / side
    sheath = found.sides * rise * side * BEAD_MM
    dense = area * (INTERFACE_MM * (found.tops + found.feet) + FIRST_MM * found.grounded)
    return Support(sparse + sheath + dense, found.kept_mm2)
