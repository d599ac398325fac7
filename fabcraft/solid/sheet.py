"""A wall around a sheet: the sheet as medial surface, pushed clear of the body, and the field of its wall.

The wall is every point whose distance d to the sheet is at most half the wall, t/2; so its rims are
round with radius t/2. A `SheetSide` adds material on one side only. For a point q with closest sheet
point c, n the smooth normal there and cos = (q - c) . n / d:

    f(q) = d - t/2 - outer(c) max(0, cos)^2 - inner(c) max(0, -cos)^2,   f(q) = max(f(q), clearance(q) -
    body(q)).

The body comes first, not last: the sheet's vertices move out along the gradient of the body's distance
until their whole wall is clear, so that the second line has next to nothing left to cut and the wall
keeps its thickness.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float64, Int32, Int64

from fabcraft.errors import InputError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.edges import split_edges
from fabcraft.geometry.voxels import BAND_CELLS, Grid, samples
from fabcraft.mesh import Mesh

PerPoint = Callable[[Float64[np.ndarray, "N 3"]], Float64[np.ndarray, " N"]]

MOST_EXTRA_MM = 60.0
"""Largest height a `SheetSide` may add: the pads of a mask for a figure of twice a person's height need 45 mm."""

PUSH_MARGIN_MM = 0.05
"""How much further than needed the medial surface is pushed, against the sag of its facets."""

HOLE_EDGE_MM = 1.0
"""The edges of holes are rounded over about this much: straps and fingers run over them."""

# How far the body's distance inside a face may lie below what its corners say.
_SAG_MM = 0.25


@dataclass(frozen=True, eq=False)
class SheetSide:
    """Material beyond half the wall, by place on the given sheet; heights in mm, 0 to 15.

    Both functions receive points of the sheet as it was handed in, before it was pushed off a body.
    """

    outer_mm: PerPoint | None = None
    """Height added on the side that the face normals look to."""
    inner_mm: PerPoint | None = None
    """Height added on the other side."""
    inner_edge_mm: float = 0.0
    """Over about how much the edges of that are rounded where the body's clearance cuts it off."""
    hole_mm: PerPoint | None = None
    """Signed distance to what is cut out of the wall, negative in the hole, for any point of space."""


@dataclass(frozen=True, eq=False)
class KeepOut:
    """The body and the distance to keep from it."""

    body: SurfaceDistance
    clearance_mm: PerPoint
    """Smallest distance between the object and the body at a point."""

    def excess(self, points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        """Signed distance to the body less the clearance, mm; negative where the object must not be."""
        return self.body.signed(points) - self.clearance_mm(points)


@dataclass(frozen=True, eq=False)
class Sheet:
    """A medial surface: `mesh` where it ended up, `rest` (V, 3) where its vertices were handed in."""

    mesh: Mesh
    rest: Float64[np.ndarray, "V 3"]
    pushed_mm: float = field(default=0.0)
    """Largest way that a vertex was pushed."""


def make_sheet(mesh: Mesh, half_mm: float, keep: KeepOut | None, longest_mm: float = 5.0) -> Sheet:
    """The mesh with edges up to `longest_mm`, pushed until a wall of `half_mm` each side is clear."""
    fine = split_edges(mesh, longest_mm)
    if keep is None:
        return Sheet(fine, np.array(fine.vertices))
    moved = push_out(fine.vertices, keep, half_mm + PUSH_MARGIN_MM)
    way = float(np.linalg.norm(moved - fine.vertices, axis=1).max())
    return Sheet(fine.with_vertices(moved), np.array(fine.vertices), way)


def push_out(
    points: Float64[np.ndarray, "N 3"], keep: KeepOut, distance_mm: float, rounds: int = 6
) -> Float64[np.ndarray, "N 3"]:
    """Points moved out along the gradient of the body's distance to `distance_mm` beyond the clearance."""
    moved = np.array(points)
    active = np.arange(len(moved))
    for _ in range(rounds):
        signed, gradient = keep.body.signed_with_gradient(moved[active])
        missing = keep.clearance_mm(moved[active]) + distance_mm - signed
        short = missing > 1e-4
        active = active[short]
        if len(active) == 0:
            break
        moved[active] += missing[short, None] * gradient[short]
    return moved


def smooth_normals(mesh: Mesh) -> Float64[np.ndarray, "V 3"]:
    """Unit normal of every vertex, the faces around it weighted by their angle there."""
    corners = mesh.corners
    after, before = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    across = np.linalg.norm(np.cross(after, before), axis=2)
    angles = np.arctan2(across, (after * before).sum(2))
    weighted = angles[:, :, None] * mesh.face_normals[:, None, :]
    index = mesh.faces.reshape(-1)
    total = np.stack(
        [np.bincount(index, weighted[:, :, k].reshape(-1), len(mesh.vertices)) for k in range(3)], 1
    )
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)


@dataclass(frozen=True, eq=False)
class WallField:
    """The field of the wall around a sheet; call it with points, negative inside, mm."""

    sheet: Sheet
    half_mm: float
    side: SheetSide
    keep: KeepOut | None
    _distance: SurfaceDistance = field(init=False, repr=False)
    _normals: Float64[np.ndarray, "V 3"] = field(init=False, repr=False)
    _room: Float64[np.ndarray, " V"] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        vertices = self.sheet.mesh.vertices
        room = self.keep.body.signed(vertices) if self.keep else np.full(len(vertices), np.inf)
        object.__setattr__(self, "_distance", SurfaceDistance(self.sheet.mesh))
        object.__setattr__(self, "_normals", smooth_normals(self.sheet.mesh))
        object.__setattr__(self, "_room", room)

    def __call__(self, points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        distances, faces, places = self._distance.closest(points)
        value, added = distances - self.half_mm, np.zeros(len(points))
        heights = self.side.outer_mm or self.side.inner_mm
        if heights or self.keep is not None:
            corners = self.sheet.mesh.faces[faces]
            weights = _barycentric(self.sheet.mesh.corners[faces], places)
        if heights:
            outer, added = self._extra(points - places, distances, corners, weights)
            value -= outer + added
        if self.side.hole_mm:
            value = _rounded_maximum(value, -self.side.hole_mm(points), HOLE_EDGE_MM)
        if self.keep is not None:
            room = (self._room[corners] * weights).sum(1)
            self._cut(value, points, distances, room, np.minimum(added, self.side.inner_edge_mm))
        return value

    def _extra(
        self, away: np.ndarray, distances: np.ndarray, corners: np.ndarray, weights: np.ndarray
    ) -> list[np.ndarray]:
        """outer(c) max(0, cos)^2 and inner(c) max(0, -cos)^2."""
        normals = np.einsum("nk,nkx->nx", weights, self._normals[corners])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        cosine = (away * normals).sum(1) / np.maximum(distances, 1e-12)
        sides = []
        for height, facing in ((self.side.outer_mm, cosine > 0), (self.side.inner_mm, cosine < 0)):
            extra = np.zeros(len(distances))
            if height is not None and facing.any():
                rest = np.einsum("nk,nkx->nx", weights[facing], self.sheet.rest[corners[facing]])
                extra[facing] = np.maximum(height(rest), 0.0) * cosine[facing] ** 2
            sides.append(extra)
        return sides

    def _cut(
        self,
        value: np.ndarray,
        points: np.ndarray,
        distances: np.ndarray,
        room: np.ndarray,
        radius: np.ndarray,
    ) -> None:
        """f = max(f, clearance - body), rounded over `radius`; worked out only where the body can be that near."""
        assert self.keep is not None
        # body(q) >= body(c) - sag - d, so where the clearance is less than that the maximum is f already.
        wanted = self.keep.clearance_mm(points)
        near = np.flatnonzero(wanted + distances - room + _SAG_MM > value - radius)
        if len(near) == 0:
            return
        body, clearance = self.keep.body.closest(points[near]).distances, wanted[near]
        may_be_inside = np.flatnonzero(room[near] - _SAG_MM < distances[near])
        inside = may_be_inside[self.keep.body.inside(points[near[may_be_inside]])]
        body[inside] *= -1
        value[near] = _rounded_maximum(value[near], clearance - body, radius[near])


def _rounded_maximum(one: np.ndarray, other: np.ndarray, radius: np.ndarray | float) -> np.ndarray:
    """The larger of two fields, its crease rounded over about `radius`."""
    blend = np.maximum(radius - np.abs(one - other), 0.0)
    return np.maximum(one, other) + blend * blend / np.maximum(4.0 * radius, 1e-12)


def _barycentric(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Weights of points that lie on triangles; a third each on a triangle without area."""
    u, v, w = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], points - corners[:, 0]
    uu, uv, vv = (u * u).sum(1), (u * v).sum(1), (v * v).sum(1)
    wu, wv = (w * u).sum(1), (w * v).sum(1)
    area = uu * vv - uv * uv
    flat = area <= 1e-18
    area = np.where(flat, 1.0, area)
    second, third = (vv * wu - uv * wv) / area, (uu * wv - uv * wu) / area
    weights = np.clip(np.stack([1 - second - third, second, third], 1), 0, 1)
    weights[flat] = 1 / 3
    return weights / weights.sum(1, keepdims=True)


def wall_band(
    sheet: Sheet, half_mm: float, side: SheetSide, cell_mm: float
) -> tuple[Grid, Bool[np.ndarray, "X Y Z"]]:
    """The grid around the wall, and the nodes near its surface; `InputError` for heights out of range."""
    points, owners = samples(sheet.mesh.corners, cell_mm)
    sides = [(sign, height) for sign, height in ((1, side.outer_mm), (-1, side.inner_mm)) if height]
    rest = _carried(sheet, points, owners) if sides else points
    normals = sheet.mesh.face_normals[owners]
    heights = [(sign, _heights(height, rest)) for sign, height in sides]
    most = max((float(extra.max(initial=0)) for _, extra in heights), default=0.0)
    grid = Grid.around(sheet.mesh.bounds, cell_mm, half_mm + most + 2 * cell_mm)
    marked = np.zeros(grid.shape, bool)
    band = BAND_CELLS * cell_mm
    grid.near(points, half_mm + band, marked)
    for sign, extra in heights:
        for step in np.arange(0.0, most + cell_mm, cell_mm):
            reached = extra > max(step - cell_mm, 0.1 * cell_mm)
            along = np.minimum(extra[reached], step)[:, None]
            if len(along):
                grid.near(points[reached] + sign * (half_mm + along) * normals[reached], band, marked)
    return grid, marked


def _carried(sheet: Sheet, points: np.ndarray, owners: Int64[np.ndarray, " S"]) -> np.ndarray:
    """Points on the sheet carried back to where the sheet was handed in."""
    corners: Int32[np.ndarray, "S 3"] = sheet.mesh.faces[owners]
    weights = _barycentric(sheet.mesh.corners[owners], points)
    return np.einsum("nk,nkx->nx", weights, sheet.rest[corners])


def _heights(height: PerPoint, rest: np.ndarray) -> np.ndarray:
    extra = height(rest)
    if not (
        np.isfinite(extra).all() and extra.min(initial=0) > -0.05 and extra.max(initial=0) <= MOST_EXTRA_MM
    ):
        raise InputError(
            f"the side of the sheet asks for heights of {extra.min():.2f} to {extra.max():.2f} mm",
            f"Heights must be numbers from 0 to {MOST_EXTRA_MM:g} mm.",
        )
    return np.maximum(extra, 0.0)
