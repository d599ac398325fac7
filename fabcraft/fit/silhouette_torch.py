"""Where silhouette edges pass between pixel centres, in torch operations: `fabcraft.fit.silhouette` for a graphics card.

The rules are those given there. What is found has no derivative; `fabcraft.fit.render_torch` gives the crossings' places
theirs.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float64, Int, Int32
from torch import Tensor

from fabcraft.fit.raster_torch import MOST, pixel_range, spread


@dataclass(frozen=True, eq=False)
class Crossings:
    """Crossings of all views that count: one a pair of neighbouring pixels, by view and inner pixel."""

    view: Int[Tensor, " C"]
    ends: Int[Tensor, "C 2"]
    """Vertices at the ends of the edge."""
    axis: Int[Tensor, " C"]
    """0: the pixels are neighbours in a row; 1: in a column."""
    line: Int[Tensor, " C"]
    """Their common row (or column)."""
    inside: Int[Tensor, " C"]
    """Column (or row) of the covered pixel."""
    inner: Int[Tensor, " C"]
    """The covered pixel, in the flattened pictures of all views."""
    outer: Int[Tensor, " C"]
    """Its neighbour beyond the rim."""


def crossings(
    points: Float64[Tensor, "K V 3"],
    keys: Float64[Tensor, "K V"],
    edges: Int[Tensor, "E 4"],
    face_id: Int32[Tensor, "K H W"],
    nearest: Float64[Tensor, "K H W"],
    most: int = MOST,
) -> Crossings:
    """The visible crossings of the silhouette edges of every view; `nearest` holds the depth keys of `face_id`."""
    screen = torch.cat([points[..., :2], keys[..., None]], 2)
    found, step = [_none(points.device)], max(1, most // max(len(edges), 1))
    for first in range(0, len(points), step):
        view, edge, inner = _rims(screen[first : first + step, :, :2], edges)
        rims, places = _followed(screen, view + first, edges[edge], inner)
        low, high = torch.minimum(places[:, 0], places[:, 1]), torch.maximum(places[:, 0], places[:, 1])
        size = torch.where(rims[:, 3] == 0, face_id.shape[1], face_id.shape[2])
        start, end = pixel_range(low, high, torch.zeros_like(size), size)
        counts = torch.where((high - low) < torch.inf, (end - start).clamp_min(0), 0)
        for owner, nth in spread(counts, most):
            found.append(_visible(rims[owner], places[owner], start[owner] + nth, face_id, nearest))
    return _outermost(*(torch.cat(parts) for parts in zip(*found, strict=True)))


def _none(device: torch.device) -> tuple[Int[Tensor, "0 8"], Float64[Tensor, "0 2"]]:
    """As `_visible`, where there is nothing."""
    return torch.zeros(0, 8, dtype=torch.int64, device=device), torch.zeros(
        0, 2, dtype=torch.float64, device=device
    )


def _rims(
    flat: Float64[Tensor, "K V 2"], edges: Int[Tensor, "E 4"]
) -> tuple[Int[Tensor, " N"], Int[Tensor, " N"], Float64[Tensor, " N"]]:
    """View, edge and inner side of the silhouette edges.

    A face seen exactly edge-on has no side: the other one decides.
    """
    corners = flat[:, edges.clamp_min(0)]
    (ux, uy), (vx, vy) = (
        (corners[:, :, far] - corners[:, :, :1]).unbind(3) for far in (slice(1, 2), slice(2, 4))
    )
    first, second = (ux * vy - vx * uy).unbind(2)
    agree = ((first > 0.0) & (second >= 0.0)) | ((first < 0.0) & (second <= 0.0)) | (edges[:, 3] < 0)
    inner = torch.where(agree, first, torch.where(first == 0.0, second, 0.0))
    view, edge = inner.nonzero().unbind(1)
    return view, edge, inner[view, edge]


def _followed(
    screen: Float64[Tensor, "K V 3"],
    view: Int[Tensor, " N"],
    edges: Int[Tensor, "N 4"],
    inner: Float64[Tensor, " N"],
) -> tuple[Int[Tensor, "N 5"], Float64[Tensor, "N 7"]]:
    """Silhouette edges, each to be followed along the axis that it is longer on, from screen column, row, key.

    Whole numbers: view, two ends, axis across (0: columns), whether the inner side has the larger index. Places of the two
    ends along, of the two ends across, their keys, and how far nearer than the inner pixel centre the rim may be: what its
    faces fall off within a pixel.
    """
    corners = screen[view[:, None], edges.clamp_min(0)]
    a, b = corners[:, 0], corners[:, 1]
    steep = (b - a)[:, 1].abs() >= (b - a)[:, 0].abs()
    along = torch.where(steep[:, None], corners[:, :2, 1], corners[:, :2, 0])
    across = torch.where(steep[:, None], corners[:, :2, 0], corners[:, :2, 1])
    turned = inner * (along[:, 1] - along[:, 0])
    positive = torch.where(steep, turned < 0.0, turned > 0.0)
    slack, other = _slopes(corners).unbind(1)
    slack = torch.where((edges[:, 3] >= 0) & (other > slack), other, slack)
    rims = torch.stack([view, edges[:, 0], edges[:, 1], (~steep).long(), positive.long()], 1)
    return rims, torch.cat([along, across, corners[:, :2, 2], slack[:, None]], 1)


def _slopes(corners: Float64[Tensor, "N 4 3"]) -> Float64[Tensor, "N 2"]:
    """How fast the depth key changes a pixel, over the faces of the first two corners and the third or the fourth."""
    (ux, uy, uk), (vx, vy, vk) = (
        (corners[:, far] - corners[:, :1]).unbind(2) for far in (slice(1, 2), slice(2, 4))
    )
    area = ux * vy - vx * uy
    return ((uk * vy - vk * uy) / area).abs() + ((vk * ux - uk * vx) / area).abs()


def _visible(
    rims: Int[Tensor, "P 5"],
    places: Float64[Tensor, "P 7"],
    line: Int[Tensor, " P"],
    face_id: Int32[Tensor, "K H W"],
    nearest: Float64[Tensor, "K H W"],
) -> tuple[Int[Tensor, "C 8"], Float64[Tensor, "C 2"]]:
    """The crossings of edges with lines that can be seen, and what they are ranked by: t, depth key."""
    height, width = face_id.shape[1:]
    view, first, second, axis, positive = rims.unbind(1)
    along_a, along_b, across_a, across_b, key_a, key_b, slack = places.unbind(1)
    s = (line + 0.5 - along_a) / (along_b - along_a)
    across = across_a + s * (across_b - across_a)
    met = (line + 0.5 < torch.maximum(along_a, along_b)) & (s >= 0.0) & (s <= 1.0)
    limit = torch.where(axis == 0, width, height)
    met &= (across > 0.5) & (across <= limit - 0.5)  # between two pixels of the picture
    near = torch.where(met, across - 0.5, 1.0).ceil().long()
    inside, outside = near - 1 + positive, near - positive
    inner, outer = (
        torch.where(
            met, view * (height * width) + torch.where(axis == 0, line * width + at, at * width + line), 0
        )
        for at in (inside, outside)
    )
    key = key_a + s * (key_b - key_a)
    seen, depth = face_id.reshape(-1), nearest.reshape(-1)
    met &= (seen[inner] >= 0) & (key < depth[outer]) & (depth[inner] <= key + slack)
    kept = met.nonzero()[:, 0]
    whole = torch.stack([view, first, second, axis, line, inside, inner, outer], 1)
    return whole[kept], torch.stack([(across - inside - 0.5).abs(), key], 1)[kept]


def _outermost(whole: Int[Tensor, "C 8"], ranks: Float64[Tensor, "C 2"]) -> Crossings:
    """One crossing a pixel pair: the outermost, else the nearest, else that of the first edge."""
    inner, outer = whole[:, 6], whole[:, 7]
    pair = 4 * inner + 2 * (1 - whole[:, 3]) + (outer < inner)
    order = ranks[:, 1].argsort(stable=True)
    for rank in (-ranks[:, 0], pair):
        order = order[rank[order].argsort(stable=True)]
    ranked = pair[order]
    first = torch.ones_like(ranked, dtype=torch.bool)
    first[1:] = ranked[1:] != ranked[:-1]
    view, _, _, axis, line, inside, inner, outer = whole[order[first]].unbind(1)
    return Crossings(view, whole[order[first], 1:3], axis, line, inside, inner, outer)
