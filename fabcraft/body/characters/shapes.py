"""Signed distances of the shapes that characters are modelled from, and how they are joined.

Convention: negative inside, millimetres.  Every shape knows a ball that holds it, so that a union asks it only where it
can matter.  Round cones and boxes are exact; ellipsoids are the usual first-order estimate (their surface is exact).
Formulas after Quilez, "Distance functions" (iquilezles.org); the smooth union is his quadratic polynomial, which moves
the surface by up to a quarter of `blend`.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation

Number = float | int
Point = tuple[Number, Number, Number]

UNTURNED: Point = (0.0, 0.0, 0.0)
_SPANS = 3  # straight pieces between two given points of a limb


@dataclass(frozen=True, eq=False)
class Shape:
    """A solid given by its signed distance."""

    distance: Callable[[Float64[np.ndarray, "N 3"]], Float64[np.ndarray, " N"]]
    """Signed distance, mm, of points (N, 3)."""
    centre: Float64[np.ndarray, "3"]
    """Middle of a ball that holds it."""
    radius: float
    """Radius of that ball."""

    def least(self, points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        """A lower bound of the distance."""
        return _length(points - self.centre) - self.radius


def point(place: Point | np.ndarray) -> Float64[np.ndarray, "3"]:
    """A point as an array."""
    return np.array(place, dtype=np.float64)


def ellipsoid(centre: Point, radii: Point, turn_deg: Point = UNTURNED) -> Shape:
    """An ellipsoid; `turn_deg` turns it about x, then y, then z."""
    axes = Rotation.from_euler("xyz", turn_deg, degrees=True).as_matrix() / np.array(radii)
    middle, inverse = point(centre), 1.0 / np.array(radii)

    def distance(points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        local = (points - middle) @ axes
        k, slope = _length(local), _length(local * inverse)
        return np.where(slope > 1e-9, k * (k - 1.0) / np.maximum(slope, 1e-9), -min(radii))

    return Shape(distance, middle, float(max(radii)))


def ball(centre: Point, radius: Number) -> Shape:
    """A ball."""
    middle = point(centre)
    return Shape(lambda points: _length(points - middle) - radius, middle, float(radius))


def limb(points: Sequence[Point], radii: Sequence[Number]) -> Shape:
    """A round tube through `points`, curved where there are more than two, with a radius at each."""
    spans = _SPANS if len(points) > 2 else 1
    places, widths = (
        _curve(np.array(points, dtype=np.float64), spans),
        _curve(np.array(radii, dtype=np.float64), spans),
    )
    return joined(0.0, *map(_round_cone, places[:-1], places[1:], widths[:-1], widths[1:]))


def crease(shape: Shape, points: Sequence[Point], radius: Number) -> Shape:
    """A tube along the surface of `shape` below or above a curve through `points`; carved off, it leaves a groove."""
    places, _ = _on_surface(shape, _curve(np.array(points, dtype=np.float64), 2 * _SPANS))
    return joined(0.0, *[_round_cone(a, b, radius, radius) for a, b in itertools.pairwise(places)])


def thorn(shape: Shape, near: Point, radius: Number, height: Number) -> Shape:
    """A blunt cone that stands square on the surface of `shape`, at the place nearest to `near`."""
    (foot,), (normal,) = _on_surface(shape, np.array([near], dtype=np.float64))
    root, tip = foot - 0.4 * radius * normal, foot + (height - 0.4 * radius) * normal
    return _round_cone(root, tip, radius, 0.4 * radius)


def _curve(values: Float64[np.ndarray, "N ..."], spans: int) -> Float64[np.ndarray, "M ..."]:
    """A monotone cubic through the values, `spans` steps between two of them."""
    knots = np.arange(len(values), dtype=np.float64)
    return PchipInterpolator(knots, values)(np.linspace(0.0, knots[-1], (len(values) - 1) * spans + 1))


def _on_surface(
    shape: Shape, points: Float64[np.ndarray, "N 3"]
) -> tuple[Float64[np.ndarray, "N 3"], Float64[np.ndarray, "N 3"]]:
    """The places of the surface that the gradient leads to, and the outward normals there."""
    for _ in range(8):
        slopes = [shape.distance(points + step) - shape.distance(points - step) for step in 0.1 * np.eye(3)]
        gradient = np.stack(slopes, axis=1)
        normals = gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-12)
        points = points - shape.distance(points)[:, None] * normals
    return points, normals


def _round_cone(a: np.ndarray, b: np.ndarray, radius_a: Number, radius_b: Number) -> Shape:
    """The hull of two balls."""
    length = float(np.linalg.norm(b - a))
    axis = (b - a) / length
    less = float(radius_a - radius_b)
    side = np.sqrt(max(length**2 - less**2, 0.0))

    def distance(points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        away = points - a
        along = away @ axis
        across = np.sqrt(np.maximum(np.einsum("ij,ij->i", away, away) - along**2, 0.0))
        # the nearest ball along the axis: the foot of the normal to the slanted side
        foot = np.clip(along - across * less / side, 0.0, length) if side > 0.0 else np.full(len(along), 0.0)
        return np.hypot(across, along - foot) - (radius_a - foot * (less / length))

    return Shape(distance, 0.5 * (a + b), 0.5 * length + float(max(radius_a, radius_b)))


def box(centre: Point, half: Point, rounding: Number, narrowing: Number = 0.0) -> Shape:
    """A box with edges rounded by `rounding`; its half width in x shrinks by the share `narrowing` to the top."""
    middle = point(centre)

    def distance(points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        local = points - middle
        share = np.clip(0.5 + 0.5 * local[:, 2] / half[2], 0.0, 1.0)
        outside = np.abs(local) - (np.array(half) - rounding)
        outside[:, 0] += half[0] * narrowing * share
        return _rounded(outside, rounding)

    return Shape(distance, middle, float(np.linalg.norm(half)))


def drum(centre: Point, radius: Number, half_height: Number, rounding: Number) -> Shape:
    """An upright cylinder with rounded rims."""
    middle = point(centre)

    def distance(points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        local = points - middle
        across, up = np.hypot(local[:, 0], local[:, 1]), np.abs(local[:, 2])
        return _rounded(np.stack([across - radius, up - half_height], axis=1) + rounding, rounding)

    return Shape(distance, middle, float(np.hypot(radius, half_height)))


def _rounded(outside: Float64[np.ndarray, "N K"], rounding: Number) -> Float64[np.ndarray, " N"]:
    """Distance to a box shrunk by `rounding`, from the excess along each axis, then grown again."""
    beyond = _length(np.maximum(outside, 0.0))
    return beyond + np.minimum(outside.max(1), 0.0) - rounding


def joined(blend: Number, *shapes: Shape) -> Shape:
    """The union, each shape melting into the ones before it over about `blend`."""
    middle = 0.5 * (
        np.min([shape.centre - shape.radius for shape in shapes], axis=0)
        + np.max([shape.centre + shape.radius for shape in shapes], axis=0)
    )
    radius = max(float(np.linalg.norm(shape.centre - middle)) + shape.radius for shape in shapes)

    def distance(points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        total = shapes[0].distance(points)
        for shape in shapes[1:]:
            near = np.flatnonzero(shape.least(points) < total + blend)
            if len(near):
                total[near] = _smooth_min(total[near], shape.distance(points[near]), blend)
        return total

    return Shape(distance, middle, radius + 0.25 * blend)


def carved(blend: Number, shape: Shape, *cutters: Shape) -> Shape:
    """`shape` without the cutters, the edges softened over about `blend`."""

    def distance(points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        total = shape.distance(points)
        for cutter in cutters:
            near = np.flatnonzero(cutter.least(points) < blend - total)
            if len(near):
                total[near] = -_smooth_min(-total[near], cutter.distance(points[near]), blend)
        return total

    return Shape(distance, shape.centre, shape.radius)


def both_sides(shape: Shape, blend: Number = 0.0) -> Shape:
    """The shape and its mirror image in the plane x = 0."""
    flip = np.array([-1.0, 1.0, 1.0])
    mirrored = Shape(lambda points: shape.distance(points * flip), shape.centre * flip, shape.radius)
    return joined(blend, shape, mirrored)


def standing(shape: Shape, softness: Number) -> Shape:
    """`shape` cut off level at z = 0, to stand on; the rim of the cut is rounded over about `softness`."""

    def distance(points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        return -_smooth_min(-shape.distance(points), points[:, 2], softness)

    return Shape(distance, shape.centre, shape.radius)


def _smooth_min(
    first: Float64[np.ndarray, " N"], second: Float64[np.ndarray, " N"], blend: Number
) -> Float64[np.ndarray, " N"]:
    if blend <= 0.0:
        return np.minimum(first, second)
    share = np.maximum(blend - np.abs(first - second), 0.0) / blend
    return np.minimum(first, second) - 0.25 * blend * share**2


def _length(vectors: Float64[np.ndarray, "N K"]) -> Float64[np.ndarray, " N"]:
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
