"""Which triangle is seen at which pixel, in torch operations: `fabcraft.geometry.raster` for a graphics card.

The same rules to the bit: pixel centres at halves, top-left rule, both windings, of equally near faces the one with the
lower index. Every row that a face reaches, and then every pixel of that row that it may cover, is written out, a bounded
number at a time. The least depth key of a pixel, and then the least face at that depth, are minima, which no order of
threads can change.
"""

from collections.abc import Iterator
from typing import TypeVar

import torch
from jaxtyping import Bool, Float64, Int, Int32
from torch import Tensor

MOST = 1 << 20
"""Pairs of a face, or an edge, and a row or a pixel that are held in memory at a time."""
_Bound = TypeVar("_Bound", Tensor, int)
_MARGIN_PX = 0.01
"""How far rounding may move the end of a row's span; the pixels within it are tested exactly."""


def zbuffer(
    points: Float64[Tensor, "K V 3"],
    keys: Float64[Tensor, "K V"],
    faces: Int[Tensor, "F 3"],
    height: int,
    width: int,
    most: int = MOST,
) -> tuple[Int32[Tensor, "K H W"], Float64[Tensor, "K H W"]]:
    """The face seen at every pixel centre (-1: none) and its depth key (+inf).

    points : column, row (and depth, not looked at).  keys : smaller is nearer, linear over the picture; NaN hides a face.
    """
    nobody = len(faces)
    nearest = points.new_full((len(points) * height * width,), torch.inf)
    seen = torch.full_like(nearest, nobody, dtype=torch.int64)
    step = max(1, most // max(nobody, 1))
    for first in range(0, len(points), step):
        corners = torch.cat([points[first : first + step, :, :2], keys[first : first + step, :, None]], 2)
        for number, place, key, inside in _pairs(corners[:, faces], height, width, most):
            pixel = (first + number // nobody) * (height * width) + place
            before = nearest.clone()
            nearest.scatter_reduce_(0, pixel, torch.where(inside, key, torch.inf), "amin")
            seen = torch.where(nearest < before, nobody, seen)
            hit = inside & (key == nearest[pixel])
            seen.scatter_reduce_(0, pixel, torch.where(hit, number % nobody, nobody), "amin")
    size = (len(points), height, width)
    return torch.where(seen == nobody, -1, seen).int().reshape(size), nearest.reshape(size)


def pixel_range(
    low: Float64[Tensor, "..."], high: Float64[Tensor, "..."], start: _Bound, end: _Bound
) -> tuple[Int[Tensor, "..."], Int[Tensor, "..."]]:
    """First and end index in [start, end), start >= 0, of the pixels whose centre lies in [low, high]."""
    first = (low - 0.5).clamp(start, end).ceil().long()
    return first, (high + 0.5).clamp(start, end).long()


def spread(counts: Int[Tensor, " N"], most: int) -> Iterator[tuple[Int[Tensor, " P"], Int[Tensor, " P"]]]:
    """Item i comes counts[i] times: chunks, of at most `most`, of which item it is and which of its times, from 0."""
    ends = counts.cumsum(0)
    starts = ends - counts
    items = torch.arange(len(counts), device=counts.device)
    whole = int(ends[-1]) if len(counts) else 0
    for first in range(0, whole, most):
        end = min(first + most, whole)
        here = counts if end - first == whole else ends.clamp(first, end) - starts.clamp(first, end)
        owner = items.repeat_interleave(here, output_size=end - first)
        yield owner, torch.arange(first, end, device=counts.device) - starts[owner]


def _pairs(
    corners: Float64[Tensor, "K F 3 3"], height: int, width: int, most: int
) -> Iterator[tuple[Int[Tensor, " P"], Int[Tensor, " P"], Float64[Tensor, " P"], Bool[Tensor, " P"]]]:
    """Chunks of faces, of all views, and pixels they may cover, from corners column, row, key.

    Of every pair: the number k F + f of the face, the pixel in its flattened picture, the depth key there, and whether
    the face covers the pixel centre.
    """
    number, boxes, corners, area = _usable(corners, height, width)
    edges, tests = _edges(corners, area)
    for face, nth in spread(boxes[:, 1] - boxes[:, 0], most):
        # the edge function e = u (y - level) - drop (x - column), in this row begun - drop (x - column), ...
        u, level, drop, column = edges[face].unbind(2)
        row, _, start, end = boxes[face].unbind(1)
        row = row + nth
        begun = u * ((row + 0.5)[:, None] - level)
        at = column + begun / drop  # ... changes its sign here
        low = torch.where(drop < 0.0, at, -torch.inf).amax(1)
        high = torch.where(drop > 0.0, at, torch.inf).amin(1)
        start, end = pixel_range(low - _MARGIN_PX, high + _MARGIN_PX, start, end)
        lines = torch.stack([face, row * width, start], 1)
        for line, further in spread((end - start).clamp_min(0), most):
            owner, begin, start = lines[line].unbind(1)
            pixel = start + further
            drop, column, key, inclusive, scale = tests[owner].unbind(2)
            edge = begun[line] - drop * ((pixel + 0.5)[:, None] - column)
            inside = ((edge > 0.0) | ((edge == 0.0) & (inclusive > 0.0))).all(1)
            first, second, third = (edge * key).unbind(1)
            yield number[owner], begin + pixel, (first + second + third) * scale[:, 0], inside


def _usable(
    corners: Float64[Tensor, "K F 3 3"], height: int, width: int
) -> tuple[Int[Tensor, " N"], Int[Tensor, "N 4"], Float64[Tensor, "N 3 3"], Float64[Tensor, " N"]]:
    """The faces that have an area and a pixel centre in their box.

    Their numbers, their boxes (first and end row, first and end column), their corners, turned so that the area is
    positive, and twice that area.
    """
    low, high = corners[..., :2].amin(2), corners[..., :2].amax(2)
    left, right = pixel_range(low[..., 0], high[..., 0], 0, width)
    top, bottom = pixel_range(low[..., 1], high[..., 1], 0, height)
    (ux, uy), (vx, vy) = ((corners[:, :, i, :2] - corners[:, :, 0, :2]).unbind(2) for i in (1, 2))
    area = ux * vy - vx * uy
    kept = (area.abs() > 1e-14) & (area.abs() < torch.inf) & (corners[..., 2].sum(2).abs() < torch.inf)
    kept &= (top < bottom) & (left < right)
    number = kept.reshape(-1).nonzero()[:, 0]
    boxes = torch.stack([top, bottom, left, right], 2).reshape(-1, 4)[number]
    corners, area = corners.reshape(-1, 3, 3)[number], area.reshape(-1)[number]
    turned = torch.where((area < 0.0)[:, None, None], corners[:, [0, 2, 1]], corners)
    return number, boxes, turned, area.abs()


def _edges(
    corners: Float64[Tensor, "N 3 3"], area: Float64[Tensor, " N"]
) -> tuple[Float64[Tensor, "N 3 4"], Float64[Tensor, "N 3 5"]]:
    """Of the edge opposite every corner: u, level, drop, column; and drop, column, key of the corner, top-left, 1 / area.

    The reference point (column, level) is the same for both faces of an edge, so that e changes nothing but its sign.
    """
    a, b = corners.roll(-1, 1), corners.roll(-2, 1)
    u, drop, _ = (b - a).unbind(2)
    level = drop == 0.0
    inclusive = (drop < 0.0) | (level & (u > 0.0))
    from_a = (drop > 0.0) | (level & (u > 0.0))
    column, row, _ = torch.where(from_a[:, :, None], a, b).unbind(2)
    scale = (1.0 / area)[:, None].expand_as(u)
    tests = torch.stack([drop, column, corners[..., 2], inclusive.to(u), scale], 2)
    return torch.stack([u, row, drop, column], 2), tests
