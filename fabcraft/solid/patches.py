"""Which parts of a surface bound a solid, and which are sheets without thickness.

A closed component is a solid. An open one is a solid only together with the other open ones, when their
common winding number says inside and outside clearly on both sides of most of its area and the opposite
wall is near. The winding number alone would not do: an open mask or helmet encloses more than 2 pi of
solid angle.
"""

from dataclasses import dataclass
from enum import Enum

import igl
import numpy as np
from jaxtyping import Bool, Float64

from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.edges import components, edge_uses
from fabcraft.mesh import Mesh

MOST_PIECES = 64
"""Above this many sheets they are thickened together, on one grid."""

_CLEAR, _SHARE = 0.25, 0.6


class Kind(Enum):
    """What a piece of the surface is."""

    SOLID = "solid"
    OPEN_SOLID = "solid with gaps"
    SHEET = "sheet"


@dataclass(frozen=True, eq=False)
class Piece:
    """A part of the input that is made solid on its own."""

    mesh: Mesh
    kind: Kind


def pieces(mesh: Mesh, wall_mm: float) -> list[Piece]:
    """The surface taken apart: each closed solid with its cavities, all open solids, each sheet."""
    labels = components(mesh.faces)
    edges, counts = edge_uses(mesh.faces)
    open_face = (counts[edges] % 2 == 1).any(1)
    is_open = np.isin(labels, labels[open_face])
    found = _closed(mesh, labels, ~is_open)
    if is_open.any():
        solid = _open_solids(mesh, labels, is_open, wall_mm)
        if solid.any():
            found.append(Piece(mesh.submesh(solid), Kind.OPEN_SOLID))
        sheets = np.unique(labels[is_open & ~solid])
        if len(sheets) > MOST_PIECES:
            found.append(Piece(mesh.submesh(is_open & ~solid), Kind.SHEET))
        else:
            found += [Piece(mesh.submesh(labels == label), Kind.SHEET) for label in sheets]
    return found


def _closed(mesh: Mesh, labels: np.ndarray, closed: np.ndarray) -> list[Piece]:
    """One piece per closed component that looks outward; inward ones inside another are its cavities."""
    shells = [mesh.submesh(labels == label) for label in np.unique(labels[closed])]
    shells = [shell for shell in shells if abs(shell.volume_mm3) > 1e-9]
    outward = [shell for shell in shells if shell.volume_mm3 > 0]
    inward = [shell for shell in shells if shell.volume_mm3 < 0]
    holders: list[list[Mesh]] = [[shell] for shell in outward]
    distances: dict[int, SurfaceDistance] = {}
    for shell in inward:
        home = None
        for number, holder in enumerate(outward):
            if (holder.bounds[0] < shell.bounds[0]).all() and (holder.bounds[1] > shell.bounds[1]).all():
                distances.setdefault(number, SurfaceDistance(holder))
                if distances[number].inside(shell.vertices).all() and (
                    home is None or holder.volume_mm3 < outward[home].volume_mm3
                ):
                    home = number
        if home is None:
            holders.append([Mesh(shell.vertices, shell.faces[:, ::-1], shell.name)])
        else:
            holders[home].append(shell)
    return [Piece(together(group, mesh.name), Kind.SOLID) for group in holders]


def together(meshes: list[Mesh], name: str) -> Mesh:
    """Several meshes as one, as separate parts."""
    counts = np.cumsum([0] + [len(part.vertices) for part in meshes])
    faces = [part.faces.astype(np.int64) + first for part, first in zip(meshes, counts[:-1], strict=True)]
    return Mesh(
        np.concatenate([part.vertices for part in meshes]), np.concatenate(faces).astype(np.int32), name
    )


def _open_solids(
    mesh: Mesh, labels: np.ndarray, is_open: np.ndarray, wall_mm: float
) -> Bool[np.ndarray, " F"]:
    """The faces of open components that nevertheless bound a solid."""
    part = mesh.submesh(is_open)
    thin = max(3 * wall_mm, 0.03 * float(np.linalg.norm(mesh.size_mm)))
    centres, normals, areas = part.corners.mean(1), part.face_normals, part.face_areas
    step = 0.02 * wall_mm
    distance = SurfaceDistance(part)
    clear = np.abs(distance.winding(centres + step * normals)) < _CLEAR
    clear &= np.abs(distance.winding(centres - step * normals) - 1) < _CLEAR
    near = clear & (inward_thickness(part, centres, normals) <= thin)
    local = labels[is_open]
    whole = np.maximum(np.bincount(local, areas), 1e-12)
    accepted = np.bincount(local, near * areas) / whole > _SHARE
    if accepted.any():
        # A narrow side between two near walls is far from its own opposite, but fits in between them.
        bounding = SurfaceDistance(part.submesh(accepted[local]))
        for label in np.unique(local[~accepted[local]]):
            side = part.submesh(local == label)
            gaps = bounding.closest(side.vertices[_rim(side)]).distances
            fits = (gaps < 0.25 * wall_mm).mean() > _SHARE
            clear_area = float((clear * areas)[local == label].sum())
            accepted[label] = fits and clear_area > _SHARE * whole[label]
    solid = np.zeros(len(mesh.faces), bool)
    solid[is_open] = accepted[local]
    return solid


def _rim(mesh: Mesh) -> np.ndarray:
    """Vertices on edges that have one face."""
    edges, counts = edge_uses(mesh.faces)
    single = counts[edges] == 1
    return np.unique(np.concatenate([mesh.faces[single], np.roll(mesh.faces, -1, axis=1)[single]]))


def inward_thickness(
    mesh: Mesh, points: Float64[np.ndarray, "N 3"], normals: Float64[np.ndarray, "N 3"]
) -> Float64[np.ndarray, " N"]:
    """Length of the ray from each point of the surface against its normal to the next face, mm; inf: none."""
    vertices, faces = np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int64)
    tree = igl.AABB()
    tree.init(vertices, faces)
    skip = 1e-4  # past the face that the ray starts from
    hit, length, _ = tree.intersect_ray_first(vertices, faces, points - skip * normals, -normals)
    return np.where(hit >= 0, length + skip, np.inf)
