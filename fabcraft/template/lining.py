"""The inner side of what is worn on the head: how far from the skin it is, and the pads where it rests.

It is a level of the blurred distance to the hull of the covered head, drawn down along the donning axis.  Blurring keeps a
shape that is open downwards so, which is why no part of the inner side is undercut; pads reach in to the hull itself.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from fabcraft.body.body import Body
from fabcraft.body.region import Region
from fabcraft.geometry.implicit import Convex, GridField, blurred
from fabcraft.template.headwear import Head, Points

PAD_GAP_MM = 0.3
"""Between a pad and the skin."""
_SPARE_MM = 0.15
"""What the triangles' chords may take of that gap, on a man."""
_HOLLOW_MM, _LEAST_HOLLOW_MM = 2.5, 1.5
"""Skin that lies deeper than this under the hull of the head is not rested on; the second of small characters."""
_DEEPEST = 1.75
"""How far a pad may reach in, over its radius."""
_CELL = 0.58
"""Of the blurred distance's grid, over its blur."""


@dataclass(frozen=True, eq=False)
class Pad:
    """A boss on the inner side that follows the head."""

    foot: Float64[np.ndarray, "3"]
    """On the skin, mm."""
    normal: Float64[np.ndarray, "3"]
    radius: float

    def share(self, points: Points) -> Float64[np.ndarray, " N"]:
        """1 on the pad, 0 beside it, smooth between."""
        away = points - self.foot
        out = away @ self.normal
        across = np.sqrt(np.maximum((away**2).sum(1) - out**2, 0.0))
        share = np.clip((1.5 * self.radius - across) / (0.7 * self.radius), 0.0, 1.0)
        return np.where(out > -self.radius, share**2 * (3.0 - 2.0 * share), 0.0)


@dataclass(frozen=True, eq=False)
class Lining:
    """Inner sides as fields: positive outward of them."""

    tight: Convex
    """The hull of what is covered, drawn down along the donning axis."""
    distance: GridField
    """The same, or of what it is domed over with, blurred."""
    level: float
    """Of the inner side in `distance`."""
    room: float
    """Between head and inner side, typically, mm."""
    gap: float
    """Between pads and skin, mm."""

    @staticmethod
    def around(
        worn: Points,
        axis: Float64[np.ndarray, "3"],
        room: float,
        gap: float,
        blur_mm: float,
        bounds: Float64[np.ndarray, "2 3"],
        least_share: float,
        sized: Float64[np.ndarray, "M 3"],
        dome: Float64[np.ndarray, "K 3"],
    ) -> "Lining":
        """The lining for the skin `worn`, which comes off along `axis`.

        least_share : of `room` that is kept everywhere; below 1 the typical room is `room`, else the least is.
        sized : the same of the head that the shell is made for.  dome : more that it goes around.
        """
        down = float(np.ptp(bounds[:, 2])) * axis
        tight = Convex.around(np.concatenate([worn, worn - down]), mirrored=True)
        covered = np.concatenate([sized, dome])
        shape = Convex.around(np.concatenate([covered, covered - down]), mirrored=True)
        distance = blurred(shape, bounds, blur_mm, _CELL * blur_mm, mirrored=True)
        depths = distance(sized)
        level = float(depths.max()) + max(least_share * room, gap)
        if least_share < 1.0:
            level = max(level, float(np.median(depths)) + room)
        return Lining(tight, distance, level, room, gap)

    def within(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Distance outward from the inner side, about, without pads."""
        return self.distance(points) - self.level

    def rest(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Distance inward from where pads end."""
        return self.gap - self.tight(points)

    def reaches(self, foot: Float64[np.ndarray, "3"], radius: float, scale: float) -> bool:
        """Whether a pad of that radius can rest on the skin at `foot`, on a head of that scale."""
        hollow = -float(self.tight(foot[None])[0])
        deep = -float(self.within(foot[None])[0])
        return hollow < max(_HOLLOW_MM * scale, _LEAST_HOLLOW_MM) and deep < _DEEPEST * radius


def pad_gap_mm(head: Head) -> tuple[float, float]:
    """Gap that pads promise, and the one that they are built with."""
    promised = head.part.clearance_mm(PAD_GAP_MM)
    return promised, promised + _SPARE_MM * head.scale


def covered_bounds(
    worn: Points, axis: Float64[np.ndarray, "3"], beyond_mm: float
) -> Float64[np.ndarray, "2 3"]:
    """A box that holds the skin `worn`, what it is drawn down to along `axis`, and `beyond_mm` more."""
    under = worn - float(np.ptp(worn[:, 2])) * axis
    bounds = np.stack([np.minimum(worn, under).min(0), np.maximum(worn, under).max(0)])
    bounds[0, 2] = worn[:, 2].min()
    return bounds + np.array([[-1.0], [1.0]]) * beyond_mm


def resting(part: Body, pads: Mapping[str, Pad]) -> dict[str, Region]:
    """The regions of the body under the pads."""
    found = {}
    for name, pad in pads.items():
        facing = part.mesh.vertex_normals @ pad.normal > 0.5
        under = np.linalg.norm(part.mesh.vertices - pad.foot, axis=1) < 0.75 * pad.radius
        found[name] = part.regions[name].at(np.flatnonzero(under & facing))
    return found
