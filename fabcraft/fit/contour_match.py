"""Which point of a drawn contour each rim vertex belongs to: a monotone match (dynamic time warping).

A nearest-point match folds a rim where the drawing grows an ear: both flanks pick the same side. A monotone match walks
both contours once around and never turns back. Its seam is at the lowest point nearest the middle, which masks and
drawings of masks share.
"""

from typing import no_type_check

import numba as nb
import numpy as np
from jaxtyping import Float64
from scipy.optimize import isotonic_regression

from fabcraft.geometry.contour import counter_clockwise, sharp_corners


@nb.njit(cache=True)
@no_type_check
def _path(cost):
    rows, columns = cost.shape
    total = np.full((rows, columns), np.inf)
    step = np.zeros((rows, columns), dtype=np.int8)
    for i in range(rows):
        for j in range(columns):
            best, move = (0.0, 0) if i == 0 and j == 0 else (np.inf, 0)
            if i > 0 and j > 0 and total[i - 1, j - 1] < best:
                best, move = total[i - 1, j - 1], 0
            if i > 0 and total[i - 1, j] < best:
                best, move = total[i - 1, j], 1
            if j > 0 and total[i, j - 1] < best:
                best, move = total[i, j - 1], 2
            total[i, j] = best + cost[i, j]
            step[i, j] = move
    i, j = rows - 1, columns - 1
    sums, counts = np.zeros(rows), np.zeros(rows)
    while True:
        sums[i] += j
        counts[i] += 1.0
        if i == 0 and j == 0:
            break
        move = step[i, j]
        if move == 0:
            i, j = i - 1, j - 1
        elif move == 1:
            i -= 1
        else:
            j -= 1
    return sums / counts, total[rows - 1, columns - 1]


def seam(contour: Float64[np.ndarray, "N 2"]) -> int:
    """Index of the point to start from: low, and near the middle of the width."""
    width, height = np.ptp(contour, axis=0)
    middle = 0.5 * (contour[:, 0].min() + contour[:, 0].max())
    return int(
        np.argmin((contour[:, 1] - contour[:, 1].min()) / height + np.abs(contour[:, 0] - middle) / width)
    )


def match(
    rim: Float64[np.ndarray, "N 2"],
    target: Float64[np.ndarray, "M 2"],
    turn_weight: float = 0.15,
    spacing: float = 0.0,
    corner_reach: float | None = None,
) -> Float64[np.ndarray, "N 2"]:
    """For every rim point its place on the target contour, in order around.

    rim, target : closed contours, (x, up), any direction; the target about evenly sampled.
    turn_weight : how much the direction of the contour counts beside the squared distance (in units of the target's size).
    spacing : no two neighbours come nearer along the contour than this share of an even step, 0..1.
    corner_reach : a target corner (`sharp_corners`) takes the rim point nearest to it; None lets corners pass between.
    Each rim point gets the middle of the stretch of target that it was matched with.
    """
    target = counter_clockwise(target)
    forward = counter_clockwise(rim)
    reversed_ = forward is not rim
    start = seam(forward)
    ordered = np.roll(forward, -start, axis=0)
    size = float(np.ptp(target, axis=0).max())
    distance = ((ordered[:, None, :] - target[None, :, :]) ** 2).sum(-1) / size**2
    cost = distance + 0.05 * turn_weight * (1.0 - _tangents(ordered) @ _tangents(target).T)
    # two lobes may be equally low, so that the two contours disagree about their seam: the nearest point is tried too
    seams = sorted({seam(target), int(distance[0].argmin())})
    paths = [_path(np.roll(cost, -first, axis=1)[:, np.r_[: len(target), 0]]) for first in seams]
    (at, _), first = min(zip(paths, seams, strict=True), key=lambda found: found[0][1])
    goal = np.roll(target, -first, axis=0)
    corners = np.array(sharp_corners(goal, corner_reach) if corner_reach else [], dtype=float)
    goal = np.concatenate([goal, goal[:1]])
    if spacing > 0.0:
        at = _spaced(at, spacing * (len(goal) - 1) / len(at), float(len(goal) - 1))
    if len(corners):
        at = _cornered(at, corners)
    low = np.clip(np.floor(at).astype(int), 0, len(goal) - 2)
    found = goal[low] + (at - low)[:, None] * (goal[low + 1] - goal[low])
    found = np.roll(found, start, axis=0)
    return found[::-1].copy() if reversed_ else found


def _spaced(at: Float64[np.ndarray, " N"], least: float, length: float) -> Float64[np.ndarray, " N"]:
    """The nearest places (least squares) along a closed contour of `length` with neighbours at least `least` apart."""
    floor = least * np.arange(len(at))
    found = isotonic_regression(at - floor).x
    room = length - least * len(at)  # what is left of the round when every step is the least one
    return np.clip(found, 0.0, room) + floor


def _cornered(at: Float64[np.ndarray, " N"], corners: Float64[np.ndarray, " C"]) -> Float64[np.ndarray, " N"]:
    """Every corner takes the place nearest to it, unless that would come nearer to a neighbour than half its step."""
    moved = at.copy()
    for corner in corners:
        index = int(np.abs(moved - corner).argmin())
        before, after = at[index - 1] if index else -np.inf, at[index + 1] if index + 1 < len(at) else np.inf
        if 0.5 * (before + at[index]) <= corner <= 0.5 * (at[index] + after):
            moved[index] = corner
    return moved


def _tangents(contour: np.ndarray) -> np.ndarray:
    chord = np.roll(contour, -2, axis=0) - np.roll(contour, 2, axis=0)
    return chord / np.linalg.norm(chord, axis=1, keepdims=True).clip(1e-12)
