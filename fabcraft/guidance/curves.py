"""Polylines in the picture plane: corners, and smoothing that keeps them. Pixels, (column, row).

Smoothing is the discrete smoothing spline (Whittaker 1923): min_x |x - p|^2 + s |D2 x|^2 on evenly spaced
points, whose half-power wavelength is 2 pi s^(1/4) samples. Corners are held, so each piece between two is
smoothed alone.
"""

import numpy as np
from jaxtyping import Float64, Int
from scipy.linalg import solveh_banded

Points = Float64[np.ndarray, "_ 2"]


def length_of(points: Points) -> float:
    """Length of the open polyline."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def smooth_open(points: Points, wavelength: float, weight: Float64[np.ndarray, " _"] | None = None) -> Points:
    """Evenly spaced polyline without waves shorter than `wavelength` samples; both ends stay.

    weight : (N,) how far each point is to be believed, 1 by default; where it is small the curve runs on
    smoothly.
    """
    n = len(points)
    if n < 5:
        return points.copy()
    s = (wavelength / (2 * np.pi)) ** 4
    w = np.ones(n) if weight is None else np.maximum(weight, 1e-4)
    w[[0, -1]] = 1e6 * (1 + s)  # holds the ends
    bands = np.zeros((3, n))  # upper form of W + s D2'D2
    bands[2] = w + s * np.r_[1, 5, np.full(n - 4, 6.0), 5, 1]
    bands[1] = -s * np.r_[0, 2, np.full(n - 3, 4.0), 2]
    bands[0, 2:] = s
    return solveh_banded(bands, w[:, None] * points)


def smooth_closed(
    points: Points, wavelength: float, weight: Float64[np.ndarray, " _"] | None = None
) -> Points:
    """The same for a closed contour without corners: smoothed over more than one round, the middle kept."""
    n = len(points)
    more = min(n, int(3 * wavelength) + 2)
    around = np.arange(-more, n + more) % n
    return smooth_open(points[around], wavelength, None if weight is None else weight[around])[
        more : more + n
    ]


def turning(points: Points, reach: int) -> Float64[np.ndarray, " _"]:
    """Degrees by which the closed contour turns at each point, seen over `reach` samples on either side."""
    ahead, behind = np.roll(points, -reach, 0) - points, points - np.roll(points, reach, 0)
    cross = behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0]
    return np.degrees(np.arctan2(cross, (behind * ahead).sum(1)))


def corners(points: Points, reach: int, least_deg: float) -> Int[np.ndarray, " _"]:
    """Indices where the evenly spaced closed contour turns by `least_deg` or more at once.

    A round bend turns in proportion to the reach (an ellipse's end a little faster); a corner has done its
    turning within a short one, so two thirds of the turn must be there over half the `reach`.  The index is
    the point farthest from the chord.
    """
    n = len(points)
    wide, near = np.abs(turning(points, reach)), np.abs(turning(points, max(1, round(0.5 * reach))))
    score = np.where(near > 0.67 * wide, wide, 0.0)
    found: list[int] = []
    for i in np.argsort(-score):
        if score[i] < least_deg:
            break
        if all(min(abs(i - j), n - abs(i - j)) > 0.8 * reach for j in found):
            found.append(int(i))
    tips = [_farthest_from_chord(points, i, reach) for i in found]
    return np.array(sorted(set(tips)), dtype=np.int64)


def _farthest_from_chord(points: Points, i: int, reach: int) -> int:
    """Index of the point near `i` that sticks out most from the chord over `reach` on either side."""
    n = len(points)
    a, b = points[(i - reach) % n], points[(i + reach) % n]
    window = np.arange(i - reach // 2, i + reach // 2 + 1) % n
    away = points[window] - a
    height = np.abs((b - a)[0] * away[:, 1] - (b - a)[1] * away[:, 0])
    return int(window[np.argmax(height)])


def smooth_with_corners(
    points: Points, wavelength: float, held: Int[np.ndarray, " _"], weight: Float64[np.ndarray, " _"]
) -> Points:
    """Evenly spaced closed contour smoothed between the `held` points, which stay where they are."""
    if len(held) == 0:
        return smooth_closed(points, wavelength, weight)
    pieces, n = [], len(points)
    for a, b in zip(held, np.r_[held[1:], held[0] + n], strict=True):
        piece = np.arange(a, b + 1) % n
        pieces.append(smooth_open(points[piece], wavelength, weight[piece])[:-1])
    return np.vstack(pieces)
