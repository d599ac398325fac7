"""Curves as text: knots become smooth lines, sharp where a knot says so.

A line is written as its knots, "x,y x,y! ...": a centripetal Catmull-Rom curve (Barry and Goldman 1988) through them, with a
corner at every knot marked "!". "o x,y r" is a circle, "o x,y a,b" an ellipse, "o x,y a,b t" one turned clockwise by t
degrees. x runs to the right from the middle of the page, y downwards from its top, in thousandths of the page.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float64

from fabcraft.errors import InputError
from fabcraft.geometry.contour import resample, resample_open

STEP = 3.0
"""Distance of the points of a curve."""
Points = Float64[np.ndarray, "_ 2"]


@dataclass(frozen=True, eq=False)
class Knots:
    """What a line runs through."""

    at: Points
    sharp: Bool[np.ndarray, " _"]
    """Where it has a corner."""

    def mirrored(self) -> "Knots":
        """About x = 0, run through the other way."""
        return Knots(self.at[::-1] * [-1.0, 1.0], self.sharp[::-1])

    def turned(self, degrees: float, middle: tuple[float, float]) -> "Knots":
        """Clockwise on the page about `middle`."""
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        return Knots((self.at - middle) @ np.array([[c, s], [-s, c]]) + middle, self.sharp)


def knots(text: str) -> Knots:
    """The knots of a written line.  Raises `InputError` for what is none."""
    words = text.split()
    try:
        if words and words[0] == "o":
            return _ellipse(words[1:])
        pairs = [[float(one) for one in word.rstrip("!").split(",")] for word in words]
        at = np.array(pairs, dtype=np.float64)
    except (ValueError, IndexError):
        at = np.zeros((0, 0))
    if at.ndim != 2 or at.shape[1:] != (2,) or len(at) < 2 or not np.isfinite(at).all():
        raise InputError(
            f"'{text[:60]}' is no line", 'Write its knots: "x,y x,y! ...", or a circle: "o x,y r".'
        )
    return Knots(at, np.array([word.endswith("!") for word in words]))


def joined(parts: list[Knots]) -> Knots:
    """One line through all, a knot that two share (to `STEP`) taken once."""
    at, sharp = parts[0].at, parts[0].sharp
    for part in parts[1:]:
        first = int(np.linalg.norm(part.at[0] - at[-1]) < STEP)
        at, sharp = np.vstack([at, part.at[first:]]), np.r_[sharp, part.sharp[first:]]
    if np.linalg.norm(at[0] - at[-1]) < STEP:
        at, sharp = at[:-1], sharp[:-1]
    return Knots(at, sharp)


def closed_curve(line: Knots) -> Points:
    """(N, 2) evenly spaced points of the closed curve, one exactly at every corner."""
    corners = np.flatnonzero(line.sharp)
    if len(corners) == 0:
        at = np.vstack([line.at[-1], line.at, line.at[:2]])
        return resample(_through(at)[:-1], STEP)
    at, n = np.roll(line.at, -corners[0], 0), len(line.at)
    starts = np.r_[corners - corners[0], n]
    ring = np.vstack([at, at[:1]])
    return np.vstack([_open(ring[a : b + 1])[:-1] for a, b in pairwise(starts)])


def open_curve(line: Knots) -> Points:
    """(N, 2) evenly spaced points of the open curve, both ends among them."""
    stops = np.unique(np.r_[0, np.flatnonzero(line.sharp), len(line.at) - 1])
    pieces = [_open(line.at[a : b + 1]) for a, b in pairwise(stops)]
    return np.vstack([*(piece[:-1] for piece in pieces[:-1]), pieces[-1]])


def _open(at: Points) -> Points:
    if len(at) == 2:
        return resample_open(at, STEP)
    return resample_open(_through(np.vstack([2 * at[0] - at[1], at, 2 * at[-1] - at[-2]])), STEP)


def _through(at: Points) -> Points:
    """The curve from the second knot to the last but one, by the pyramid of Barry and Goldman."""
    pieces = []
    for p0, p1, p2, p3 in zip(at, at[1:], at[2:], at[3:], strict=False):
        t0 = 0.0
        t1 = t0 + np.linalg.norm(p1 - p0) ** 0.5 + 1e-9
        t2 = t1 + np.linalg.norm(p2 - p1) ** 0.5 + 1e-9
        t3 = t2 + np.linalg.norm(p3 - p2) ** 0.5 + 1e-9
        t = np.linspace(t1, t2, 40, endpoint=False)[:, None]
        a1 = ((t1 - t) * p0 + (t - t0) * p1) / (t1 - t0)
        a2 = ((t2 - t) * p1 + (t - t1) * p2) / (t2 - t1)
        a3 = ((t3 - t) * p2 + (t - t2) * p3) / (t3 - t2)
        b1 = ((t2 - t) * a1 + (t - t0) * a2) / (t2 - t0)
        b2 = ((t3 - t) * a2 + (t - t1) * a3) / (t3 - t1)
        pieces.append(((t2 - t) * b1 + (t - t1) * b2) / (t2 - t1))
    return np.vstack([*pieces, at[-2:-1]])


def _ellipse(words: list[str]) -> Knots:
    """ "x,y r", "x,y a,b" or "x,y a,b degrees"."""
    x, y = (float(one) for one in words[0].split(","))
    half = [float(one) for one in words[1].split(",")]
    round_ = np.radians(np.arange(0.0, 360.0, 22.5))
    at = np.array([x, y]) + np.column_stack([half[0] * np.cos(round_), half[-1] * np.sin(round_)])
    line = Knots(at, np.zeros(len(at), dtype=bool))
    return line.turned(float(words[2]), (x, y)) if len(words) > 2 else line
