"""`Tape`: a measured line on a skin, with how its length answers to a movement of the skin.

A girth is the convex hull of a section, as a tape lies; its points sit on edges of the mesh at fixed shares, so that
the length and its derivative can be taken again on another shape of the same mesh without cutting it anew.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull

from fabcraft.errors import InputError
from fabcraft.mesh import Mesh


@dataclass(frozen=True, eq=False)
class Tape:
    """A length, and where on the skin it was taken."""

    length_mm: float
    points: Float64[np.ndarray, "N 3"]
    """The line, mm; closed when it is a girth."""
    pull: Float64[np.ndarray, "M 3"]
    """Derivative of the length with respect to every point on the skin; M = N, or 0 where none is."""
    edges: Int64[np.ndarray, "M 2"]
    """Mesh vertices a, b of the edge that every point lies on; a = b at a vertex."""
    shares: Float64[np.ndarray, " M"]
    """Point = (1 - share) a + share b."""
    closed: bool = False
    joints: Mapping[str, Float64[np.ndarray, "3"]] = field(default_factory=dict)
    """Derivative with respect to joints, where the ends are no skin (pupils)."""


class Sections:
    """Tapes round the parallel sections of a mesh; what they share is computed once."""

    def __init__(self, mesh: Mesh, normal: Float64[np.ndarray, "3"]) -> None:
        """normal : square to the planes, of any length."""
        self._mesh, self._normal = mesh, normal / np.linalg.norm(normal)
        self._height = mesh.vertices @ self._normal
        corners = self._height[mesh.faces]
        self._lowest, self._highest = corners.min(1), corners.max(1)
        self._across = np.linalg.svd(self._normal[None])[2][1:]

    def girth(self, point: Float64[np.ndarray, "3"]) -> Tape:
        """The tape round the section loop nearest to `point` in the plane through it.

        Raises `InputError` where the plane misses the mesh.
        """
        mesh, level = self._mesh, float(point @ self._normal)
        crossed = mesh.faces[(self._lowest <= level) & (self._highest > level)]
        if not len(crossed):
            raise InputError(
                f"{mesh.name or 'the body'} has no skin where it is to be measured", "Check its landmarks."
            )
        edges = np.sort(crossed[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
        above = self._height > level  # a vertex in the plane counts as below it
        cuts = edges[above[edges].sum(2) == 1]  # two per face, in order
        code, which = np.unique(cuts @ np.array([2**32, 1]), return_inverse=True)
        ends = np.stack([code >> 32, code & (2**32 - 1)], axis=1)
        before, after = self._height[ends[:, 0]], self._height[ends[:, 1]]
        shares = (level - before) / (after - before)
        points = (
            mesh.vertices[ends[:, 0]] * (1 - shares)[:, None] + mesh.vertices[ends[:, 1]] * shares[:, None]
        )
        own = _loop(which.reshape(-1, 2), int(np.argmin(np.linalg.norm(points - point, axis=1))))
        hull = own[ConvexHull(points[own] @ self._across.T).vertices]  # in order round the loop
        line = points[hull]
        forward = np.roll(line, -1, axis=0) - line
        lengths = np.linalg.norm(forward, axis=1, keepdims=True)
        along = forward / np.maximum(lengths, 1e-12)
        pull = np.roll(along, 1, axis=0) - along
        return Tape(float(lengths.sum()), line, pull, ends[hull], shares[hull], closed=True)


def girth(mesh: Mesh, point: Float64[np.ndarray, "3"], normal: Float64[np.ndarray, "3"]) -> Tape:
    """The tape round the section loop nearest to `point` in the plane through it, square to `normal`.

    Raises `InputError` where the plane misses the mesh.
    """
    return Sections(mesh, normal).girth(point)


def _loop(pairs: Int64[np.ndarray, "P 2"], start: int) -> Int64[np.ndarray, " L"]:
    """The nodes connected with `start` by `pairs`, ascending."""
    count = int(pairs.max()) + 1
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    return np.flatnonzero(label == label[start])


def extent(mesh: Mesh, direction: Float64[np.ndarray, "3"], among: Bool[np.ndarray, " V"]) -> Tape:
    """The calliper distance between the extreme vertices of `among` along `direction`."""
    direction = direction / np.linalg.norm(direction)
    places = np.flatnonzero(among)
    along = mesh.vertices[places] @ direction
    ends = places[[along.argmin(), along.argmax()]]
    return Tape(
        float(np.ptp(along)),
        mesh.vertices[ends],
        np.stack([-direction, direction]),
        np.stack([ends, ends], axis=1),
        np.zeros(2),
    )


def between(mesh: Mesh, start: Float64[np.ndarray, "3"], end: Float64[np.ndarray, "3"]) -> Tape:
    """The straight distance between the vertices nearest to two landmarks."""
    ends = np.array([np.linalg.norm(mesh.vertices - point, axis=1).argmin() for point in (start, end)])
    line = mesh.vertices[ends]
    away = line[1] - line[0]
    length = float(np.linalg.norm(away))
    unit = away / max(length, 1e-12)
    return Tape(length, line, np.stack([-unit, unit]), np.stack([ends, ends], axis=1), np.zeros(2))


def shortest(tapes: list[Tape]) -> Tape:
    """The shortest of the tapes, the first of equals."""
    return min(tapes, key=lambda tape: tape.length_mm)


def longest(tapes: list[Tape]) -> Tape:
    """The longest of the tapes, the first of equals."""
    return max(tapes, key=lambda tape: tape.length_mm)
