"""Adaptive refinement: where a face was stretched it is split, edges are flipped, and new vertices slide into place.

Long features (ears, horns) come out of few faces; fixed connectivity leaves them a few stretched triangles. `refine` splits
edges that are too long at their middle, so boundary loops and genus cannot change, old vertices keep their number and
place in the list, and faces that are not to change do not. `carried` takes Adam's moments from the old faces to the new:
with J′ = (I + X′ W′ᵀ) J the gradient by X′ is G Aᵀ, A = W′ᵀ J W, G the gradient by J W, so first moments transform
with A and second ones with its squares, each with the share of the old face's area that the new one has.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float64, Int64

from fabcraft.fit.descend import Variables
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.operators import edge_faces
from fabcraft.geometry.poisson import PoissonSystem
from fabcraft.mesh import Mesh

_TOO_LONG = 4.0 / 3.0
_SLIVER = 1e-6


@dataclass(frozen=True, eq=False)
class Refined:
    """A refined mesh; its first vertices are those from before, in their order."""

    mesh: Mesh
    origin: Float64[np.ndarray, "V 3"]
    """Where every vertex was before anything was deformed; of a new one, about."""
    locked: Bool[np.ndarray, " F"]
    """Whether a face was not to change; those are the same corners as before."""
    split: int
    """Edges that were split."""


def refine(
    mesh: Mesh,
    origin: Float64[np.ndarray, "V 3"],
    locked: Bool[np.ndarray, " F"],
    edge_mm: float,
    stretched: float = 1.5,
    rounds: int = 24,
) -> Refined:
    """Split the edges that are longer than 4/3 of `edge_mm` and `stretched` times as long as at the `origin`.

    origin : where every vertex was before the deformation, mm.
    locked : faces that keep their corners; an edge of such a face is never split.
    The triangles around new vertices are mended.  Raises `InputError` for a surface that is not a manifold.
    """
    points, faces = mesh.vertices, mesh.faces.astype(np.int64)
    count, changed = 0, np.zeros(len(points), dtype=bool)
    for _ in range(rounds):
        edges, pairs = edge_faces(faces)
        now, before = (np.linalg.norm(p[edges[:, 0]] - p[edges[:, 1]], axis=1) for p in (points, origin))
        wanted = (now > _TOO_LONG * edge_mm) & (now > stretched * before)
        chosen = _edges_to_split(now, wanted, pairs, len(faces), locked)
        if len(chosen) == 0:
            break
        faces, locked = _split(faces, edges, pairs, chosen, locked, len(points))
        points, origin = (np.concatenate([p, p[edges[chosen]].mean(1)]) for p in (points, origin))
        changed = np.concatenate([changed, np.ones(len(chosen), dtype=bool)])
        changed[edges[chosen].ravel()] = True
        count += len(chosen)
        faces = _flip(points, faces, locked, changed, 3)
    if count:
        points = _relax(points, faces, locked, changed, SurfaceDistance(mesh))
        faces = _flip(points, faces, locked, changed, 5)
    return Refined(Mesh(points, faces.astype(np.int32), mesh.name), origin, locked, count)


def slivers(mesh: Mesh) -> Bool[np.ndarray, " F"]:
    """Faces without an area to speak of: under a millionth of their longest edge squared."""
    corners = mesh.corners
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(1)
    return np.asarray(mesh.face_areas <= _SLIVER * longest**2)


def carried(variables: Variables, old: PoissonSystem, now: Mesh, new: PoissonSystem) -> Variables:
    """The unknowns for a new system whose rest is the old one's surface as it is `now`: nothing, with Adam's moments.

    now : the old faces where they are now, in the optimiser's frame.
    """
    device = variables.offset.device
    rest = Variables.rest(len(new.faces), 3, device)
    if variables.moments is None:
        return rest
    centres = new.rest[new.faces].mean(1)
    parent = SurfaceDistance(now).closest(centres).faces
    bend = np.einsum("fdk,fdl->fkl", new.frames, old.restricted(now.vertices)[parent])
    share = np.minimum(new.areas / np.maximum(now.face_areas[parent], 1e-300), 1.0)
    ahead = torch.from_numpy(bend * share[:, None, None]).float().to(device)
    index = torch.from_numpy(parent).to(device)
    first, second, *translation = variables.moments
    moments = (
        torch.einsum("fdk,flk->fdl", first[index], ahead),
        torch.einsum("fdk,flk->fdl", second[index], ahead**2),
        translation[0],
        translation[1],
    )
    return Variables(rest.offset, rest.translation, moments, variables.step)


def _edges_to_split(
    lengths: np.ndarray, wanted: np.ndarray, pairs: np.ndarray, face_count: int, locked: np.ndarray
) -> Int64[np.ndarray, " N"]:
    """Wanted edges that no locked face has, each the longest such of its faces: no face is split twice."""
    first, second = pairs.T
    inner = second >= 0
    candidates = np.flatnonzero(wanted & ~locked[first] & ~(inner & locked[second]))
    # rank by length; of equal ones the lower number is first
    rank = np.full(len(lengths), -1, dtype=np.int64)
    rank[candidates[np.lexsort((-candidates, lengths[candidates]))]] = np.arange(len(candidates))
    best = np.full(face_count, -1, dtype=np.int64)
    np.maximum.at(best, first, rank)
    np.maximum.at(best, second[inner], rank[inner])
    mine = (best[first] == rank) & (~inner | (best[second] == rank))
    return candidates[mine[candidates]]


def _split(
    faces: np.ndarray,
    edges: np.ndarray,
    pairs: np.ndarray,
    chosen: np.ndarray,
    locked: np.ndarray,
    count: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Every chosen edge gets a vertex, numbered on from `count`; every face around it becomes two."""
    owners, middle = pairs[chosen].ravel(), np.repeat(count + np.arange(len(chosen)), 2)
    ends = np.repeat(edges[chosen], 2, axis=0)
    middle, ends, owners = middle[owners >= 0], ends[owners >= 0], owners[owners >= 0]
    corners = faces[owners]
    # turn each face so that its split edge runs from a to b
    apex = ((corners != ends[:, :1]) & (corners != ends[:, 1:])).argmax(1)
    a, b, c = (corners[np.arange(len(owners)), (apex + k) % 3] for k in (1, 2, 0))
    faces = faces.copy()
    faces[owners] = np.column_stack([a, middle, c])
    added = np.column_stack([middle, b, c])
    return np.concatenate([faces, added]), np.concatenate([locked, locked[owners]])


def _flip(
    points: np.ndarray, faces: np.ndarray, locked: np.ndarray, changed: np.ndarray, rounds: int
) -> np.ndarray:
    """Edges near new vertices are flipped where the other diagonal makes the better triangles (Delaunay)."""
    for _ in range(rounds):
        edges, pairs = edge_faces(faces)
        inner = (pairs[:, 1] >= 0) & changed[edges].any(1)
        inner[inner] = ~locked[pairs[inner]].any(1)
        index = np.flatnonzero(inner)
        a, b = edges[index].T
        one, other = pairs[index].T
        c = faces[one].sum(1) - a - b
        d = faces[other].sum(1) - a - b
        excess = _angle(points, c, a, b) + _angle(points, d, a, b) - np.pi
        better = (excess > 1e-3) & _stays_even(points, faces, one, other, a, b, c, d)
        # the other diagonal must not be an edge already
        size = len(points)
        known = edges[:, 0] * size + edges[:, 1]
        better &= ~np.isin(np.minimum(c, d) * size + np.maximum(c, d), known)
        order = np.flatnonzero(better)[np.argsort(-excess[better], kind="stable")]
        taken = _independent(one[order], other[order], c[order], d[order], len(faces))
        kept = order[taken]
        if len(kept) == 0:
            break
        faces = _flipped(faces, one[kept], other[kept], a[kept], b[kept], c[kept], d[kept])
    return faces


def _independent(
    one: np.ndarray, other: np.ndarray, c: np.ndarray, d: np.ndarray, count: int
) -> Bool[np.ndarray, " N"]:
    """The first of any that share a face, or would make the same edge."""
    used, made = np.zeros(count, dtype=bool), set()
    taken = np.zeros(len(one), dtype=bool)
    for index in range(len(one)):
        edge = (min(c[index], d[index]), max(c[index], d[index]))
        if used[one[index]] or used[other[index]] or edge in made:
            continue
        used[[one[index], other[index]]] = taken[index] = True
        made.add(edge)
    return taken


def _flipped(
    faces: np.ndarray,
    one: np.ndarray,
    other: np.ndarray,
    a: np.ndarray,
    b: np.ndarray,
    c: np.ndarray,
    d: np.ndarray,
) -> np.ndarray:
    """Faces (a, b, c) and (b, a, d), in either sense, become (a, d, c) and (d, b, c) in the same sense."""
    faces = faces.copy()
    place = (faces[one] == a[:, None]).argmax(1)
    forward = (faces[one[:, None], ((place + 1) % 3)[:, None]][:, 0] == b)[:, None]
    faces[one] = np.where(forward, np.column_stack([a, d, c]), np.column_stack([d, a, c]))
    faces[other] = np.where(forward, np.column_stack([d, b, c]), np.column_stack([b, d, c]))
    return faces


def _angle(points: np.ndarray, apex: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    u, v = points[a] - points[apex], points[b] - points[apex]
    return np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), (u * v).sum(1))


def _stays_even(
    points: np.ndarray,
    faces: np.ndarray,
    one: np.ndarray,
    other: np.ndarray,
    a: np.ndarray,
    b: np.ndarray,
    c: np.ndarray,
    d: np.ndarray,
) -> np.ndarray:
    """Whether a flip bends nothing: all four normals, before and after, look the same way within about 25 degrees."""
    corners = points[faces[one]], points[faces[other]]
    sense = np.where(faces[one, ((faces[one] == a[:, None]).argmax(1) + 1) % 3] == b, 1.0, -1.0)[:, None]
    after = (
        sense * np.cross(points[d] - points[a], points[c] - points[a]),
        sense * np.cross(points[b] - points[d], points[c] - points[d]),
    )
    before = [np.cross(k[:, 1] - k[:, 0], k[:, 2] - k[:, 0]) for k in corners]
    units = [n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-300) for n in (*before, *after)]
    mean = units[0] + units[1]
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-300)
    return np.all([(unit * mean).sum(1) > 0.9 for unit in units], axis=0)


def _relax(
    points: np.ndarray, faces: np.ndarray, locked: np.ndarray, changed: np.ndarray, surface: SurfaceDistance
) -> np.ndarray:
    """New vertices and their neighbours move to the middle of their neighbours, along the surface; rims stay."""
    edges, pairs = edge_faces(faces)
    fixed = ~changed
    fixed[edges[pairs[:, 1] < 0]] = True
    fixed[faces[locked]] = True
    free = np.flatnonzero(~fixed)
    both = np.concatenate([edges, edges[:, ::-1]])
    degree = np.bincount(both[:, 0], minlength=len(points))[:, None]
    now = points
    for _ in range(3):
        total = np.stack([np.bincount(both[:, 0], now[both[:, 1], k], len(now)) for k in range(3)], 1)
        moved = now.copy()
        moved[free] += 0.5 * (total[free] / degree[free] - now[free])
        moved[free] = surface.closest(moved[free]).points
        spoilt = _spoilt(now, moved, faces)
        for _ in range(8):
            if not spoilt.any():
                break
            moved[faces[spoilt]] = now[faces[spoilt]]
            spoilt = _spoilt(now, moved, faces)
        if spoilt.any():
            break
        now = moved
    return now


def _spoilt(before: np.ndarray, after: np.ndarray, faces: np.ndarray) -> Bool[np.ndarray, " F"]:
    """Faces that turned over or lost their area."""
    old, new = (
        np.cross(p[faces[:, 1]] - p[faces[:, 0]], p[faces[:, 2]] - p[faces[:, 0]]) for p in (before, after)
    )
    return (old * new).sum(1) <= 0.1 * (old * old).sum(1)
