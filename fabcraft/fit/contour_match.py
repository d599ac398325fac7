"""Which point of a drawn contour each rim vertex belongs to: a monotone match (dynamic time warping).

A nearest-point match folds a rim where the drawing grows an ear: both flanks pick the same side. A monotone match walks
both contours once around and never turns back. Its seam is at the lowest point nearest the middle, which masks and
drawings of masks share.
"""

from typing import no_type_check

import numba as nb
import numpy as np
from jaxtyping import Float64

from fabcraft.geometry.contour import counter_clockwise


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
    return sums / counts


def seam(contour: Float64[np.ndarray, "N 2"]) -> int:
    """Index of the point to start from: low, and near the middle of the width."""
    width, height = np.ptp(contour, axis=0)
    middle = 0.5 * (contour[:, 0].min() + contour[:, 0].max())
    return int(
        np.argmin((contour[:, 1] - contour[:, 1].min()) / height + np.abs(contour[:, 0] - middle) / width)
    )


def match(
    rim: Float64[np.ndarray, "N 2"], target: Float64[np.ndarray, "M 2"], turn_weight: float = 0.15
) -> Float64[np.ndarray, "N 2"]:
    """For every rim point its place on the target contour, in order around.

    rim, target : closed contours, (x, up), any direction.  turn_weight : how much the direction of the contour counts
    beside the squared distance (in units of the target's size). Each rim point gets the middle of the stretch of target
    that it was matched with.
    """
    target = counter_clockwise(target)
    forward = counter_clockwise(rim)
    reversed_ = forward is not rim
    start = seam(forward)
    ordered = np.roll(forward, -start, axis=0)
    goal = np.roll(target, -seam(target), axis=0)
    goal = np.concatenate([goal, goal[:1]])
    size = float(np.ptp(goal, axis=0).max())
    distance = ((ordered[:, None, :] - goal[None, :, :]) ** 2).sum(-1) / size**2
    direction = 1.0 - _tangents(ordered) @ _tangents(goal[:-1])[np.r_[0 : len(goal) - 1, 0]].T
    at = _path(distance + turn_weight * direction / 2.0 * 0.1)
    low = np.clip(np.floor(at).astype(int), 0, len(goal) - 2)
    found = goal[low] + (at - low)[:, None] * (goal[low + 1] - goal[low])
    found = np.roll(found, start, axis=0)
    return found[::-1].copy() if reversed_ else found


def _tangents(contour: np.ndarray) -> np.ndarray:
    chord = np.roll(contour, -2, axis=0) - np.roll(contour, 2, axis=0)
    return chord / np.linalg.norm(chord, axis=1, keepdims=True).clip(1e-12)
