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


def girth(mesh: Mesh, point: Float64[np.ndarray, "3"], normal: Float64[np.ndarray, "3"]) -> Tape:
    """The tape round the section loop nearest to `point` in the plane through it.

    Raises `InputError` where the plane misses the mesh.
    """
    normal = normal / np.linalg.norm(normal)
    height = (mesh.vertices - point) @ normal
    height = np.where(np.abs(height) < 1e-9, 1e-9, height)  # a plane through a vertex is moved past it
    above = (height > 0.0)[mesh.faces]
    crossed = mesh.faces[(above[:, 0] != above[:, 1]) | (above[:, 1] != above[:, 2])]
    if not len(crossed):
        raise InputError(
            f"{mesh.name or 'the body'} has no skin where it is to be measured", "Check its landmarks."
        )
    edges = np.sort(crossed[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
    cuts = edges[(height[edges] > 0.0).sum(2) == 1]  # two per face, in order
    ends, which = np.unique(cuts, axis=0, return_inverse=True)
    shares = height[ends[:, 0]] / (height[ends[:, 0]] - height[ends[:, 1]])
    points = mesh.vertices[ends[:, 0]] * (1 - shares)[:, None] + mesh.vertices[ends[:, 1]] * shares[:, None]
    pairs = which.reshape(-1, 2)
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(points),) * 2)
    _, loop = connected_components(graph, directed=False)
    own = np.flatnonzero(loop == loop[np.argmin(np.linalg.norm(points - point, axis=1))])
    across = np.linalg.svd(normal[None])[2][1:]
    hull = own[ConvexHull(points[own] @ across.T).vertices]  # in order round the loop
    line = points[hull]
    forward = np.roll(line, -1, axis=0) - line
    lengths = np.linalg.norm(forward, axis=1, keepdims=True)
    along = forward / np.maximum(lengths, 1e-12)
    pull = np.roll(along, 1, axis=0) - along
    return Tape(float(lengths.sum()), line, pull, ends[hull].astype(np.int64), shares[hull], closed=True)


def extent(mesh: Mesh, direction: Float64[np.ndarray, "3"], among: Bool[np.ndarray, " V"]) -> Tape:
    """The calliper distance between the extreme vertices of `among` along `direction`.

    Raises `InputError` when there are none, as above the ears of a character whose ears end above its head.
    """
    direction = direction / np.linalg.norm(direction)
    places = np.flatnonzero(among)
    if not len(places):
        raise InputError(f"{mesh.name or 'the body'} has no skin to measure there", "Leave this measure out.")
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
