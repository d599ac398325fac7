"""Where a wall is too thin: connected patches of samples, each held against the minimum for its borders."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fabcraft.check.balls import TOLERANCE, Balls
from fabcraft.check.report import Place, places


@dataclass(frozen=True)
class ThinRegion:
    """A connected patch of surface under the minimum wall."""

    centre: Place
    """The sample of the patch closest to its mean, mm."""
    area_mm2: float
    thinnest_mm: float
    free: bool
    """The wall ends here (a blade, a fin); otherwise it is joined to the rest on two or more sides."""
    limit_mm: float
    """The minimum wall that holds for it."""


def thinnest(values: np.ndarray, areas: np.ndarray, at_least: float = 0.0) -> float:
    """The value that 1 mm² (or 0.1 % of a small surface, or `at_least` mm²) does not exceed, mm."""
    order = np.argsort(values, kind="stable")
    covered = np.cumsum(areas[order])
    return float(values[order[np.searchsorted(covered, max(min(1.0, 1e-3 * covered[-1]), at_least))]])


def thin_regions(
    balls: Balls, values: np.ndarray, minimum: float, supported: float, spacing: float, smallest: float
) -> tuple[np.ndarray, tuple[ThinRegion, ...]]:
    """Thin samples, and their connected patches, each held against the minimum that its borders ask for."""
    thin = values < max(minimum, supported) * (1 - TOLERANCE)
    index = np.flatnonzero(thin)
    label = _patches(balls.points[index], balls.normals[index], spacing)
    free = _is_free(balls, index, label, spacing)
    limits = np.where(free[label], minimum, supported) if len(index) else np.zeros(0)
    under = values[index] < limits * (1 - TOLERANCE)
    thin[index] = under
    free_here = free[label]
    if not under.all():
        index, limits, free_here = index[under], limits[under], free_here[under]
        label = _patches(balls.points[index], balls.normals[index], spacing)
    found = []
    for patch in range(int(label.max(initial=-1)) + 1):
        members = index[label == patch]
        area = float(balls.areas[members].sum())
        if area >= smallest:
            first = int(np.argmax(label == patch))
            middle = np.average(balls.points[members], axis=0, weights=balls.areas[members])
            central = members[np.argmin(((balls.points[members] - middle) ** 2).sum(1))]
            found.append(
                ThinRegion(
                    centre=places(balls.points[central][None])[0],
                    area_mm2=area,
                    thinnest_mm=thinnest(values[members], balls.areas[members]),
                    free=bool(free_here[first]),
                    limit_mm=float(limits[first]),
                )
            )
    return thin, tuple(sorted(found, key=lambda region: (-region.area_mm2, region.centre)))


def _patches(points: np.ndarray, normals: np.ndarray, spacing: float) -> np.ndarray:
    """Connected patches of samples: neighbours within 2.2 spacings that do not look opposite ways."""
    count = len(points)
    if count < 2:
        return np.zeros(count, dtype=np.int64)
    gap, other = cKDTree(points).query(points, k=min(7, count), distance_upper_bound=2.2 * spacing, workers=2)
    row, column = np.nonzero(np.isfinite(gap))
    other = other[row, column]
    agree = np.einsum("ij,ij->i", normals[row], normals[other]) > -0.2
    graph = coo_array((np.ones(agree.sum(), dtype=bool), (row[agree], other[agree])), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def _is_free(balls: Balls, index: np.ndarray, label: np.ndarray, spacing: float) -> np.ndarray:
    """Of every patch: does the surface run round the wall's border, so that both sides are one patch?"""
    count = int(label.max(initial=-1)) + 1
    if count == 0:
        return np.zeros(0, dtype=bool)
    back = balls.points[index] - balls.ray_mm[index, None].clip(max=1e6) * balls.normals[index]
    gap, other = cKDTree(balls.points[index]).query(back, distance_upper_bound=2 * spacing, workers=2)
    same = np.isfinite(gap) & (label == label[np.minimum(other, len(index) - 1)])
    areas = balls.areas[index]
    return np.bincount(label, areas * same, minlength=count) > 0.5 * np.bincount(
        label, areas, minlength=count
    )
