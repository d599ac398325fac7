"""How deep a moving object presses into a body, pose by pose."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int64

from fabcraft.geometry.distance import SurfaceDistance


class Passage(NamedTuple):
    """The deepest place of every pose."""

    depth_mm: Float64[np.ndarray, " K"]
    """Beyond what the same point has at the first pose; 0 where nothing presses."""
    points: Int64[np.ndarray, " K"]
    """Index of the point of the object that is deepest."""
    places: Float64[np.ndarray, "K 3"]
    """Where that point is then, mm."""


def passage(
    points: Float64[np.ndarray, "N 3"], poses: Float64[np.ndarray, "K 4 4"], body: SurfaceDistance
) -> Passage:
    """Move `points` of an object, mm, through rigid `poses` past `body`; the first pose is its seat.

    Only what the way adds counts: what presses at the seat already is no matter of the way.
    """
    lower, upper = body.mesh.bounds
    seat = _depth(points, body)
    depth, deepest = np.zeros(len(poses)), np.zeros(len(poses), dtype=np.int64)
    places = np.tile(points[0], (len(poses), 1))
    for index, pose in enumerate(poses):
        moved = points @ pose[:3, :3].T + pose[:3, 3]
        near = np.flatnonzero((moved >= lower).all(1) & (moved <= upper).all(1))
        if len(near) == 0:
            continue
        extra = _depth(moved[near], body) - seat[near]
        worst = int(np.argmax(extra))
        if extra[worst] > 0.0:
            depth[index], deepest[index], places[index] = extra[worst], near[worst], moved[near[worst]]
    return Passage(depth, deepest, places)


def _depth(points: Float64[np.ndarray, "N 3"], body: SurfaceDistance) -> Float64[np.ndarray, " N"]:
    """How deep points are inside the body, mm; 0 outside, where the distance is not asked for."""
    depth, inside = np.zeros(len(points)), np.flatnonzero(body.inside(points))
    depth[inside] = body.closest(points[inside]).distances
    return depth
