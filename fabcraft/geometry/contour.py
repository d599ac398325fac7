"""Closed planar contours: length, area, inside, even resampling that keeps corners, offsets by a distance field.

A contour is (N, 2) float64 points, closed implicitly. Counter-clockwise has positive area.
"""

import numpy as np
from jaxtyping import Bool, Float, Float64
from scipy.ndimage import distance_transform_edt, gaussian_filter, gaussian_filter1d
from skimage.measure import find_contours, points_in_poly

Contour = Float64[np.ndarray, "N 2"]


def signed_area(contour: Float64[np.ndarray, "N 2"]) -> float:
    """Area, positive when counter-clockwise, in the contour's unit squared."""
    x, y = contour.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def counter_clockwise(contour: Float64[np.ndarray, "N 2"]) -> Float64[np.ndarray, "N 2"]:
    """The same contour, turned if it runs clockwise."""
    return contour if signed_area(contour) > 0 else contour[::-1].copy()


def inside(
    points: Float64[np.ndarray, "P 2"], loops: list[Float64[np.ndarray, "_ 2"]]
) -> Bool[np.ndarray, " P"]:
    """Whether each point lies in the first loop and in none of the others (its holes)."""
    within = points_in_poly(points, loops[0])
    for hole in loops[1:]:
        within &= ~points_in_poly(points, hole)
    return within


def sharp_corners(contour: Float64[np.ndarray, "N 2"], reach: float, angle_deg: float = 50.0) -> list[int]:
    """Indices where the contour turns by more than `angle_deg` between `reach` before and `reach` after."""
    spacing = np.linalg.norm(np.roll(contour, -1, 0) - contour, axis=1).mean()
    span = max(1, round(reach / spacing))
    before, after = contour - np.roll(contour, span, 0), np.roll(contour, -span, 0) - contour
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    turn = np.abs(np.degrees(np.arctan2(cross, (before * after).sum(1))))
    count = len(contour)
    window = np.stack([np.roll(turn, shift) for shift in range(-span, span + 1)])
    peaks = np.flatnonzero((turn > angle_deg) & (turn >= window.max(0)))
    kept: list[int] = []
    for index in peaks:  # a plateau counts once
        if all(min(abs(index - other), count - abs(index - other)) > span for other in kept):
            kept.append(int(index))
    return kept


def resample(
    contour: Float64[np.ndarray, "N 2"], spacing: float, corner_reach: float | None = None
) -> Float64[np.ndarray, "M 2"]:
    """Points about `spacing` apart along the contour; corners (turns over 50 degrees within `corner_reach`) are kept."""
    corners = sharp_corners(contour, corner_reach) if corner_reach else []
    starts = sorted(corners) or [0]
    pieces = []
    for start, stop in zip(starts, [*starts[1:], starts[0] + len(contour)], strict=True):
        piece = contour[np.arange(start, stop + 1) % len(contour)]
        lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(piece, axis=0), axis=1))])
        count = max(1 if len(starts) > 1 else 8, round(lengths[-1] / spacing))
        at = np.linspace(0.0, lengths[-1], count + 1)[:-1]
        pieces.append(np.stack([np.interp(at, lengths, piece[:, axis]) for axis in (0, 1)], 1))
    return np.concatenate(pieces)


def resample_open(line: Float64[np.ndarray, "N 2"], spacing: float) -> Float64[np.ndarray, "M 2"]:
    """Points about `spacing` apart along an open polyline, both ends kept."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.linspace(0.0, lengths[-1], max(2, round(lengths[-1] / spacing) + 1))
    return np.stack([np.interp(at, lengths, line[:, axis]) for axis in (0, 1)], 1)


def smooth(
    contour: Float64[np.ndarray, "N 2"], sigma: float, corner_reach: float = 0.0
) -> Float64[np.ndarray, "M 2"]:
    """The contour with waves shorter than about `sigma` (contour unit) along its length removed.

    Where it turns sharply (over 50 degrees within `corner_reach`, if positive) the original is kept, blended in over
    two sigma, so that tips stay tips. The result is evenly resampled at a quarter of sigma.
    """
    dense = resample(contour, sigma / 4.0)
    step = np.linalg.norm(np.roll(dense, -1, 0) - dense, axis=1).mean()
    soft = gaussian_filter1d(dense, sigma / step, axis=0, mode="wrap")
    # a Gaussian shrinks a convex curve; adding back the smoothed loss removes the shrinkage to second order
    soft += gaussian_filter1d(dense - soft, sigma / step, axis=0, mode="wrap")
    if corner_reach <= 0.0:
        return soft
    keep = np.zeros(len(dense))
    for index in sharp_corners(dense, corner_reach):
        away = np.abs(np.arange(len(dense)) - index)
        away = np.minimum(away, len(dense) - away) * step
        keep = np.maximum(keep, np.clip(1.5 - away / (2.0 * sigma), 0.0, 1.0))
    light = gaussian_filter1d(dense, 0.3 * sigma / step, axis=0, mode="wrap")
    return soft + keep[:, None] * (light - soft)


def signed_distance_image(mask: Bool[np.ndarray, "H W"], pixel: float) -> Float64[np.ndarray, "H W"]:
    """Distance of every pixel centre to the border of the mask, positive inside, in the unit of `pixel`."""
    return (distance_transform_edt(mask) - distance_transform_edt(~mask) - (mask - 0.5)) * pixel


def level_contours(
    field: Float[np.ndarray, "H W"], level: float, soften: float = 0.0
) -> list[Float64[np.ndarray, "_ 2"]]:
    """Closed contours {field = level} as (column, row) in pixel coordinates, longest first.

    `soften`: Gaussian of the field first, in pixels.
    """
    padded = np.pad(
        gaussian_filter(field, soften) if soften else field, 1, constant_values=min(field.min(), level - 1.0)
    )
    contours = [c for c in find_contours(padded, level) if len(c) > 8 and np.allclose(c[0], c[-1])]
    # find_contours counts from pixel centres of the padded image; pixel coordinates count from pixel borders
    return [c[:-1, ::-1] - 0.5 for c in sorted(contours, key=len, reverse=True)]
