"""A plate: outlines in a picture plane, some thickness, rounded edges, in near-equilateral triangles.

Both faces are triangulated in the plane; between them rows of points follow every outline over its rounded edges, each row
half a step ahead of the one before, so that edges are as smooth as the outlines.  Places are (u, v, w): u and v in the
plane, w from 0 on the inner face to the thickness on the outer one; whoever uses it rolls or lays the plane in place.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int32, Int64
from scipy.ndimage import gaussian_filter1d

from fabcraft.errors import SolidError
from fabcraft.geometry.contour import counter_clockwise, resample, resample_open
from fabcraft.geometry.triangulate import triangulate

_FINE = 0.1
"""Spacing of the outlines that normals are taken from, in edges."""
_HEIGHT = 0.5 * np.sqrt(3.0)
"""Of an equilateral triangle."""


@dataclass(frozen=True)
class Rim:
    """The edge between the two faces of a plate, mm."""

    inner_mm: float
    """Radius on the side of the inner face."""
    outer_mm: float
    groove_mm: float = 0.0
    """Depth of a right-angled groove in the middle of the wall; 0 for none."""

    def profile(self, thickness_mm: float, edge_mm: float) -> Float64[np.ndarray, "R 2"]:
        """(way into the material, w) of the rows from the border of the outer face to that of the inner one."""
        high, low = thickness_mm - self.outer_mm, self.inner_mm
        middle, deep = 0.5 * (high + low), self.groove_mm
        wall = [(0.0, high), (0.0, low)] if deep == 0.0 else []
        if deep > 0.0:
            wall = [(0.0, high), (0.0, middle + deep), (deep, middle), (0.0, middle - deep), (0.0, low)]
        rows = [_arc(self.outer_mm, edge_mm)[:-1] * [1.0, -1.0] + [0.0, thickness_mm]]
        for start, end in itertools.pairwise(wall):
            way = float(np.hypot(end[0] - start[0], end[1] - start[1]))
            if way > 1e-6:
                count = max(1, round(way / (_HEIGHT * edge_mm)))
                rows.append(np.linspace(start, end, count, endpoint=False))
        rows.append(_arc(self.inner_mm, edge_mm)[::-1])
        return np.concatenate(rows)


@dataclass(frozen=True, eq=False)
class Plate:
    """A meshed plate: closed, or open where a half ends in the plane u = 0."""

    points: Float64[np.ndarray, "V 3"]
    """(u, v, w), mm."""
    faces: Int32[np.ndarray, "F 3"]
    """Outward when (u, v, w) are right-handed."""


def plate(
    outlines: Sequence[Float64[np.ndarray, "_ 2"]],
    thickness_mm: float,
    rims: Sequence[Rim],
    edge_mm: float,
    half: bool = False,
) -> Plate:
    """The plate inside the first outline and outside the others, with a rim for each.

    half : the first outline is open, from (0, v) round through u > 0 to another (0, v); the mesh ends in u = 0.
    Outlines are smooth: bent no tighter than their rims are round.
    Raises `SolidError` where the plate is too narrow for its edge length.
    """
    rows = [
        _rows(outline, rim.profile(thickness_mm, edge_mm), edge_mm, hole=index > 0, open_=half and index == 0)
        for index, (outline, rim) in enumerate(zip(outlines, rims, strict=True))
    ]
    outer, outer_loops = _face([one[0] for one in rows], edge_mm, half)
    inner, inner_loops = _face([one[-1] for one in rows], edge_mm, half)
    points = [np.column_stack([outer.points, np.full(len(outer.points), thickness_mm)])]
    points.append(np.column_stack([inner.points, np.zeros(len(inner.points))]))
    faces = [outer.faces, inner.faces[:, ::-1] + len(outer.points)]
    count = len(outer.points) + len(inner.points)
    for index, one in enumerate(rows):
        before = outer_loops[index]
        for row, following in itertools.pairwise(one):
            if following is one[-1]:
                after = inner_loops[index] + len(outer.points)
            else:
                after = count + np.arange(len(following.places))
                points.append(following.places)
                count += len(following.places)
            strip = _strip(before, row.shares, after, following.shares, closed=not (half and index == 0))
            faces.append(strip[:, ::-1] if index else strip)
            before = after
    return Plate(np.concatenate(points), np.concatenate(faces).astype(np.int32))


@dataclass(frozen=True, eq=False)
class _Row:
    """Points along an outline, at one place of its rim."""

    places: Float64[np.ndarray, "N 3"]
    """(u, v, w)."""
    shares: Float64[np.ndarray, " N"]
    """Of the outline's length, rising."""


def _arc(radius: float, edge_mm: float) -> Float64[np.ndarray, "N 2"]:
    """A quarter circle, from where it leaves the face to where it meets the wall: (way into the material, depth)."""
    count = max(1, round(0.5 * np.pi * radius / (_HEIGHT * edge_mm))) if radius > 0.0 else 0
    turn = np.linspace(0.0, 0.5 * np.pi, count + 1) if count else np.array([0.5 * np.pi])
    return radius * np.stack([1.0 - np.sin(turn), 1.0 - np.cos(turn)], 1)


def _rows(
    outline: np.ndarray, profile: Float64[np.ndarray, "R 2"], edge_mm: float, hole: bool, open_: bool
) -> list[_Row]:
    """Every second row is half a step ahead; of an open outline the ends stay where they are."""
    line = outline if open_ else counter_clockwise(outline)
    fine = (resample_open if open_ else resample)(line, _FINE * edge_mm)
    ahead = np.gradient(fine, axis=0) if open_ else np.roll(fine, -1, axis=0) - np.roll(fine, 1, axis=0)
    if open_:
        ahead[[0, -1], 1] = 0.0  # it crosses u = 0 square to it
    ahead = gaussian_filter1d(ahead, 3.0, axis=0, mode="nearest" if open_ else "wrap")
    normal = np.stack([-ahead[:, 1], ahead[:, 0]], 1) * (-1.0 if hole else 1.0)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    if open_:
        normal[[0, -1]] = np.round(normal[[0, -1]])
    closing = fine[-1:] if open_ else fine[:1]
    steps = np.linalg.norm(np.diff(np.concatenate([fine, closing]), axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])[: len(fine)] / steps.sum()
    count = max(6, round(float(steps.sum()) / edge_mm))
    even = np.arange(count) / count
    rows = []
    for index, (deep, w) in enumerate(profile):
        shares = even + 0.5 / count * (index % 2)
        if open_:
            shares = np.unique(np.concatenate([[0.0], shares, [1.0]]))
        inset = fine + deep * normal
        period = None if open_ else 1.0
        places = [np.interp(shares, way, inset[:, axis], period=period) for axis in (0, 1)]
        rows.append(_Row(np.stack([*places, np.full(len(shares), w)], 1), shares))
    return rows


@dataclass(frozen=True, eq=False)
class _Face:
    points: Float64[np.ndarray, "V 2"]
    faces: Int32[np.ndarray, "F 3"]


def _face(borders: Sequence[_Row], edge_mm: float, half: bool) -> tuple[_Face, list[Int64[np.ndarray, " _"]]]:
    """One face of the plate, and the vertices of its borders in the order of their rows."""
    loops = [row.places[:, :2] for row in borders]
    own = len(loops[0])
    if half:  # closed along u = 0, from the top back down to the bottom
        ends = loops[0][[-1, 0]]
        seam = resample_open(ends, edge_mm)[1:-1]
        loops[0] = np.concatenate([loops[0], seam])
    flat = triangulate(loops, edge_mm, resampled=True)
    if [len(loop) for loop in flat.loops] != [len(loop) for loop in loops]:
        raise SolidError(
            f"the plate is too narrow somewhere for edges of {edge_mm:g} mm",
            "Make it wider, or ask for shorter edges.",
        )
    return _Face(flat.points, flat.faces), [flat.loops[0][:own], *flat.loops[1:]]


def _strip(
    first: Int64[np.ndarray, " N"],
    first_shares: Float[np.ndarray, " N"],
    second: Int64[np.ndarray, " M"],
    second_shares: Float[np.ndarray, " M"],
    closed: bool,
) -> Int64[np.ndarray, "F 3"]:
    """Triangles between two rows of vertices, always on to the one that comes next along the outline."""
    if closed:
        first, second = np.append(first, first[0]), np.append(second, second[0])
        first_shares = np.append(first_shares, first_shares[0] + 1.0)
        second_shares = np.append(second_shares, second_shares[0] + 1.0)
    order = np.argsort(np.concatenate([first_shares[1:], second_shares[1:]]), kind="stable")
    on_first = order < len(first) - 1
    i: np.ndarray = np.cumsum(on_first) - on_first
    j: np.ndarray = np.cumsum(~on_first) - ~on_first
    third = np.where(
        on_first, first[np.minimum(i + 1, len(first) - 1)], second[np.minimum(j + 1, len(second) - 1)]
    )
    return np.stack([first[i], second[j], third], 1)
