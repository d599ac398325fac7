"""Which way a scan lies: a part of the model laid onto it from everywhere.

1,200 rotations spread evenly (M. Alexa, "Super-Fibonacci spirals", CVPR 2022) times two sizes are judged by distance
grids alone; the best are refined by ICP over positions and normals.  A scan may go on beyond the part (shoulders,
forearm, leg), so only its end that every such scan has is looked at: crown, finger tips, sole.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from fabcraft.geometry.align import Similarity, similarity_icp, spread_points

_ROTATIONS = 1200
_SIZES = (0.88, 1.05)
"""Sizes tried, against the person at the start."""
SIZE_RANGE = (0.6, 1.4)
"""Sizes that a person's part may have, against the person at the start."""
_FEW, _POINTS = 250, 500
_CELLS = 56
_FAR = 0.15
"""Share of the part's size at which a distance counts no more."""


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points with their outward normals."""

    points: Float64[np.ndarray, "N 3"]
    normals: Float64[np.ndarray, "N 3"]

    def thinned(self, count: int) -> "Cloud":
        """At most `count` of them, evenly spread."""
        if len(self.points) <= count:
            return self
        chosen = spread_points(self.points, count)
        return Cloud(self.points[chosen], self.normals[chosen])


@dataclass(frozen=True, eq=False)
class Looked:
    """What the search looks at of a part: its cloud, the axis to its sure end, and how far from there."""

    cloud: Cloud
    axis: Float64[np.ndarray, "3"]
    length: float


def even_rotations(count: int = _ROTATIONS) -> Float64[np.ndarray, "N 3 3"]:
    """`count` rotations spread evenly over all, as matrices."""
    s = np.arange(count) + 0.5
    inner, outer = np.sqrt(s / count), np.sqrt(1.0 - s / count)
    a, b = 2 * np.pi * s / np.sqrt(2.0), 2 * np.pi * s / 1.533751168755204288118041
    x, y, z, w = inner * np.sin(a), inner * np.cos(a), outer * np.sin(b), outer * np.cos(b)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def placements(
    part: Looked, scan: Cloud, rotations: Float64[np.ndarray, "N 3 3"]
) -> list[tuple[float, Similarity]]:
    """(misfit, similarity from part to scan), best first; misfit is a distance over the part's size.

    rotations : to be tried, from the part's frame to the scan's.
    """
    few, points, starts = _begun(part, scan, rotations, 24, 18.0)
    promising = _distinct([place for _, place in _refined(few, points, starts, 6)], 6, 8.0)
    return _refined(few, points, promising, 25)


def best_start(part: Looked, scan: Cloud, rotations: Float64[np.ndarray, "N 3 3"]) -> float:
    """The misfit of the best placement after a short refinement, by which kinds of part are told apart."""
    few, points, starts = _begun(part, scan, rotations, 10, 25.0)
    return _refined(few, points, starts, 8)[0][0]


def _begun(
    part: Looked, scan: Cloud, rotations: Float64[np.ndarray, "N 3 3"], count: int, apart_deg: float
) -> tuple[Looked, Cloud, list[Similarity]]:
    """(the part and the scan in few points, the best placements by distance grids)."""
    few = Looked(part.cloud.thinned(_POINTS), part.axis, part.length)
    points = scan.thinned(_POINTS)
    fewer, sparse = Looked(few.cloud.thinned(_FEW), part.axis, part.length), points.thinned(_FEW)
    rough = [pair for size in _SIZES for pair in _judged(fewer, sparse.points, rotations, size)]
    rough.sort(key=lambda pair: pair[0])
    return few, points, _distinct([place for _, place in rough], count, apart_deg)


def _judged(
    part: Looked, scan: Float64[np.ndarray, "N 3"], rotations: Float64[np.ndarray, "R 3 3"], size: float
) -> list[tuple[float, Similarity]]:
    """Misfit of every rotation at one size, by distance grids of both clouds, truncated."""
    model = size * part.cloud.points
    reach = size * part.length
    across = np.linalg.svd(part.axis[None])[2][1:]
    far = _FAR * float(np.ptp(model, axis=0).max())
    to_model, to_scan = _DistanceGrid.of(model, far), _DistanceGrid.of(scan, far)
    goal = _anchor(model[None], part.axis, across, reach)[0]
    near = model[model @ part.axis > (model @ part.axis).max() - reach]
    found = []
    for batch in np.array_split(np.arange(len(rotations)), max(1, len(rotations) // 250)):
        turned = scan @ rotations[batch]  # into the part's frame
        shift = goal - _anchor(turned, part.axis, across, reach)
        along = turned @ part.axis
        seen = along > along.max(1, keepdims=True) - reach
        ahead = to_model.at(turned + shift[:, None])
        ahead = (ahead * seen).sum(1) / seen.sum(1)
        back = (near - shift[:, None]) @ rotations[batch].transpose(0, 2, 1)
        misfit = ahead + to_scan.at(back).mean(1)
        for rotation, move, value in zip(rotations[batch], shift, misfit, strict=True):
            found.append((float(value) / far, Similarity(size, rotation, -(rotation @ move))))
    return found


def _anchor(
    clouds: Float64[np.ndarray, "R N 3"], axis: np.ndarray, across: np.ndarray, reach: float
) -> Float64[np.ndarray, "R 3"]:
    """Of each cloud: the sure end along `axis`, and the middle of what is within `reach` of it across."""
    along = clouds @ axis
    end = along.max(1)
    seen = (along > end[:, None] - reach)[..., None]
    flat = clouds @ across.T
    low = np.where(seen, flat, np.inf).min(1)
    high = np.where(seen, flat, -np.inf).max(1)
    return end[:, None] * axis + 0.5 * (low + high) @ across


def _distinct(places: list[Similarity], count: int, apart_deg: float) -> list[Similarity]:
    """The first `count` whose rotations differ by `apart_deg`."""
    kept: list[Similarity] = []
    for place in places:
        turns = [np.trace(place.rotation.T @ other.rotation) for other in kept]
        if max(turns, default=-1.0) < 1.0 + 2.0 * np.cos(np.radians(apart_deg)):
            kept.append(place)
        if len(kept) == count:
            break
    return kept


def _refined(
    part: Looked, scan: Cloud, starts: list[Similarity], iterations: int
) -> list[tuple[float, Similarity]]:
    """ICP from every start, and the misfit; best first."""
    found = []
    along = part.cloud.points @ part.axis
    near = along > along.max() - part.length
    model = Cloud(part.cloud.points[near], part.cloud.normals[near])
    size = float(np.ptp(model.points, axis=0).max())
    for start in starts:
        seen = _seen(part, scan, start)
        sizes = (max(0.8 * start.scale, SIZE_RANGE[0]), min(1.25 * start.scale, SIZE_RANGE[1]))
        place = similarity_icp(
            model.points, seen.points, model.normals, seen.normals, start, iterations, 0.8, 0.1 * size, sizes
        )
        found.append((_misfit(model, _seen(part, scan, place), place) / (size * place.scale), place))
    return sorted(found, key=lambda pair: pair[0])


def _seen(part: Looked, scan: Cloud, place: Similarity) -> Cloud:
    """The points of the scan that lie beside what is looked at of the part."""
    along = place.inverse().points(scan.points) @ part.axis
    seen = along > (part.cloud.points @ part.axis).max() - 1.1 * part.length
    return Cloud(scan.points[seen], scan.normals[seen]) if seen.sum() > 10 else scan


def _misfit(model: Cloud, scan: Cloud, place: Similarity) -> float:
    """Mean distance both ways over positions and normals, the farthest tenth left out, in the scan's unit."""
    weight = 0.06 * place.scale * float(np.ptp(model.points, axis=0).max())
    moved = np.hstack([place.points(model.points), weight * model.normals @ place.rotation.T])
    fixed = np.hstack([scan.points, weight * scan.normals])
    both = [cKDTree(fixed).query(moved)[0], cKDTree(moved).query(fixed)[0]]
    return float(sum(np.sort(side)[: int(0.9 * len(side))].mean() for side in both))


@dataclass(frozen=True, eq=False)
class _DistanceGrid:
    """Distance to a cloud on a cubic grid, truncated at `far`."""

    values: Float64[np.ndarray, "X Y Z"]
    origin: Float64[np.ndarray, "3"]
    cell: float
    far: float

    @staticmethod
    def of(points: Float64[np.ndarray, "N 3"], far: float) -> "_DistanceGrid":
        low = points.min(0) - far
        cell = float((np.ptp(points, axis=0) + 2 * far).max()) / _CELLS
        shape = np.ceil((np.ptp(points, axis=0) + 2 * far) / cell).astype(int) + 1
        empty = np.ones(shape, dtype=bool)
        empty[tuple(np.rint((points - low) / cell).astype(int).T)] = False
        return _DistanceGrid(np.minimum(cell * distance_transform_edt(empty), far), low, cell, far)

    def at(self, points: Float64[np.ndarray, "... 3"]) -> Float64[np.ndarray, "..."]:
        """The distance at the nearest node; `far` outside the grid."""
        node = np.rint((points - self.origin) / self.cell).astype(np.int32)
        shape = np.array(self.values.shape)
        inside = ((node >= 0) & (node < shape)).all(-1)
        node = np.clip(node, 0, shape - 1)
        return np.where(inside, self.values[node[..., 0], node[..., 1], node[..., 2]], self.far)
