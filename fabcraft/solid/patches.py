"""Which parts of a surface bound a solid, and which are sheets without thickness.

A closed component is a solid. An open one is a solid only together with the other open ones, when their
common winding number says inside and outside clearly on both sides of most of its area and the opposite
wall is near. The winding number alone would not do: an open mask or helmet encloses more than 2 pi of
solid angle.
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from jaxtyping import Bool, Float64
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.edges import components, edge_uses
from fabcraft.geometry.rays import Rays
from fabcraft.mesh import Mesh

MOST_PIECES = 64
"""Above this many sheets they are thickened together, on one grid."""

_CLEAR, _SHARE = 0.25, 0.6
_ASKED = 10_000
"""So many faces of a part, at most twice, say of it whether it bounds a solid."""
_NO_VOLUME = 1e-6  # mm, over the area


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
    fins = _fins(mesh)
    if fins.any() and not fins.all():
        return pieces(mesh.submesh(~fins), wall_mm) + pieces(mesh.submesh(fins), wall_mm)
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


def touching(mesh: Mesh) -> bool:
    """Whether more than two faces meet on an edge: solids side by side that the file tells as one."""
    return bool((edge_uses(mesh.faces)[1] > 2).any())


def _fins(mesh: Mesh) -> Bool[np.ndarray, " F"]:
    """Faces to be looked at apart: patches with a free border that stand on an edge of other faces."""
    edges, counts = edge_uses(mesh.faces)
    if (counts <= 2).all():
        return np.zeros(len(mesh.faces), bool)
    # Patches end where more than two faces meet: there every face gets an edge of its own.
    own = np.where(counts[edges] > 2, len(counts) + np.arange(edges.size).reshape(edges.shape), edges)
    owner = np.repeat(np.arange(len(mesh.faces)), 3)
    used, compact = np.unique(own.reshape(-1), return_inverse=True)
    joined = coo_array(
        (np.ones(len(owner), bool), (owner, compact + len(mesh.faces))),
        shape=(len(mesh.faces) + len(used),) * 2,
    )
    patch = connected_components(joined, directed=False)[1][: len(mesh.faces)]
    free = np.isin(patch, patch[(counts[edges] == 1).any(1)])
    branching = np.isin(patch, patch[(counts[edges] > 2).any(1)])
    return free & branching


def _closed(mesh: Mesh, labels: np.ndarray, closed: np.ndarray) -> list[Piece]:
    """One piece per closed component that looks outward; inward ones inside another are its cavities.

    One that encloses nothing lies flat on itself: a sheet.
    """
    shells = [mesh.submesh(labels == label) for label in np.unique(labels[closed])]
    flat = [shell for shell in shells if abs(shell.volume_mm3) <= _NO_VOLUME * shell.area_mm2]
    shells = [shell for shell in shells if abs(shell.volume_mm3) > _NO_VOLUME * shell.area_mm2]
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
    solids = [Piece(together(group, mesh.name), Kind.SOLID) for group in holders]
    return solids + [Piece(shell, Kind.SHEET) for shell in flat]


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
    local = labels[is_open]
    asked = _some_of_each(local)
    centres, normals = part.corners[asked].mean(1), part.face_normals[asked]
    of, areas = local[asked], part.face_areas[asked]
    step = 0.02 * wall_mm
    distance = SurfaceDistance(part)
    clear = np.abs(distance.winding(centres + step * normals)) < _CLEAR
    clear &= np.abs(distance.winding(centres - step * normals) - 1) < _CLEAR
    near = clear & (inward_thickness(part, centres, normals) <= thin)
    whole = np.maximum(np.bincount(of, areas), 1e-12)
    accepted = np.bincount(of, near * areas) / whole > _SHARE
    if accepted.any():
        # A narrow side between two near walls is far from its own opposite, but fits in between them.
        bounding = SurfaceDistance(part.submesh(accepted[local]))
        for label in np.unique(local[~accepted[local]]):
            side = part.submesh(local == label)
            gaps = bounding.closest(side.vertices[_rim(side)]).distances
            fits = (gaps < 0.25 * wall_mm).mean() > _SHARE
            clear_area = float((clear * areas)[of == label].sum())
            accepted[label] = fits and clear_area > _SHARE * whole[label]
    solid = np.zeros(len(mesh.faces), bool)
    solid[is_open] = accepted[local]
    return solid


def _some_of_each(labels: np.ndarray) -> np.ndarray:
    """Faces to be asked for all: every one of a small part, evenly every few of a large one."""
    order = np.argsort(labels, kind="stable")
    first = np.searchsorted(labels[order], labels[order])
    every = np.maximum(np.bincount(labels) // _ASKED, 1)[labels[order]]
    return np.sort(order[(np.arange(len(order)) - first) % every == 0])


def _rim(mesh: Mesh) -> np.ndarray:
    """Vertices on edges that have one face."""
    edges, counts = edge_uses(mesh.faces)
    single = counts[edges] == 1
    return np.unique(np.concatenate([mesh.faces[single], np.roll(mesh.faces, -1, axis=1)[single]]))


def inward_thickness(
    mesh: Mesh, points: Float64[np.ndarray, "N 3"], normals: Float64[np.ndarray, "N 3"]
) -> Float64[np.ndarray, " N"]:
    """Length of the ray from each point of the surface against its normal to the next face, mm; inf: none."""
    skip = 1e-3  # past the face that the ray starts from
    return Rays(mesh).distances(points - skip * normals, -normals) + skip
