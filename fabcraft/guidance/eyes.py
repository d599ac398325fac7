"""Which two of the loops in a drawing are its eyes: a pair alike, level, on both sides of the axis.

Sizes and places are in shares of the silhouette's width and height, across and along its mirror axis.
"""

import cv2
import numpy as np
from jaxtyping import Bool

from fabcraft.guidance.parts import Loop
from fabcraft.guidance.symmetry import Axis

Mask = Bool[np.ndarray, "H W"]


def find_eyes(loops: tuple[Loop, ...], silhouette: Mask, axis: Axis) -> tuple[Loop, ...]:
    """The two loops that are a pair of eyes, left one of the picture first, or none.

    A pair is alike, on both sides of the axis at one height, in the middle of the shape; the score is a sum
    of squares over usual spreads: eye width 0.20 +- 0.08 and distance 0.45 +- 0.15 of the width, height
    0.50 +- 0.20.
    """
    tilt = np.radians(axis.tilt_deg)
    right, down = np.array([np.cos(tilt), np.sin(tilt)]), np.array([-np.sin(tilt), np.cos(tilt)])
    origin = np.array([axis.column_px, silhouette.shape[0] / 2])
    inside = np.argwhere(silhouette)[:, ::-1] + 0.5 - origin
    width, (top, bottom) = np.ptp(inside @ right), np.percentile(inside @ down, [0, 100])
    place = [
        ((loop.centre - origin) @ right / width, ((loop.centre - origin) @ down - top) / (bottom - top))
        for loop in loops
    ]
    wide = [np.ptp(loop.contour @ right) / width for loop in loops]
    best: tuple[Loop, ...] = ()
    least = 4.5
    for i, a in enumerate(loops):
        for j, b in enumerate(loops):
            (u, v), (s, t) = place[i], place[j]
            alike = min(a.area, b.area) / max(a.area, b.area)
            if not (
                u < 0 < s and a.spot == b.spot and alike > 0.5 and abs(u + s) < 0.12 and abs(v - t) < 0.1
            ):
                continue
            if not (0.105 if not a.spot else 0.06) < min(wide[i], wide[j]) <= max(wide[i], wide[j]) < 0.38:
                continue
            if _row_of_three(loops, place, i, j):
                continue
            size = (wide[i] + wide[j]) / 2
            score = (
                ((size - 0.2) / 0.08) ** 2 + ((s - u - 0.45) / 0.15) ** 2 + (((v + t) / 2 - 0.5) / 0.2) ** 2
            )
            score += ((u + s) / 0.06) ** 2 + ((v - t) / 0.06) ** 2 + 2 * (1 - alike) + a.spot
            if score < least:
                best, least = (a, b), score
    return best


def _row_of_three(loops: tuple[Loop, ...], place: list[tuple[float, float]], i: int, j: int) -> bool:
    """A third one of like size and shape between the two at their height: jewels, not eyes."""
    (u, v), (s, t) = place[i], place[j]
    size = np.ptp(loops[i].contour, axis=0)
    for k, c in enumerate(loops):
        ratio = np.ptp(c.contour, axis=0) / size
        between = u < place[k][0] < s and abs(place[k][1] - (v + t) / 2) < 0.07
        if k not in (i, j) and between and (ratio > 0.5).all() and (ratio < 2).all():
            return not (_holds(loops[i], c) or _holds(loops[j], c))
    return False


def _holds(outer: Loop, inner: Loop) -> bool:
    return cv2.pointPolygonTest(outer.contour.astype(np.float32), tuple(map(float, inner.centre)), False) >= 0
