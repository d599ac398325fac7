"""Isotropic triangles in a planar region with holes.

Even boundary samples, a hexagonal lattice inside, a Delaunay triangulation made to contain the boundary by splitting
the segments that it misses, and a few rounds of smoothing (Persson and Strang's idea, without its forces).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int32
from scipy.spatial import Delaunay, cKDTree

from fabcraft.errors import InputError
from fabcraft.geometry.contour import counter_clockwise, inside, resample


@dataclass(frozen=True)
class PlaneMesh:
    """Triangles of a planar region, counter-clockwise."""

    points: Float64[np.ndarray, "V 2"]
    faces: Int32[np.ndarray, "F 3"]
    loops: tuple[np.ndarray, ...]
    """Vertex indices of every boundary loop in order: the outer one counter-clockwise, then the holes as given."""


def triangulate(
    loops: list[Float64[np.ndarray, "_ 2"]], edge: float, rounds: int = 12, resampled: bool = False
) -> PlaneMesh:
    """Mesh the region inside `loops[0]` and outside the other loops with edges of about `edge`.

    loops : closed contours, any direction.  resampled : the loops already carry the wanted boundary points.
    Raises `InputError` when the region is too small for one triangle of that size.
    """
    if not resampled:
        loops = [resample(loop, edge, corner_reach=1.2 * edge) for loop in loops]
    loops = [counter_clockwise(loop) for loop in loops]
    interior = _lattice(loops, edge)
    for _ in range(rounds):
        loops, points, faces = _conforming(loops, interior, edge)
        boundary = sum(len(loop) for loop in loops)
        interior = _towards_neighbours(points, faces, boundary)
    loops, points, faces = _conforming(loops, interior, edge)
    if len(faces) == 0:
        raise InputError(
            "the outline encloses no area to mesh",
            f"It must be wider than {edge:.1f} units everywhere it matters.",
        )
    used = np.zeros(len(points), dtype=bool)
    used[faces] = True
    compact = np.cumsum(used) - 1
    starts = np.cumsum([0] + [len(loop) for loop in loops])
    indices = [np.arange(start, start + len(loop)) for start, loop in zip(starts[:-1], loops, strict=True)]
    return PlaneMesh(
        points[used], compact[faces].astype(np.int32), tuple(compact[loop[used[loop]]] for loop in indices)
    )


def _lattice(loops: list[np.ndarray], edge: float) -> np.ndarray:
    """Hexagonal lattice points inside the region, no nearer than 0.65 edge to its boundary."""
    lower, upper = loops[0].min(0), loops[0].max(0)
    middle = 0.5 * (lower + upper)
    rows = np.arange(-np.ceil((upper - lower)[1] / edge), np.ceil((upper - lower)[1] / edge) + 1)
    columns = np.arange(-np.ceil((upper - lower)[0] / edge), np.ceil((upper - lower)[0] / edge) + 1)
    column, row = np.meshgrid(columns, rows)
    lattice = (
        np.stack([(column + 0.5 * (row % 2)) * edge, row * edge * np.sqrt(0.75)], -1).reshape(-1, 2) + middle
    )
    lattice = lattice[inside(lattice, loops)]
    distance, _ = cKDTree(np.concatenate(loops)).query(lattice)
    return lattice[distance > 0.65 * edge]


def _conforming(
    loops: list[np.ndarray], interior: np.ndarray, edge: float, attempts: int = 6
) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Delaunay faces inside the region; boundary segments that the triangulation misses are split in two.

    Never below a quarter of the wanted edge: contours that cross themselves would be split without end.
    """
    for attempt in range(attempts):
        points = np.concatenate([*loops, interior])
        faces = Delaunay(points).simplices
        a, b, c = points[faces].transpose(1, 0, 2)
        twice = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
        longest = np.max([((b - a) ** 2).sum(1), ((c - b) ** 2).sum(1), ((a - c) ** 2).sum(1)], 0)
        faces = np.where((twice < 0)[:, None], faces[:, ::-1], faces)
        keep = (np.abs(twice) > 1e-3 * longest) & inside((a + b + c) / 3.0, loops)
        faces = faces[keep]
        missing = _missing_segments(loops, faces, 0.5 * edge)
        if attempt == attempts - 1 or not any(len(m) for m in missing):
            return loops, points, faces
        loops = [
            np.insert(loop, at + 1, 0.5 * (loop[at] + loop[(at + 1) % len(loop)]), axis=0)
            if len(at)
            else loop
            for loop, at in zip(loops, missing, strict=True)
        ]
    raise AssertionError("the loop returns on its last attempt")


def _missing_segments(loops: list[np.ndarray], faces: np.ndarray, shortest: float) -> list[np.ndarray]:
    """Per loop, the segments longer than `shortest` that are no edge of a face."""
    size = int(max(faces.max(initial=0) + 1, sum(len(loop) for loop in loops)))
    half = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1).astype(np.int64)
    present = np.unique(half[:, 0] * size + half[:, 1])
    missing, start = [], 0
    for loop in loops:
        here = start + np.arange(len(loop))
        pair = np.sort(np.stack([here, np.roll(here, -1)], 1), axis=1)
        long = np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1) > shortest
        missing.append(np.flatnonzero(long & ~np.isin(pair[:, 0] * size + pair[:, 1], present)))
        start += len(loop)
    return missing


def _towards_neighbours(points: np.ndarray, faces: np.ndarray, boundary: int) -> np.ndarray:
    """Interior points moved to the mean of their neighbours; those that fell out of every face are dropped."""
    total, degree = np.zeros_like(points), np.zeros(len(points))
    for i, j in ((0, 1), (1, 2), (2, 0)):
        np.add.at(total, faces[:, i], points[faces[:, j]])
        np.add.at(degree, faces[:, i], 1.0)
        np.add.at(total, faces[:, j], points[faces[:, i]])
        np.add.at(degree, faces[:, j], 1.0)
    used = degree[boundary:] > 0
    return (total[boundary:][used]) / degree[boundary:][used, None]
