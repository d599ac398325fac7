"""Gaps in the outline closed by short curves that run on from the stroke ends, only where something
becomes closed.

Every pair of free ends that look at each other, and every free end that looks at another line, is a
candidate. All candidates up to a length are drawn at once; then each, the longest first, is taken away again
unless the filled area would shrink. Longer ones are tried only while the filled area stays below 88 % of what
the widest closing gives; an end that looks at a line from afar is then more often a feeler or a whisker than
a gap.
"""

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64
from scipy import ndimage

from fabcraft.geometry.contour import signed_area
from fabcraft.guidance.strokes import Branch, end_direction, skeleton_graph, trace_strokes

Mask = Bool[np.ndarray, "H W"]
Points = Float64[np.ndarray, "_ 2"]
Vector = Float64[np.ndarray, "2"]
KEEPS = 0.88
LENGTHS = (0.035, 0.07, 0.12)  # of the drawing's longer side
WIDEST = 0.06  # radius, of the same
MOST_ENDS = 200
MOST_BRIDGES = 150  # the shortest; each is weighed by filling the page without it
CHORD = 0.17  # of the way round: a loop may be open by some 55 degrees
ROUND = 0.4
WORTH = 0.0015  # share of the filled area that a bridge must add


@dataclass(frozen=True, eq=False)
class Bridge:
    """A curve over a gap."""

    points: Points
    gap_px: float
    """Bare paper between the two pieces of ink."""


@dataclass(frozen=True, eq=False)
class Closed:
    """Ink with its gaps bridged."""

    ink: Mask
    filled: Mask
    """Everything that cannot be reached from the border of the picture."""
    bridges: tuple[Bridge, ...]
    closing_px: float
    """Diameter of the morphological closing that was needed on top; 0 when curves were enough."""


def close_gaps(ink: Mask, width: float, margin: int = 0) -> Closed:
    """The ink with just those gaps closed that leave its outline open.

    margin : width of the empty band around the picture; lines that the picture's border cuts are joined
    along it.
    """
    side = _extent(ink)
    ends = _free_ends(skeleton_graph(ink, width))
    along_border = _border_bridges(ends, ink.shape, margin, width)
    most = int(_fill_coarsely(ink, WIDEST * side).sum())
    tried: list[Closed] = []
    for share in LENGTHS:
        landing = 2 * width if share == LENGTHS[0] else share * side
        bridges = _needed(ink, along_border + _candidates(ink, ends, share * side, landing, width), width)
        drawn = _draw(ink, bridges, width)
        tried.append(Closed(drawn, fill(drawn), tuple(bridges), 0.0))
        if tried[-1].filled.sum() >= KEEPS * most:
            return tried[-1]
    # The coarse filling also fills between whiskers, so half of it is enough if no longer bridge gives more.
    best = max(int(c.filled.sum()) for c in tried)
    if best >= 0.5 * most:
        return next(c for c in tried if c.filled.sum() >= KEEPS * best)
    for radius in np.geomspace(width / 2, WIDEST * side, 10):
        filled = _fill_coarsely(ink, radius)
        if filled.sum() >= KEEPS * most:
            break
    if _depth(filled).max() < 4 * radius:  # lines that only grew together
        return tried[0]
    edge = filled & ~ndimage.binary_erosion(filled, iterations=max(1, round(width)))
    return Closed(ink | edge, filled | fill(ink), (), float(2 * radius))


def close_loops(ink: Mask, within: Mask, width: float) -> Mask:
    """The same for lines inside the outline: an eye or a nose that is not quite closed."""
    rings = _nearly_rings(trace_strokes(ink & within, width), width)
    ink = _draw(ink, rings, width) if rings else ink
    inside = ink & within
    ends = _free_ends(skeleton_graph(inside, width))
    bridges = _needed(
        inside, _candidates(inside, ends, 3.5 * width, 2 * width, width), width, least=(4 * width) ** 2
    )
    return _draw(ink, bridges, width) if bridges else ink


def _nearly_rings(strokes: list[Points], width: float) -> list[Bridge]:
    """What is missing where one stroke comes round to its own start, or past it, and does not quite meet it.

    A hand rarely ends a loop where it began.  The chord must be short against the way round, and what it encloses about
    as round as a loop (area over that of a circle of the same length), or a zigzag would be a loop.
    """
    found = []
    for line in strokes:
        along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))]
        best: Bridge | None = None
        for points, way in ((line, along), (line[::-1], along[-1] - along[::-1])):
            chord = np.linalg.norm(points - points[0], axis=1)
            chord[way < 0.5 * along[-1]] = np.inf
            j = int(np.argmin(chord))
            round_trip = way[j] + chord[j]
            roundness = 4 * np.pi * abs(signed_area(points[: j + 1])) / round_trip**2
            if width < chord[j] < CHORD * way[j] and way[j] > 8 * width and roundness > ROUND:
                gap = max(1.0, float(chord[j]) - width)
                if best is None or gap < best.gap_px:
                    best = Bridge(np.linspace(points[0], points[j], max(3, int(chord[j]))), gap)
        if best is not None:
            found.append(best)
    return found


def fill(ink: Mask) -> Mask:
    """Ink and everything enclosed by it."""
    canvas = np.pad(ink, 1).astype(np.uint8)
    cv2.floodFill(canvas, None, (0, 0), 2, flags=4)
    return canvas[1:-1, 1:-1] != 2


def _extent(ink: Mask) -> float:
    rows, cols = np.flatnonzero(ink.any(1)), np.flatnonzero(ink.any(0))
    return float(max(np.ptp(rows), np.ptp(cols)) + 1)


def _fill_coarsely(ink: Mask, radius: float) -> Mask:
    """What is enclosed when every line is made thicker by `radius`, made thinner again."""
    r = int(np.ceil(radius)) + 2
    grown = cv2.distanceTransform((~np.pad(ink, r)).astype(np.uint8), cv2.DIST_L2, 5) <= radius
    back = cv2.distanceTransform(fill(grown).astype(np.uint8), cv2.DIST_L2, 5) > radius
    return back[r:-r, r:-r] | ink


def _depth(mask: Mask) -> Float32[np.ndarray, "H W"]:
    return cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]


def _free_ends(branches: list[Branch]) -> list[Branch]:
    """A branch for every free end, turned so that it runs towards it."""
    out = []
    for b in branches:
        if b.ring:
            continue
        out += [b] * (b.end < 0) + [b.turned()] * (b.start < 0)
    # a page of hatching or noise has thousands; an outline's gaps are between its long strokes
    return sorted(out, key=lambda b: -len(b.points))[:MOST_ENDS] if len(out) > MOST_ENDS else out


def _candidates(
    ink: Mask, ends: list[Branch], longest: float, landing_px: float, width: float
) -> list[Bridge]:
    """Bridges between ends that look at each other and, up to `landing_px`, from an end to a line that it
    looks at.
    """
    tips = [b.points[-1] for b in ends]
    looks = [end_direction(b.points, 3 * width) for b in ends]
    found = []
    for i in range(len(ends)):
        for j in range(i + 1, len(ends)):
            across = tips[j] - tips[i]
            d = float(np.linalg.norm(across))
            if d > longest + width or (ends[i].points is ends[j].points and len(ends[i].points) < 3):
                continue
            ahead = across / (d + 1e-9)
            facing = min(looks[i] @ ahead, -(looks[j] @ ahead))
            if facing > 0.35 or d < 2 * width:
                found.append(
                    Bridge(_hermite(tips[i], looks[i], tips[j], -looks[j], facing), max(1.0, d - width))
                )
        landing = _landing(ink, tips[i], looks[i], landing_px, width)
        if landing is not None:
            d = float(np.linalg.norm(landing - tips[i]))
            found.append(Bridge(np.linspace(tips[i], landing, max(3, int(d))), max(1.0, d - width / 2)))
    return found


def _border_bridges(ends: list[Branch], shape: tuple[int, int], margin: int, width: float) -> list[Bridge]:
    """Straight joins between neighbouring ends that stop at the same border of the picture."""
    found = []
    tips = np.array([b.points[-1] for b in ends]).reshape(-1, 2)
    for axis, at in ((0, margin), (0, shape[1] - margin), (1, margin), (1, shape[0] - margin)):
        here = tips[np.abs(tips[:, axis] - at) < 1.5 * width] if margin else tips[:0]
        here = here[np.argsort(here[:, 1 - axis])]
        for a, b in pairwise(here):
            d = float(np.linalg.norm(b - a))
            found.append(Bridge(np.linspace(a, b, max(3, int(d))), max(1.0, d - width)))
    return found


def _hermite(a: Vector, u: Vector, b: Vector, v: Vector, facing: float) -> Points:
    """Cubic from `a` in direction `u` to `b` arriving in direction `v`; straight when they do not face."""
    d = float(np.linalg.norm(b - a))
    t = np.linspace(0, 1, max(3, int(d)))[:, None]
    pull = d * float(np.clip(facing, 0, 1))
    h = (2 * t**3 - 3 * t**2 + 1) * a + (t**3 - 2 * t**2 + t) * pull * u
    return h + (3 * t**2 - 2 * t**3) * b + (t**3 - t**2) * pull * v


def _landing(ink: Mask, tip: Vector, look: Vector, longest: float, width: float) -> Vector | None:
    """First ink met within 30 degrees of the stroke's direction, beyond its own end; None when there is
    none.
    """
    best, nearest = None, longest + width
    for turn in np.radians([0, -10, 10, -20, 20, -30, 30]):
        c, s = np.cos(turn), np.sin(turn)
        ray = np.array([c * look[0] - s * look[1], s * look[0] + c * look[1]])
        way = tip + np.arange(0, nearest, 0.7)[:, None] * ray
        at = np.floor(way).astype(int)
        ok = (at >= 0).all(1) & (at[:, 0] < ink.shape[1]) & (at[:, 1] < ink.shape[0])
        seen = np.zeros(len(at), bool)
        seen[ok] = ink[at[ok, 1], at[ok, 0]]
        left_own_end = int(np.argmin(seen))
        hit = np.flatnonzero(seen[left_own_end:]) + left_own_end
        if not seen.all() and len(hit) and hit[0] * 0.7 < nearest:
            best, nearest = way[min(int(hit[0]) + round(width / 2 / 0.7), len(way) - 1)], hit[0] * 0.7
    return best


def _draw(ink: Mask, bridges: list[Bridge], width: float) -> Mask:
    canvas = ink.astype(np.uint8)
    for b in bridges:
        fixed = np.round((b.points - 0.5) * 16).astype(np.int32)
        cv2.polylines(canvas, [fixed], False, 1, max(1, round(0.9 * width)), cv2.LINE_8, 4)
    return canvas > 0


def _needed(ink: Mask, candidates: list[Bridge], width: float, least: float = 0.0) -> list[Bridge]:
    """Those candidates without which the filled area would be smaller."""
    kept = sorted(candidates, key=lambda b: -b.gap_px)[-MOST_BRIDGES:]
    # What a bridge covers itself does not count as enclosed.
    full = int(fill(_draw(ink, kept, width)).sum())
    worth = max(least, WORTH * full)
    for b in list(kept):
        without = [c for c in kept if c is not b]
        area = int(fill(_draw(ink, without, width)).sum())
        if area >= full - worth - len(b.points) * width:
            kept, full = without, area
    return kept
