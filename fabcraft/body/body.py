"""`Body`: what an object is worn on: a closed skin with named places on it.

Frame: millimetres, Z up, right-handed; a person looks along -y and their left is +x.  Names of paired places
end in `_left` or `_right`, the wearer's side.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal

import numpy as np
from jaxtyping import Float64, Int32, Int64
from scipy.sparse import csr_matrix, identity
from scipy.spatial import cKDTree

from fabcraft.body.region import Region
from fabcraft.errors import InputError
from fabcraft.geometry.subdivide import loop_matrix
from fabcraft.mesh import Mesh

NECK_BELOW_ROOT_MM = 60.0
"""The head part ends this far below the neck root."""

_SLACK_MM = 40.0
"""Skin kept below the cut while the head is cropped, so that the rim of the crop is never in the part."""


@dataclass(frozen=True, eq=False)
class Body:
    """A closed skin, its landmarks (mm), regions and joints."""

    name: str
    mesh: Mesh
    landmarks: Mapping[str, Float64[np.ndarray, "3"]]
    """Named points; on the skin except the eye centres."""
    regions: Mapping[str, Region]
    """Named patches of `mesh`, with their contact rules."""
    kind: Literal["human", "scan", "character"]
    joints: Mapping[str, Float64[np.ndarray, "3"]] = field(default_factory=dict)
    """Named points inside the body: neck root, head, wrists, finger bones."""
    notes: tuple[str, ...] = ()
    """What was assumed or repaired, in sentences for the user."""
    smoothing: int = 0
    """How many times `part` subdivides the skin."""

    def __post_init__(self) -> None:
        for name in ("landmarks", "joints"):
            points = {key: np.array(value, dtype=np.float64) for key, value in getattr(self, name).items()}
            for point in points.values():
                point.setflags(write=False)
            object.__setattr__(self, name, MappingProxyType(points))
        object.__setattr__(self, "regions", MappingProxyType(dict(self.regions)))

    def part(self, name: str) -> "Body":
        """The part `name` as a body of its own, closed by a plane cut; landmarks and regions refer to it.

        `head` is head and neck down to 60 mm below the neck root, in the same coordinates.
        Raises `InputError` for any other name, and for a body without a neck root.
        """
        if name != "head":
            raise InputError(f"body {self.name} has no part '{name}'", "Parts: head.")
        if "neck_root" not in self.joints:
            raise InputError(
                f"body {self.name} has no neck root, so its head cannot be cut off",
                "Choose a body with a head (fabcraft bodies).",
            )
        return _above(self, self.joints["neck_root"][2] - NECK_BELOW_ROOT_MM, "head")


def _above(body: Body, floor_mm: float, name: str) -> Body:
    """`body` above the plane z = `floor_mm`, smoothed and capped."""
    lowered = floor_mm - _SLACK_MM
    crop, old_of_new = _faces_above(body.mesh, lowered)
    matrix, mesh = _smoothed(crop, body.smoothing)
    landmarks = _follow(body.landmarks, crop.vertices, (matrix @ crop.vertices)[: len(crop.vertices)])
    cut = cut_above(fan_closed(mesh), floor_mm)
    members = _vertex_map(mesh.vertices, cut.vertices)
    regions = {}
    for key, region in body.regions.items():
        inside = np.isin(old_of_new, region.vertex_indices).astype(np.float64)
        chosen = np.flatnonzero(matrix @ inside > 0.5)
        kept = members[chosen]
        if (kept >= 0).any():
            regions[key] = region.at(kept[kept >= 0])
    return replace(
        body,
        name=f"{body.name} {name}",
        mesh=Mesh(cut.vertices, cut.faces, f"{body.name} {name}"),
        landmarks={key: point for key, point in landmarks.items() if point[2] >= floor_mm},
        joints={key: point for key, point in body.joints.items() if _within(point, cut)},
        regions=regions,
        smoothing=0,
    )


def _within(point: np.ndarray, mesh: Mesh) -> bool:
    lower, upper = mesh.bounds
    return bool((point >= lower).all() and (point <= upper).all())


def _faces_above(mesh: Mesh, z_mm: float) -> tuple[Mesh, np.ndarray]:
    """The faces with a corner above `z_mm`, and the old index of every vertex kept."""
    keep = np.flatnonzero((mesh.corners[:, :, 2] > z_mm).any(1))
    return mesh.submesh(keep), np.unique(mesh.faces[keep])


def _smoothed(mesh: Mesh, times: int) -> tuple[csr_matrix, Mesh]:
    """`mesh` after Loop subdivision, with the matrix that carries vertex values to it."""
    matrix, faces = identity(len(mesh.vertices), format="csr"), mesh.faces
    for _ in range(times):
        step, faces = loop_matrix(faces, matrix.shape[0])
        matrix = step @ matrix
    return matrix, Mesh(matrix @ mesh.vertices, faces, mesh.name)


def _follow(points: Mapping[str, np.ndarray], before: np.ndarray, after: np.ndarray) -> dict[str, np.ndarray]:
    """Points on the skin move with their vertex; others (eye centres) stay."""
    if not points:
        return {}
    distance, nearest = cKDTree(before).query(np.stack(list(points.values())))
    moves = np.where((distance < 1.0)[:, None], after[nearest] - before[nearest], 0.0)
    return {key: point + move for (key, point), move in zip(points.items(), moves, strict=True)}


def rim_loops(faces: Int32[np.ndarray, "F 3"]) -> list[Int64[np.ndarray, " N"]]:
    """Boundary loops of an open mesh, each in the direction of the faces beside it; longest first."""
    directed = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(np.int64)
    code, reverse = directed @ [2**32, 1], directed[:, ::-1] @ [2**32, 1]
    followers: dict[int, list[int]] = {}
    for start, end in directed[~np.isin(code, reverse)].tolist():
        followers.setdefault(start, []).append(end)
    loops = []
    for start in sorted(followers):
        while followers[start]:  # more than once where two loops touch in a vertex
            loop = [start]
            while (step := followers[loop[-1]].pop()) != start:
                loop.append(step)
            loops.append(np.array(loop, dtype=np.int64))
    return sorted(loops, key=len, reverse=True)


def fan_closed(mesh: Mesh) -> Mesh:
    """Every boundary loop closed by a fan to its centroid; the old vertices keep their indices."""
    vertices, faces = [mesh.vertices], [mesh.faces]
    for loop in rim_loops(mesh.faces):
        centre = np.full(len(loop), len(mesh.vertices) + len(vertices) - 1)
        vertices.append(mesh.vertices[loop].mean(0)[None])
        faces.append(np.stack([np.roll(loop, -1), loop, centre], axis=1).astype(np.int32))
    return Mesh(np.concatenate(vertices), np.concatenate(faces), mesh.name)


def cut_above(mesh: Mesh, z_mm: float) -> Mesh:
    """The largest piece of the closed `mesh` above z = `z_mm`, closed by a flat cap (manifold3d).

    Raises `InputError` when `mesh` is not a closed manifold.
    """
    import manifold3d

    solid = manifold3d.Manifold(
        manifold3d.Mesh64(mesh.vertices.astype(np.float64), mesh.faces.astype(np.uint64))
    )
    if solid.status() != manifold3d.Error.NoError:
        raise InputError(f"{mesh.name or 'the body'} is not a closed surface ({solid.status().name})")
    pieces = solid.trim_by_plane((0.0, 0.0, 1.0), z_mm).decompose()
    if not pieces:
        raise InputError(f"{mesh.name or 'the body'} has nothing above z = {z_mm:.0f} mm")
    largest = max(pieces, key=lambda piece: piece.volume()).to_mesh64()
    vertices = np.array(largest.vert_properties[:, :3])
    return Mesh(vertices, np.array(largest.tri_verts, dtype=np.int32), mesh.name)


def _vertex_map(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """For every vertex of `before` its index in `after`, or -1 where it was cut away."""
    distance, nearest = cKDTree(after).query(before, distance_upper_bound=1e-6)
    return np.where(np.isfinite(distance), nearest, -1)
