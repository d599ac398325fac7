"""The silhouette's outline: hairs cut off, tips sharp, one smooth closed contour.

Opening by a disc of 0.85 line widths takes away what is as thin as a line: whiskers across the rim, but the
tips of ears as well. So at every sharp convex turn of the opened contour its two flanks are run on as
straight lines, and the tip goes back to where they meet, no farther than there is ink.
"""

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy import ndimage
from scipy.spatial import cKDTree

from fabcraft.geometry.contour import counter_clockwise, resample, resample_open, signed_area
from fabcraft.guidance.curves import corners, smooth_with_corners, turning

Mask = Bool[np.ndarray, "H W"]
Points = Float64[np.ndarray, "_ 2"]
OPENING = 0.85  # radius in line widths
CORNER_DEG = 46.0
SMOOTHING = 8.0  # shortest wavelength left in a contour, in line widths
LEAST_WAVES = 5  # and at least so many of it fit round, or a thick pen would shrink a small loop


@dataclass(frozen=True, eq=False)
class Trimmed:
    """A filled shape without the hairs that stand out from it."""

    mask: Mask
    """The opened shape; tips are blunt here, `outline_of` gives them back."""
    filled: Mask
    """The shape before, hairs and tips included."""
    roots: Points
    """(K, 2) places on the contour where something was cut off."""


def trim(filled: Mask, width: float) -> Trimmed:
    """The largest piece of `filled` without what is as thin as a line."""
    opened = largest(_opening(filled, OPENING * width))
    if not opened.any():
        return Trimmed(opened, filled, np.zeros((0, 2)))
    away = cv2.distanceTransform((~opened).astype(np.uint8), cv2.DIST_L2, 5)
    labels, count = ndimage.label(filled & ~opened, np.ones((3, 3)))
    roots = [np.zeros((0, 2))]
    for k, box in enumerate(ndimage.find_objects(labels, count), start=1):
        piece = labels[box] == k
        if away[box][piece].max() > max(1.6, 0.35 * width):
            touch = piece & (away[box] < 1.6)
            roots.append(np.argwhere(touch)[:, ::-1] + 0.5 + [box[1].start, box[0].start])
    return Trimmed(fill_holes(opened), filled, np.vstack(roots))


def outline_of(shape: Trimmed, width: float, bridged: Points | None = None) -> Points:
    """(N, 2) the smooth closed contour of a trimmed shape, corners sharp, evenly spaced by a sixth of a
    line width.

    bridged : (K, 2) points of bridged gaps; near them and near cut hairs the contour runs on from both sides.
    """
    step = max(1.0, width / 6)
    raw = resample(contour_of(shape.mask), step)
    # Over a sixteenth of its round a circle turns by 22 degrees, so a small one has no corners; a dot has
    # none at all.
    reach = min(round(2.5 * width / step), len(raw) // 16)
    held = corners(raw, reach, CORNER_DEG) if reach * step > 0.8 * width else np.zeros(0, dtype=np.int64)
    weight = np.ones(len(raw))
    for points, around in ((shape.roots, 0.9 * width), (bridged, 1.1 * width)):
        if points is not None and len(points):
            weight[cKDTree(points).query(raw)[0] < around] = 0.002
    tips = {int(i): _tip(raw, int(i), held, shape.filled, width / step) for i in held}
    blunt = round(0.9 * width / step)
    for i, (tip, convex) in tips.items():
        raw[i] = tip
        if convex:  # the round end of the pen, and the disc, must not blunt it
            weight[np.arange(i - blunt, i + blunt + 1) % len(raw)] = 0.002
    wavelength = min(SMOOTHING * width / step, len(raw) / LEAST_WAVES)
    smooth = smooth_with_corners(raw, wavelength, held, weight)
    return counter_clockwise(_even_between(smooth, held, step))


def _tip(
    raw: Points, i: int, held: Int[np.ndarray, " _"], filled: Mask, samples: float
) -> tuple[Float64[np.ndarray, "2"], bool]:
    """Where the corner `i` of the opened contour belongs, and whether it is convex; `samples` in a line
    width.
    """
    n = len(raw)
    convex = bool(turning(raw, max(2, round(2 * samples)))[i] > 0)
    if not convex:
        return raw[i], False
    others = [min((j - i) % n, (i - j) % n) for j in held if j != i]
    far = int(min(3.2 * samples, 0.7 * min(others, default=n)))
    near = int(min(1.2 * samples, 0.5 * far))
    before, after = raw[np.arange(i - far, i - near) % n], raw[np.arange(i + near + 1, i + far + 1) % n]
    if len(before) < 3 or len(after) < 3:
        return raw[i], True
    meeting = _meeting(before, after)
    base = (before[-1] + after[0]) / 2
    if meeting is None or (meeting - base) @ (raw[i] - base) <= 0:
        return raw[i], True
    way = base + np.linspace(0, 1, 200)[:, None] * (meeting - base)
    at = np.clip(way.astype(int), 0, np.array(filled.shape[::-1]) - 1)
    bare = np.flatnonzero(~filled[at[:, 1], at[:, 0]])
    tip = way[bare[0] - 1] if len(bare) and bare[0] > 0 else way[-1]
    return (tip if np.linalg.norm(tip - base) > np.linalg.norm(raw[i] - base) - 1 else raw[i]), True


def _meeting(before: Points, after: Points) -> Float64[np.ndarray, "2"] | None:
    """Where the straight lines through two flanks meet; None when they are nearly parallel."""
    (p, u), (q, v) = _line(before), _line(after)
    cross = u[0] * v[1] - u[1] * v[0]
    if abs(cross) < 0.12:
        return None
    d = q - p
    return p + u * (d[0] * v[1] - d[1] * v[0]) / cross


def _line(points: Points) -> tuple[Float64[np.ndarray, "2"], Float64[np.ndarray, "2"]]:
    """Mean and main direction."""
    mean = points.mean(0)
    return mean, np.linalg.svd(points - mean, full_matrices=False)[2][0]


def contour_of(mask: Mask) -> Points:
    """(N, 2) the longest outer contour of a mask at sub-pixel steps, clockwise on the screen, in pixel
    coordinates.
    """
    from skimage.measure import find_contours

    rounded = cv2.GaussianBlur(np.pad(mask, 3).astype(np.float32), (0, 0), 0.7)
    lines = [c[:-1, ::-1] for c in find_contours(rounded, 0.5) if len(c) > 3]
    longest = max(lines, key=lambda c: abs(signed_area(c)))
    return counter_clockwise(np.ascontiguousarray(longest) - 3 + 0.5)


def largest(mask: Mask) -> Mask:
    """The largest 8-connected piece."""
    labels, count = ndimage.label(mask, np.ones((3, 3)))
    if count < 2:
        return mask.copy()
    area = np.bincount(labels.ravel())
    area[0] = 0
    return labels == area.argmax()


def fill_holes(mask: Mask) -> Mask:
    return ndimage.binary_fill_holes(mask)


def fill_contour(points: Points, shape: tuple[int, int]) -> Mask:
    """(H, W) True where the pixel's centre lies inside the closed contour (even-odd, one crossing at a
    time).
    """
    a, b = points, np.roll(points, -1, 0)
    low, high = np.minimum(a[:, 1], b[:, 1]), np.maximum(a[:, 1], b[:, 1])
    first = np.clip(np.ceil(low - 0.5), 0, shape[0]).astype(
        int
    )  # rows whose centre the edge passes: [low, high)
    count = np.clip(np.ceil(high - 0.5), 0, shape[0]).astype(int) - first
    edge = np.repeat(np.arange(len(points)), count)
    row = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + first[edge]
    along = (row + 0.5 - a[edge, 1]) / (b[edge, 1] - a[edge, 1])
    column = a[edge, 0] + along * (b[edge, 0] - a[edge, 0])
    crossings = np.zeros((shape[0], shape[1] + 1), np.int32)
    np.add.at(crossings, (row, np.clip(np.ceil(column - 0.5), 0, shape[1]).astype(int)), 1)
    return np.cumsum(crossings, 1)[:, :-1] % 2 == 1


def _opening(mask: Mask, radius: float) -> Mask:
    """Opening by a disc, by two distance maps."""
    r = int(np.ceil(radius)) + 2
    inside = cv2.distanceTransform(np.pad(mask, r).astype(np.uint8), cv2.DIST_L2, 5) > radius
    if not inside.any():
        return np.zeros_like(mask)
    grown = cv2.distanceTransform((~inside).astype(np.uint8), cv2.DIST_L2, 5) <= radius
    return (grown & np.pad(mask, r))[r:-r, r:-r]


def _even_between(points: Points, held: Int[np.ndarray, " _"], step: float) -> Points:
    """Evenly spaced again, with a point exactly on every held corner."""
    if len(held) == 0:
        return resample(points, step)
    # The smoothed ring starts at the first held point.
    starts = np.r_[held - held[0], len(points)]
    ring = np.vstack([points, points[:1]])
    return np.vstack([resample_open(ring[a : b + 1], step)[:-1] for a, b in pairwise(starts)])
