"""Between `Mesh` and manifold3d: the library whose meshes are closed and manifold by construction.

Double precision both ways. The result of a boolean is never welded again afterwards: merging vertices
that merely touch would break the manifold.
"""

from collections.abc import Sequence

import manifold3d
import numpy as np

from fabcraft.errors import SolidError
from fabcraft.mesh import Mesh

_PRINTS_TOGETHER_MM = 0.2
"""A gap that no printer keeps open."""
SPECK_MM3 = 0.5
"""Of an object made of parts, bodies and voids below this are what the parts have left over."""


def try_manifold(mesh: Mesh) -> manifold3d.Manifold | None:
    """The mesh as a manifold, or None when it is open, not manifold or without volume."""
    if len(mesh.faces) < 4:
        return None
    solid = manifold3d.Manifold(
        manifold3d.Mesh64(np.array(mesh.vertices), np.array(mesh.faces, dtype=np.uint64))
    )
    if solid.status() != manifold3d.Error.NoError or solid.is_empty() or solid.volume() <= 0:
        return None
    return solid


def to_manifold(mesh: Mesh) -> manifold3d.Manifold:
    """The mesh as a manifold.  Raises `SolidError` when it is not one."""
    solid = try_manifold(mesh)
    if solid is None:
        raise SolidError(
            f"{mesh.name or 'the mesh'} ({len(mesh.faces)} faces) is not a closed manifold with a volume",
            "Run `fabcraft solid` on it first.",
        )
    return solid


def to_mesh(solid: manifold3d.Manifold, name: str = "") -> Mesh:
    """A manifold as a `Mesh`.  Raises `SolidError` when an operation on it has failed."""
    if solid.status() != manifold3d.Error.NoError:
        raise SolidError(f"the boolean operation failed ({solid.status().name})", "Try a larger cell_mm.")
    arrays = solid.to_mesh64()
    return Mesh(arrays.vert_properties[:, :3].astype(np.float64), arrays.tri_verts.astype(np.int32), name)


def union(solids: Sequence[manifold3d.Manifold]) -> manifold3d.Manifold:
    """All solids as one; parts that do not touch stay parts."""
    if len(solids) == 1:
        return solids[0]
    return manifold3d.Manifold.batch_boolean(list(solids), manifold3d.OpType.Add)


def joined(carrier: Mesh, plate: Mesh) -> manifold3d.Manifold:
    """The carrier and a plate as one; what turns about a hinge goes on turning.

    Raises `SolidError` when a mesh is no closed manifold, and when the plate would join two parts of the carrier.
    """
    whole, added = to_manifold(carrier), to_manifold(plate)
    parts = whole.decompose()
    if (
        len(parts) > 1
        and sum(added.min_gap(part, _PRINTS_TOGETHER_MM) < _PRINTS_TOGETHER_MM for part in parts) > 1
    ):
        raise SolidError(
            f"the drawing would join parts of the {carrier.name} that have to move",
            "Move it away from the hinge (--left, --up), or make it smaller (--scale).",
        )
    return whole + added


def without_specks(solid: manifold3d.Manifold, least_mm3: float) -> tuple[manifold3d.Manifold, int]:
    """The solid without bodies and enclosed voids below `least_mm3`, and how many of them went."""
    bodies = solid.decompose()
    kept = [body for body in bodies if abs(body.volume()) >= least_mm3]
    if len(kept) == len(bodies):
        return solid, 0
    return manifold3d.Manifold.compose(kept), len(bodies) - len(kept)


def part_count(solid: manifold3d.Manifold) -> int:
    """Number of separate bodies; an enclosed void is not a body."""
    return sum(body.volume() > 0 for body in solid.decompose())
