"""One body from a file of several pieces.

A scan is one sheet with crumbs beside it: those are left out.  A modelled figure is put together from many closed
pieces (49 in a low-poly animal seen in the wild): they are united, exactly where every piece is a manifold
(manifold3d), else by the winding number on a grid.  Pieces that stand apart by a hair are bridged by growing the
surface and shrinking it again.
"""

from collections.abc import Sequence

import manifold3d
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from fabcraft.body.body import fan_closed
from fabcraft.body.scan_clean import largest, orderly, pieces
from fabcraft.errors import InputError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.edges import edge_uses
from fabcraft.geometry.voxels import BAND_CELLS, Grid, isosurface, narrow_band, samples
from fabcraft.mesh import Mesh, concatenate

_LARGE = 0.1
"""An open piece with this share of the area is no crumb."""
_NEARLY = 0.1
"""A piece is closed when at most this share of its triangles' sides is open."""
_CLOSED_AREA = 0.75
"""Closed pieces with this share of the area together make a figure, not a scan with crumbs."""
_WIDE = 0.15
"""Share of a piece's size above which an opening is where a scan ends."""
_CELLS = 180
"""Grid cells along the largest side."""
_GAP = 0.01
"""Share of the largest side up to which pieces that stand apart are bridged."""
_LOST = 0.02
"""Share of the volume that may be left out as loose."""
_MAX_PIECES = 2000


def assembled(mesh: Mesh) -> tuple[Mesh, tuple[str, ...]]:
    """(the one piece that `mesh` is, or all its pieces united; what was done, in sentences).

    Raises `InputError` when pieces that matter stay apart.
    """
    count, label = pieces(mesh)
    if count == 1:
        return mesh, ()
    areas = np.bincount(label, mesh.face_areas, count)
    main = int(areas.argmax())
    if areas[main] > _CLOSED_AREA * areas.sum() and _ends(mesh.submesh(label == main)):
        return mesh.submesh(label == main), (f"Loose pieces beside the scan were left out: {count - 1}.",)
    edges, uses = edge_uses(mesh.faces)
    sides = np.bincount(label, minlength=count) * 3
    closed = np.bincount(label, (uses[edges] == 1).sum(1), count) <= _NEARLY * sides
    if closed[main] or areas[closed].sum() > _CLOSED_AREA * areas.sum():
        if closed.sum() > _MAX_PIECES:
            raise InputError(
                f"{mesh.name} has {closed.sum():,} closed pieces, at most {_MAX_PIECES:,} are united",
                "Unite them in the program that made it.",
            )
        return _united(mesh, label, np.flatnonzero((areas > _LARGE * areas.sum()) | closed), closed)
    if (areas > _LARGE * areas.sum()).sum() > 1:
        return _united(mesh, label, np.flatnonzero(areas > _LARGE * areas.sum()), closed)
    return mesh.submesh(largest(mesh)), (f"Loose pieces beside the scan were left out: {count - 1}.",)


def _ends(piece: Mesh) -> bool:
    """Whether it has an opening as wide as those that a scan ends in."""
    edges, uses = edge_uses(piece.faces)
    face, corner = np.nonzero(uses[edges] == 1)
    sides = np.stack([piece.faces[face, corner], piece.faces[face, (corner + 1) % 3]])
    if not len(face):
        return False
    graph = coo_matrix((np.ones(len(face)), sides), shape=(len(piece.vertices),) * 2)
    count, label = connected_components(graph, directed=False)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, label[sides[0]], piece.vertices[sides[0]])
    np.maximum.at(high, label[sides[0]], piece.vertices[sides[0]])
    return bool((high - low).max() > _WIDE * piece.size_mm.max())


def _united(
    mesh: Mesh, label: np.ndarray, chosen: np.ndarray, closed: np.ndarray
) -> tuple[Mesh, tuple[str, ...]]:
    """The union of the `chosen` pieces as one closed surface."""
    parts = []
    for piece in chosen:
        part, _ = orderly(mesh.submesh(label == piece))
        parts.append(fan_closed(part) if closed[piece] else part)
    left = int(label.max()) + 1 - len(parts)
    loose = (f"Loose pieces beside the scan were left out: {left}.",) if left else ()
    if len(parts) == 1:
        return parts[0], loose
    note = f"Its {len(parts)} pieces were united"
    solid, how = _boolean(parts), "."
    if solid is None:
        solid, how = remeshed(concatenate(parts, mesh.name)), " on a grid."
    if _lost(solid) > _LOST:
        gap = _GAP * float(mesh.size_mm.max())
        solid, how = _bridged(solid, gap), f", and gaps up to {_GAP:.1%} of its size bridged."
    if (lost := _lost(solid)) > _LOST:
        raise InputError(
            f"{mesh.name} consists of {len(parts)} pieces, of which some stand apart: {lost:.0%} of its volume "
            "touches nothing of the rest",
            "Join the pieces in a modelling program, or keep only the one that is worn on.",
        )
    return solid.submesh(largest(solid)), (note + how, *loose)


def _boolean(parts: Sequence[Mesh]) -> Mesh | None:
    """The exact union; None when a piece is no manifold."""
    solids = [
        manifold3d.Manifold(manifold3d.Mesh64(np.array(part.vertices), part.faces.astype(np.uint64)))
        for part in parts
    ]
    if any(solid.status() != manifold3d.Error.NoError for solid in solids):
        return None
    union = manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add).to_mesh64()
    if not len(union.tri_verts):
        return None
    return Mesh(
        np.array(union.vert_properties[:, :3]), np.array(union.tri_verts, dtype=np.int32), parts[0].name
    )


def _lost(solid: Mesh) -> float:
    """Share of the volume outside the largest piece; hollows count for what they hold."""
    count, label = pieces(solid)
    a, b, c = solid.corners.transpose(1, 0, 2)
    volumes = np.abs(np.bincount(label, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0, count))
    return float(1.0 - volumes.max() / max(volumes.sum(), 1e-12))


def remeshed(mesh: Mesh) -> Mesh:
    """The closed surface around what `mesh` winds around, on a grid."""
    return _level(mesh, _cell(mesh), 0.0)


def _bridged(solid: Mesh, gap: float) -> Mesh:
    """`solid` grown until gaps up to `gap` close, and shrunk again if that made it one."""
    grown = _level(solid, _cell(solid), 0.5 * gap)
    return grown if _lost(grown) > _LOST else _level(grown.submesh(largest(grown)), _cell(solid), -0.5 * gap)


def _cell(mesh: Mesh) -> float:
    return float(mesh.size_mm.max()) / _CELLS


def _level(mesh: Mesh, cell: float, offset: float) -> Mesh:
    """The surface at the signed distance `offset` from `mesh`."""
    distance = SurfaceDistance(mesh)
    grid = Grid.around(mesh.bounds, cell, abs(offset) + 2 * cell)
    marked = np.zeros(grid.shape, dtype=bool)
    grid.near(samples(mesh.corners, cell)[0], abs(offset) + BAND_CELLS * cell, marked)
    volume = narrow_band(grid, marked, lambda points: distance.signed(points) - offset)
    return _simple(isosurface(grid, volume, mesh.name), 0.08 * cell)


def _simple(mesh: Mesh, tolerance: float) -> Mesh:
    """With fewer faces, nowhere farther than `tolerance`."""
    solid = manifold3d.Manifold(manifold3d.Mesh64(np.array(mesh.vertices), mesh.faces.astype(np.uint64)))
    thin = solid.simplify(tolerance).to_mesh64()
    if not len(thin.tri_verts):
        return mesh
    return Mesh(np.array(thin.vert_properties[:, :3]), np.array(thin.tri_verts, dtype=np.int32), mesh.name)
