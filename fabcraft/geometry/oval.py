"""`Oval`: a smooth closed convex curve, kept by its support function.

The support h(a) is how far the curve reaches in the direction n(a) = (cos a, sin a) from the origin.  Its point with that
normal is h n + h' t with t = (-sin a, cos a); the radius of curvature there is h + h''.  In this form offsets are h + c,
the length is the integral of h (Cauchy), a mean of turned copies stays convex, and one oval holds another exactly when its
support is nowhere less (Schneider, "Convex Bodies: the Brunn-Minkowski Theory", 2nd ed., 1.7).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import ConvexHull, cKDTree

from fabcraft.errors import InputError

SAMPLES = 720
"""Directions at which the support is kept."""


@dataclass(frozen=True, eq=False)
class Oval:
    """A convex curve around the origin of its plane, counter-clockwise."""

    support: Float64[np.ndarray, " N"]
    """h at the angles 2 pi i / N, in the unit of the points."""

    @staticmethod
    def ellipse(width: float, height: float) -> "Oval":
        """The ellipse with these axes."""
        return Oval(np.hypot(0.5 * width * np.cos(angles()), 0.5 * height * np.sin(angles())))

    @staticmethod
    def around(points: Float[np.ndarray, "P 2"], soften_deg: float = 8.0) -> "Oval":
        """The hull of the points, its corners rounded over about `soften_deg` of turning, nowhere inside the hull.

        Raises `InputError` for points that span no area.
        """
        if len(points) < 3 or np.linalg.matrix_rank(points - points.mean(0), tol=1e-6) < 2:
            raise InputError("a section has no area", "Check the landmarks of the body.")
        corners = points[ConvexHull(points).vertices]
        hull = (corners @ np.stack([np.cos(angles()), np.sin(angles())])).max(0)
        return Oval.holding([Oval(hull)], soften_deg)

    @staticmethod
    def holding(ovals: Sequence["Oval"], soften_deg: float = 8.0) -> "Oval":
        """The hull of the ovals, its corners rounded over about `soften_deg` of turning, nowhere inside them."""
        hull = np.max([oval.support for oval in ovals], axis=0)
        middle = Oval(hull).middle  # about which nothing is shifted by the mean
        hull = Oval(hull).moved(-middle).support
        sigma = soften_deg / 360.0 * SAMPLES
        soft = gaussian_filter1d(hull, sigma, mode="wrap")  # a mean of turned copies: still convex
        # what is missing to hold the hull is itself softened, so that the curve stays smooth
        missing = gaussian_filter1d(np.maximum(hull - soft, 0.0), sigma, mode="wrap")
        return Oval(soft + missing + max(0.0, float((hull - soft - missing).max()))).moved(middle)

    @property
    def length(self) -> float:
        """Of the curve."""
        return 2.0 * np.pi * float(self.support.mean())

    @property
    def middle(self) -> Float64[np.ndarray, "2"]:
        """The Steiner point: the mean of the curve's points over all directions."""
        directions = np.stack([np.cos(angles()), np.sin(angles())], 1)
        return 2.0 * (self.support[:, None] * directions).mean(0)

    @property
    def slope(self) -> Float64[np.ndarray, " N"]:
        """h', per radian."""
        return (np.roll(self.support, -1) - np.roll(self.support, 1)) * (SAMPLES / (4.0 * np.pi))

    @property
    def bend(self) -> Float64[np.ndarray, " N"]:
        """Radius of curvature h + h''."""
        step = 2.0 * np.pi / SAMPLES
        twice = np.roll(self.support, -1) - 2.0 * self.support + np.roll(self.support, 1)
        return self.support + twice / step**2

    @property
    def arc(self) -> Float64[np.ndarray, " M"]:
        """Length along the curve from angle 0 to every sample; one more than samples, the last is `length`."""
        ends = 0.5 * (self.bend + np.roll(self.bend, -1)) * (2.0 * np.pi / SAMPLES)
        return np.concatenate([[0.0], np.cumsum(ends)]) * (self.length / ends.sum())

    def grown(self, by: float) -> "Oval":
        """The curve at that distance outside."""
        return Oval(self.support + by)

    def moved(self, by: Float[np.ndarray, "2"]) -> "Oval":
        """The curve moved in its plane."""
        return Oval(self.support + by[0] * np.cos(angles()) + by[1] * np.sin(angles()))

    def scaled(self, by: float) -> "Oval":
        """The curve enlarged about its middle."""
        return Oval(by * self.support).moved((1.0 - by) * self.middle)

    def mirrored(self) -> "Oval":
        """The smallest curve that holds this one and is symmetric to the second axis of the plane."""
        half = SAMPLES // 2
        return Oval(np.maximum(self.support, self.support[(half - np.arange(SAMPLES)) % SAMPLES]))

    def width(self, angle: float) -> float:
        """Calliper width in the direction `angle`, radians."""
        return float(np.interp([angle, angle + np.pi], angles(), self.support, period=2.0 * np.pi).sum())

    def points(self, offset: float = 0.0) -> Float64[np.ndarray, "N 2"]:
        """The curve's points at all directions, `offset` outside it."""
        return self.at(angles(), np.full(SAMPLES, offset))

    def at(
        self, angle: Float[np.ndarray, " P"], offset: Float[np.ndarray, " P"]
    ) -> Float64[np.ndarray, "P 2"]:
        """Points with normals `angle` (radians), `offset` outside the curve."""
        reach = _around(self.support, angle) + offset
        slope = _around(self.slope, angle)
        cosine, sine = np.cos(angle), np.sin(angle)
        return np.stack([reach * cosine - slope * sine, reach * sine + slope * cosine], 1)

    def located(
        self, points: Float[np.ndarray, "P 2"]
    ) -> tuple[Float64[np.ndarray, " P"], Float64[np.ndarray, " P"]]:
        """(direction of the normal through every point, radians; signed distance to the curve, positive outside).

        The nearest sample, then a Newton step of the support condition p . t = h', exact to about 1e-4 of the size.
        """
        curve = self.points()
        _, near = cKDTree(curve).query(points)
        angle = angles()[near]
        normal = np.stack([np.cos(angle), np.sin(angle)], 1)
        along = points[:, 1] * normal[:, 0] - points[:, 0] * normal[:, 1] - self.slope[near]
        out = (points * normal).sum(1)
        distance = out - self.support[near]
        stiff = np.maximum(self.bend[near] + distance, 0.05 * self.bend.mean())
        limit = 4.0 * np.pi / SAMPLES
        turn = np.clip(along / stiff, -limit, limit)
        return (angle + turn) % (2.0 * np.pi), distance + along * turn - 0.5 * stiff * turn**2


def angles() -> Float64[np.ndarray, " N"]:
    """The directions at which supports are kept, radians."""
    return np.linspace(0.0, 2.0 * np.pi, SAMPLES, endpoint=False)


def _around(values: Float64[np.ndarray, " N"], angle: Float[np.ndarray, " P"]) -> Float64[np.ndarray, " P"]:
    """Periodic samples, linear between them."""
    return np.interp(angle, angles(), values, period=2.0 * np.pi)
