"""Two solids become one, with a fillet where they meet; away from there their triangles stay as they are."""

import manifold3d
import numpy as np
from jaxtyping import Bool
from scipy.spatial import cKDTree

from fabcraft.errors import SolidError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.implicit import settled, smooth_union
from fabcraft.geometry.isotropic import isotropic_within
from fabcraft.mesh import Mesh

_FINE = 0.5
_AT_CUT_MM = 0.05
_BESIDE = 1.5
"""How far beside a fillet triangles are made anew, in edges."""


def melted(one: Mesh, other: Mesh, fillet_mm: float, edge_mm: float, name: str, half: bool = False) -> Mesh:
    """The union of two closed solids, rounded over about `fillet_mm` along the curves where their skins meet.

    Around those curves the triangles are made anew, about `edge_mm` long.
    half : the solid is half of a symmetric one, cut off at x = 0; that cut stays.
    Raises `SolidError` when the two do not meet, or are no closed manifolds.
    """
    union, from_one = _union(one, other, name)
    seam = _seam(union, from_one)
    if not seam.any():
        raise SolidError(f"two parts of the {name} do not meet", "Make them larger, or move them together.")
    curve = cKDTree(union.vertices[seam])
    reach = fillet_mm + _BESIDE * edge_mm
    sides = [SurfaceDistance(mesh) for mesh in (one, other)]

    def field(points: np.ndarray) -> np.ndarray:
        return smooth_union(sides[0].signed(points), sides[1].signed(points), fillet_mm)

    mesh = union
    # first onto the fillet with triangles small enough to follow it, then in triangles as they are wanted
    for length in (_FINE * edge_mm, _FINE * edge_mm, edge_mm):
        chosen = curve.query(mesh.corners.mean(1))[0] < reach
        if half:
            chosen = chosen & (mesh.corners[:, :, 0] > _AT_CUT_MM).all(1)
        mesh = isotropic_within(mesh, length, chosen)
        near = curve.query(mesh.vertices)[0] < reach
        moving = np.flatnonzero(near & (mesh.vertices[:, 0] > _AT_CUT_MM) if half else near)
        vertices = mesh.vertices.copy()
        loose = Mesh(vertices[moving], np.zeros((0, 3), np.int32))
        vertices[moving] = settled(loose, field, 0.4 * length, rounds=4).vertices
        mesh = mesh.with_vertices(vertices)
    return mesh


def _union(one: Mesh, other: Mesh, name: str) -> tuple[Mesh, Bool[np.ndarray, " F"]]:
    """The union, and which of its faces lie on `one`."""
    solids = [as_manifold(mesh, name) for mesh in (one, other)]
    first = solids[0].original_id()
    made = (solids[0] + solids[1]).to_mesh64()
    faces = np.array(made.tri_verts, dtype=np.int32)
    owner = np.repeat(np.array(made.run_original_id), np.diff(np.array(made.run_index)) // 3)
    return Mesh(np.array(made.vert_properties[:, :3]), faces, name), owner == first


def as_manifold(mesh: Mesh, name: str) -> manifold3d.Manifold:
    """A part of a template for booleans.  Raises `SolidError` when it is no closed manifold."""
    solid = manifold3d.Manifold(
        manifold3d.Mesh64(mesh.vertices.astype(np.float64), mesh.faces.astype(np.uint64))
    )
    if solid.status() != manifold3d.Error.NoError:
        raise SolidError(
            f"a part of the {name} is no closed manifold ({solid.status().name})", "Report this."
        )
    return solid.as_original()


def _seam(mesh: Mesh, from_one: Bool[np.ndarray, " F"]) -> Bool[np.ndarray, " V"]:
    """Vertices with faces of both solids."""
    touched = np.zeros((2, len(mesh.vertices)), dtype=bool)
    for side, own in enumerate((from_one, ~from_one)):
        touched[side, mesh.faces[own]] = True
    return touched[0] & touched[1]
