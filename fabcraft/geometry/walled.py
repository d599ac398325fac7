"""A wall from fields: a middle surface that ends somewhere, and what lies on both sides of it.

The middle surface is taken out of its field, cut where it ends, and meshed evenly; every vertex then goes along the field's
gradient to the outer and to the inner side.  Between the two, rows of points follow every edge over a half round, so that
rims are as smooth as the lines that they follow, however thin the wall is.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from fabcraft.geometry.implicit import settled, sheet, slope
from fabcraft.geometry.isotropic import clipped, isotropic
from fabcraft.geometry.operators import boundary_loops
from fabcraft.geometry.voxels import Field
from fabcraft.mesh import Mesh

_ROUNDS = 6
_SPREADS, _TOGETHER = 3, 0.35
"""How often points of a rim are moved apart, and below which share of the usual distance."""
_CELL = 0.6
"""Of the grid, over an edge."""
_STEP = 0.02
"""Of the differences that slopes are taken from, over an edge."""
_GROWTH = 0.5
"""How much longer edges become per length away from a rim."""


@dataclass(frozen=True, eq=False)
class Wall:
    """The fields of a wall, all mm, signed distances about."""

    middle: Field
    """0 on the middle surface, growing outward."""
    beyond: Field
    """Positive where the middle surface has ended."""
    outer: Field
    """Negative in the material, 0 on the outer side."""
    inner: Field
    """Negative in the material, 0 on the inner side."""
    rest: Field | None = None
    """The same of the inner side where it reaches farther in to rest on something."""
    resting: Field | None = None
    """How much it does, 0 to 1, over the middle surface; needed with `rest`."""
    squareness: Field | None = None
    """Of the rims' profile: 1 a half round (also without it), smaller squarer, 0 a flat edge."""
    detail: Field | None = None
    """Edge length wanted where the wall bends sharply."""
    least_mm: float = 0.0
    """Thickness that it has everywhere: where the sides come closer, the outer one gives way."""


def walled(
    wall: Wall,
    bounds: Float64[np.ndarray, "2 3"],
    edge_mm: float,
    rim_mm: float,
    mirrored: bool = False,
    name: str = "",
) -> tuple[Mesh, Bool[np.ndarray, " F"]]:
    """The closed wall within `bounds`, and which of its faces are on the inner side.

    edge_mm : about the length of edges.  rim_mm : the same at rims, along and across them.
    mirrored : the fields are symmetric to x = 0, and so will the mesh be, vertex by vertex.
    Raises `SolidError` when the middle surface is nowhere within the bounds.
    """
    found = sheet(wall.middle, bounds, _CELL * edge_mm, mirrored, name)
    found = clipped(found, -wall.beyond(found.vertices))

    def finer(points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        wanted = rim_mm + _GROWTH * np.maximum(-wall.beyond(points) - rim_mm, 0.0)
        return wanted if wall.detail is None else np.minimum(wanted, wall.detail(points))

    even = isotropic(found, edge_mm, finer=finer if rim_mm < edge_mm else None, mirrored=mirrored)
    step = _STEP * edge_mm
    even = settled(even, wall.middle, 0.5 * edge_mm)
    loops = boundary_loops(even.faces)
    points = np.array(even.vertices)
    ends = np.concatenate(loops)
    points[ends] = _on_both(points[ends], wall.middle, wall.beyond, step, 0.5 * edge_mm)
    for _ in range(_SPREADS):
        points[ends] = np.concatenate([_spread(points[loop]) for loop in loops])
        points[ends] = _on_both(points[ends], wall.middle, wall.beyond, step, 0.5 * edge_mm)
    if mirrored:
        points[ends, 0] = np.where(np.abs(even.vertices[ends, 0]) < 1e-9, 0.0, points[ends, 0])
    normals = slope(wall.middle, points, step)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    inward = _along(points, -normals, wall.inner, step)
    # fields are distances about; what is promised is measured
    outward = np.maximum(_along(points, normals, wall.outer, step), wall.least_mm - inward)
    if wall.rest is not None and wall.resting is not None:
        share = wall.resting(points)
        there = np.flatnonzero(share > 0.0)
        deep = _along(points[there], -normals[there], wall.rest, step)
        inward[there] += share[there] * np.maximum(deep - inward[there], 0.0)
    outer, inner = points + outward[:, None] * normals, points - inward[:, None] * normals
    count = len(points)
    vertices, faces = [outer, inner], [even.faces, even.faces[:, ::-1] + count]
    rows = max(
        3, round(0.5 * np.pi * float(np.linalg.norm(outer[ends] - inner[ends], axis=1).mean()) / rim_mm)
    )
    total = 2 * count
    for loop in loops:
        power = np.ones(len(loop)) if wall.squareness is None else wall.squareness(points[loop])
        rim = _rim(points, outer, inner, normals, loop, rows, power[:, None])
        numbers = np.vstack([loop, total + np.arange(rim.size // 3).reshape(rows - 1, -1), loop + count])
        vertices.append(rim.reshape(-1, 3))
        total += rim.size // 3
        faces.append(_strips(np.concatenate(vertices), numbers))
    mesh = Mesh(np.concatenate(vertices), np.concatenate(faces).astype(np.int32), name)
    inside = np.zeros(len(mesh.faces), dtype=bool)
    inside[len(even.faces) : 2 * len(even.faces)] = True
    return mesh, inside


def _on_both(
    points: np.ndarray, one: Field, other: Field, step_mm: float, reach_mm: float
) -> Float64[np.ndarray, "N 3"]:
    """The nearest places where both fields are zero, by Gauss and Newton's steps of least length."""
    points = points.copy()
    for _ in range(_ROUNDS):
        values = np.stack([one(points), other(points)], axis=1)
        rows = np.stack([slope(one, points, step_mm), slope(other, points, step_mm)], axis=1)
        gram = np.einsum("nix,njx->nij", rows, rows) + 1e-3 * np.eye(2)
        move = -np.einsum("nix,ni->nx", rows, np.linalg.solve(gram, values[..., None])[..., 0])
        length = np.linalg.norm(move, axis=1, keepdims=True)
        points += move * np.minimum(1.0, reach_mm / np.maximum(length, 1e-12))
    return points


def _spread(line: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, "N 3"]:
    """The closed line, points that have come nearly together moved along it to the middle of their neighbours.

    Rows of a rim that begin at two such points would cross.
    """
    before, after = np.roll(line, 1, axis=0), np.roll(line, -1, axis=0)
    ahead = np.linalg.norm(after - line, axis=1)
    close = np.minimum(ahead, np.roll(ahead, 1)) < _TOGETHER * np.median(ahead)
    return np.where(close[:, None], 0.5 * (before + after), line)


def _along(
    points: np.ndarray, directions: np.ndarray, side: Field, step_mm: float
) -> Float64[np.ndarray, " N"]:
    """How far along the rays leave the material, by Newton's steps."""
    way = np.zeros(len(points))
    for _ in range(_ROUNDS):
        here = points + way[:, None] * directions
        value = side(here)
        rise = (side(here + step_mm * directions) - value) / step_mm
        way = np.maximum(way - value / np.clip(rise, 0.3, 3.0), 0.0)
    return way


def _rim(
    points: np.ndarray,
    outer: np.ndarray,
    inner: np.ndarray,
    normals: np.ndarray,
    loop: np.ndarray,
    rows: int,
    power: np.ndarray,
) -> Float64[np.ndarray, "R N 3"]:
    """The points between the outer and the inner edge along a loop, over a half round."""
    middle, half = 0.5 * (outer[loop] + inner[loop]), 0.5 * (outer[loop] - inner[loop])
    radius = np.linalg.norm(half, axis=1, keepdims=True)
    along = points[np.roll(loop, -1)] - points[np.roll(loop, 1)]
    away = np.cross(along, normals[loop])
    up = half / radius
    away -= (away * up).sum(1, keepdims=True) * up
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    turn = np.pi * np.arange(1, rows)[:, None, None] / rows
    high, wide = np.sign(np.cos(turn)) * np.abs(np.cos(turn)) ** power, np.sin(turn) ** power
    return middle + radius * (high * up + wide * away)


def _strips(vertices: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Triangles between rows of vertex numbers (R, N), each closed to a ring; the first row runs as the faces beside it."""
    a, b = numbers[:-1], np.roll(numbers, -1, axis=1)[:-1]
    d, c = numbers[1:], np.roll(numbers, -1, axis=1)[1:]
    a, b, c, d = (array.ravel() for array in (a, b, c, d))
    shorter = np.linalg.norm(vertices[a] - vertices[c], axis=1) <= np.linalg.norm(
        vertices[b] - vertices[d], axis=1
    )
    first = np.where(shorter[:, None], np.stack([a, c, b], 1), np.stack([a, d, b], 1))
    second = np.where(shorter[:, None], np.stack([a, d, c], 1), np.stack([b, d, c], 1))
    return np.concatenate([first, second])
