"""`Body`: what an object is worn on: a closed skin with named places on it.

Frame: millimetres, Z up, right-handed; a person looks along -y and their left is +x.  Names of paired places
end in `_left` or `_right`, the wearer's side.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal

import numpy as np
from jaxtyping import Float64, Int, Int32, Int64
from scipy.sparse import coo_matrix, csr_matrix, identity
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fabcraft.body.parts import NECK_BELOW_ROOT_MM as NECK_BELOW_ROOT_MM  # where scans look for it
from fabcraft.body.parts import Cut, Plane, cut_of
from fabcraft.body.region import Region
from fabcraft.errors import InputError
from fabcraft.geometry.subdivide import halving_matrix, loop_matrix
from fabcraft.mesh import Mesh

_SLACK_MM = 40.0
"""Skin kept beyond a cut while a part is cropped, so that the rim of the crop is never in the part."""
_CLEAR_MM = 15.0
"""Landmarks nearer to a cut are left out: they belong to what was cut off."""
LEAST_CLEARANCE_MM = 0.4
"""Of an object to a character."""


@dataclass(frozen=True)
class Measured:
    """A measure that was asked for, and what became of it, mm."""

    asked_mm: float
    reached_mm: float
    words: str = ""
    """The size that was asked for, when it was not in millimetres: "US 7"."""


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
    cuts: Mapping[str, Cut] = field(default_factory=dict)
    """Where the parts of a body that is no person are cut off; those of people follow from their joints."""
    scale: float = 1.0
    """Of a part of a body that is no person: its size over a median man's."""
    asked: tuple[str, ...] = ()
    """Regions that the wearer's own contact file names."""
    unwearable: Mapping[str, str] = field(default_factory=dict)
    """Templates that do not go on this body, each with the reason in words."""
    measures: Mapping[str, Measured] = field(default_factory=dict)
    """What the body was asked to measure."""

    def __post_init__(self) -> None:
        for name in ("landmarks", "joints"):
            points = {key: np.array(value, dtype=np.float64) for key, value in getattr(self, name).items()}
            for point in points.values():
                point.setflags(write=False)
            object.__setattr__(self, name, MappingProxyType(points))
        for name in ("regions", "cuts", "unwearable", "measures"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def part(self, name: str) -> "Body":
        """The part `name` (`parts.PARTS`) as a body of its own, in the same coordinates, closed by flat cuts.

        Landmarks, joints and regions are those that lie on it, clear of the cuts, and refer to its mesh.
        Raises `InputError` for an unknown part, and for a body without the places it is cut by.
        """
        cut = self.cuts.get(name) or cut_of(name, self.name, self.joints, self.landmarks)
        return _cut_off(self, cut, f"{self.name} {name}")

    def clearance_mm(self, person_mm: float) -> float:
        """What a distance of `person_mm` from a person's skin becomes here.

        A character's scales with its part, but not under 0.4 mm: printed parts that go over each other need that.
        """
        return max(person_mm * self.scale, LEAST_CLEARANCE_MM) if self.kind == "character" else person_mm


@dataclass(frozen=True, eq=False)
class PartSkin:
    """The skin of a part before it is cut and capped: smoothed, a little larger than the part."""

    coarse: Mesh
    """The faces of the body that make it up."""
    old_of_new: Int[np.ndarray, " C"]
    """Index in the body of every vertex of `coarse`."""
    matrix: csr_matrix
    """(V, C): from values at the vertices of `coarse` to those of `fine`, the vertices of `coarse` first."""
    fine: Mesh


def part_skin(body: Body, cut: Cut) -> PartSkin:
    """The skin of `body` round what `cut` will leave."""
    slack = tuple((point - _SLACK_MM * normal, normal) for point, normal in cut.planes)
    coarse, old_of_new = _crop(body.mesh, cut.crop or slack, cut.anchor)
    matrix, fine = _smoothed(coarse, body.smoothing + cut.finer if body.smoothing else 0, cut.longest_mm)
    return PartSkin(coarse, old_of_new, matrix, fine)


def _cut_off(body: Body, cut: Cut, name: str) -> Body:
    """What lies within the planes of `cut`, smoothed and capped."""
    skin = part_skin(body, cut)
    coarse, fine = skin.coarse, skin.fine
    landmarks = _follow(body.landmarks, coarse.vertices, fine.vertices[: len(coarse.vertices)])
    part = cut_within(fan_closed(fine), cut.planes, cut.anchor)
    index = _vertex_map(fine.vertices, part.vertices)
    regions = {
        key: moved
        for key, region in body.regions.items()
        if (moved := _moved(region, skin, index)) is not None
    }
    inside, clear = _box_within(part, cut.planes), _box_within(part, cut.planes, _CLEAR_MM * cut.scale)
    return replace(
        body,
        name=name,
        mesh=Mesh(part.vertices, part.faces, name),
        landmarks={key: point for key, point in landmarks.items() if clear(point)},
        joints={
            key: point for key, point in body.joints.items() if inside(point) or key in cut.measured_from
        },
        regions=regions,
        smoothing=0,
        scale=cut.scale,
    )


def _moved(region: Region, skin: PartSkin, index: np.ndarray) -> Region | None:
    """The region on the part's mesh; None where it is not, or not wholly, part of it.

    index : of the vertices of the fine skin in the part, -1 where they were cut off.
    """
    inside, emphasis = np.zeros(len(skin.old_of_new)), np.zeros(len(skin.old_of_new))
    place = np.searchsorted(region.vertex_indices, skin.old_of_new)
    place = np.minimum(place, len(region.vertex_indices) - 1)
    member = region.vertex_indices[place] == skin.old_of_new
    inside[member], emphasis[member] = 1.0, region.emphasis[place[member]]
    share = skin.matrix @ inside
    chosen = np.flatnonzero(share > 0.5)
    if member.sum() < len(region.vertex_indices) or (index[chosen] < 0).any():
        return None
    return region.at(index[chosen], (skin.matrix @ emphasis)[chosen] / share[chosen])


def _box_within(mesh: Mesh, planes: Sequence[Plane], clear_mm: float = 0.0) -> Callable[[np.ndarray], bool]:
    """Whether a point lies in the box of `mesh`, on the kept side of the planes by `clear_mm`."""
    lower, upper = mesh.bounds

    def within(point: np.ndarray) -> bool:
        boxed = (point >= lower - 1e-6).all() and (point <= upper + 1e-6).all()
        return bool(boxed and all((point - at) @ normal >= clear_mm for at, normal in planes))

    return within


def _crop(mesh: Mesh, planes: Sequence[Plane], anchor: np.ndarray) -> tuple[Mesh, np.ndarray]:
    """The connected faces round `anchor` with a corner within every plane, and the old index of each vertex."""
    keep = np.ones(len(mesh.faces), dtype=bool)
    for point, normal in planes:
        keep &= ((mesh.vertices - point) @ normal > 0.0)[mesh.faces].any(1)
    faces = mesh.faces[keep]
    ends = faces[:, [0, 1, 1, 2]].reshape(-1, 2)
    graph = coo_matrix((np.ones(len(ends)), ends.T), shape=(len(mesh.vertices),) * 2)
    _, label = connected_components(graph, directed=False)
    used = np.unique(faces)
    nearest = used[np.linalg.norm(mesh.vertices[used] - anchor, axis=1).argmin()]
    kept = np.flatnonzero(keep)[label[faces[:, 0]] == label[nearest]]
    return mesh.submesh(kept), np.unique(mesh.faces[kept])


def _smoothed(mesh: Mesh, times: int, longest_mm: float) -> tuple[csr_matrix, Mesh]:
    """`mesh` after Loop subdivision and with long edges halved, and the matrix that carries vertex values to it."""
    matrix, faces = identity(len(mesh.vertices), format="csr"), mesh.faces
    for _ in range(times):
        step, faces = loop_matrix(faces, matrix.shape[0])
        matrix = step @ matrix
    while np.isfinite(longest_mm):
        step, halved = halving_matrix(matrix @ mesh.vertices, faces, longest_mm)
        if len(halved) == len(faces):
            break
        matrix, faces = step @ matrix, halved
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
    """The largest piece of the closed `mesh` above z = `z_mm`, closed by a flat cap."""
    return cut_within(mesh, [(np.array([0.0, 0.0, z_mm]), np.array([0.0, 0.0, 1.0]))])


def cut_within(mesh: Mesh, planes: Sequence[Plane], anchor: Float64[np.ndarray, "3"] | None = None) -> Mesh:
    """The piece of the closed `mesh` within all planes that is nearest to `anchor` (without one the largest),
    closed by flat caps (manifold3d).

    Raises `InputError` when `mesh` is not a closed manifold, or lies wholly beyond a plane.
    """
    import manifold3d

    solid = manifold3d.Manifold(
        manifold3d.Mesh64(mesh.vertices.astype(np.float64), mesh.faces.astype(np.uint64))
    )
    if solid.status() != manifold3d.Error.NoError:
        raise InputError(
            f"{mesh.name or 'the body'} is not a closed surface ({solid.status().name})",
            "Repair it in the program that made it.",
        )
    for point, normal in planes:
        solid = solid.trim_by_plane(tuple(normal.tolist()), float(point @ normal))
    pieces = solid.decompose()
    if not pieces:
        raise InputError(
            f"{mesh.name or 'the body'} lies wholly beyond where it would be cut",
            "Check its landmarks: the cut is measured from them.",
        )
    meshes = [piece.to_mesh64() for piece in pieces]
    if anchor is None:
        chosen = max(range(len(pieces)), key=lambda index: pieces[index].volume())
    else:
        away = [np.linalg.norm(one.vert_properties[:, :3] - anchor, axis=1).min() for one in meshes]
        chosen = int(np.argmin(away))
    vertices = np.array(meshes[chosen].vert_properties[:, :3])
    return Mesh(vertices, np.array(meshes[chosen].tri_verts, dtype=np.int32), mesh.name)


def _vertex_map(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """For every vertex of `before` its index in `after`, or -1 where it was cut away."""
    distance, nearest = cKDTree(after).query(before, distance_upper_bound=1e-6)
    return np.where(np.isfinite(distance), nearest, -1)
