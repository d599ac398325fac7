"""From a placed drawing to a relief: the outer shape of the mask, with the strokes as detail.

Volume: like an inflated cushion (Igarashi's Teddy, by a membrane instead of a medial axis). u solves
(−Δ + κ s) u = 1 inside the outline, u = 0 on it, with s the drawn strokes; the swell is  k (√(2u + ε²) − ε), a circular
arch of relative height k across a strip, soft at the rim by ε. Strokes are soft valleys of it, so that what they part
(cheeks, muzzle, brows) stands out. Detail: strokes and region borders as rounded beads of the printer's detail or more,
filled regions as low cushions, a bead around the openings and along the rim.

Lengths are a person's.  On a character they go with the size of its head; beads and cushions shrink to half at most, or
they could not be printed.
"""

from dataclasses import dataclass, field

import cv2
import numpy as np
import scipy.sparse as sparse
from jaxtyping import Bool, Float64
from scipy.ndimage import distance_transform_edt, gaussian_filter
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from fabcraft.errors import InputError
from fabcraft.geometry.contour import counter_clockwise, resample_open, signed_area, signed_distance_image
from fabcraft.geometry.plane import Plane
from fabcraft.guidance.placement import PlacedDrawing
from fabcraft.mesh import Mesh
from fabcraft.template.template import Template

_LEAST_DETAIL = 0.5
"""Smallest scale of beads and cushions."""
_EXACT_MM = 4.5  # beyond the widest bead, the raster's own distance is good enough


INFLATE_RANGES = {
    "swell": (0.0, 1.0),
    "swell_limit_mm": (0.5, 40.0),
    "stroke_height_mm": (0.0, 6.0),
    "stroke_width_mm": (0.4, 8.0),
    "region_height_mm": (0.0, 8.0),
    "rim_height_mm": (0.0, 4.0),
    "shade_height_mm": (0.0, 5.0),
}
"""What a wall can carry and a mask can look like."""


@dataclass(frozen=True)
class InflateSettings:
    """How a flat drawing becomes a relief."""

    swell: float = 0.26
    """Height of the cushion over its half width (0 is flat)."""
    swell_limit_mm: float = 11.0
    """The cushion stays lower than this."""
    stroke_height_mm: float = 1.2
    """Height of the beads that strokes become."""
    stroke_width_mm: float = 1.8
    """Least width of a bead."""
    region_height_mm: float = 2.2
    """Height of the cushion that a drawn region (a nose) becomes."""
    rim_height_mm: float = 0.8
    """Height of the bead along the outline and around the openings; 0 for none."""
    shade_height_mm: float = 1.6
    """How far the light parts of a photograph stand out, and its dark parts lie back; 0 ignores its shading."""

    def __post_init__(self) -> None:
        for name, (low, high) in INFLATE_RANGES.items():
            if not low <= getattr(self, name) <= high:
                raise InputError(
                    f"{name} = {getattr(self, name)} was asked for the relief",
                    f"Choose between {low:g} and {high:g}.",
                )


@dataclass(frozen=True, eq=False)
class Relief:
    """What the outside of the object should look like in the front view, mm."""

    outline: Float64[np.ndarray, "N 2"]
    """Counter-clockwise (x, z)."""
    openings: tuple[Float64[np.ndarray, "_ 2"], ...]
    plane: Plane
    """1 mm grid of `height`."""
    height: Float64[np.ndarray, "H W"]
    """Wanted height (-y) of the sheet, defined beyond the outline too."""
    fine: Plane
    """0.25 mm grid of `detail`."""
    detail: Float64[np.ndarray, "h w"]
    """Material to add on the outer side, >= 0."""
    _room: Float64[np.ndarray, "H W"] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        solid = solid_mask(self.outline, self.openings, self.plane)
        object.__setattr__(self, "_room", signed_distance_image(solid, self.plane.pixel_mm))

    def height_at(self, xz: Float64[np.ndarray, "N 2"]) -> Float64[np.ndarray, " N"]:
        """Wanted height of the sheet at (x, z), cubic."""
        return self.plane.sample(self.height, xz, order=3)

    def detail_at(self, xz: Float64[np.ndarray, "N 2"]) -> Float64[np.ndarray, " N"]:
        """Extra outer material at (x, z), bilinear."""
        return self.fine.sample(self.detail, xz)

    def room_at(self, xz: Float64[np.ndarray, "N 2"]) -> Float64[np.ndarray, " N"]:
        """Distance to the outline or the nearest opening, mm; negative outside the object."""
        return self.plane.sample(self._room, xz)

    def mesh(self, edge_mm: float = 2.0) -> Mesh:
        """The relief as an open surface facing the viewer (the guidance mesh of the paper's image route)."""
        from fabcraft.geometry.triangulate import triangulate

        flat = triangulate([self.outline, *self.openings], edge_mm)
        height = self.height_at(flat.points) + self.detail_at(flat.points)
        return Mesh(np.column_stack([flat.points[:, 0], -height, flat.points[:, 1]]), flat.faces, "relief")


def inflate(placed: PlacedDrawing, template: Template, settings: InflateSettings | None = None) -> Relief:
    """The relief of a placed drawing in front of the template's surface."""
    settings = settings or InflateSettings()
    strokes = _visible(placed, template)
    swell, plane = _swell(placed, strokes, settings, template.scale)
    x, z = plane.centres()
    xz = np.column_stack([x.ravel(), z.ravel()])
    base = template.front.base_at(xz).reshape(x.shape)
    # where the object rests the cushion stays low, so that little is needed to fill the gap to the skin
    rest = gaussian_filter(template.front.contact, 14.0 * template.scale / template.front.plane.pixel_mm)
    swell = swell * (1.0 - 0.8 * np.clip(2.0 * template.front.at(rest, xz), 0.0, 1.0).reshape(x.shape))
    height = base + swell + _hollows(placed, template, plane)
    if placed.shading is not None:
        shade = placed.shading.plane.sample(placed.shading.value, xz).reshape(x.shape)
        height += settings.shade_height_mm * template.scale * gaussian_filter(shade, 1.0)
    floor = template.front.at(np.where(np.isfinite(template.front.floor), template.front.floor, -1e3), xz)
    height = np.maximum(height, floor.reshape(x.shape))
    detail, fine = _detail(placed, strokes, template, settings)
    return Relief(placed.outline, placed.openings, plane, height, fine, detail)


def plain_relief(template: Template) -> Relief:
    """The relief of the template itself: its own outline and height, nothing added."""
    plane = Plane.around(template.outline, template.front.plane.pixel_mm, 10.0 * template.scale)
    x, z = plane.centres()
    height = template.front.base_at(np.column_stack([x.ravel(), z.ravel()])).reshape(x.shape)
    return Relief(template.outline, template.openings, plane, height, plane, np.zeros_like(height))


def _visible(placed: PlacedDrawing, template: Template) -> list[np.ndarray]:
    """Strokes, cut where they run into an opening or off the rim; leftovers under 4 mm (of a person's) are dropped."""
    plane = Plane.around(placed.outline, 0.5 * template.scale, 5.0 * template.scale)
    solid = solid_mask(placed.outline, placed.openings, plane)
    room = signed_distance_image(solid, plane.pixel_mm)
    pieces = []
    for stroke in placed.strokes:
        keep = plane.sample(room, stroke) > 0.5 * template.wall_mm
        edges = np.flatnonzero(np.diff(np.concatenate([[0], keep.astype(int), [0]])))
        for start, stop in zip(edges[::2], edges[1::2], strict=True):
            piece = stroke[start:stop]
            if (
                len(piece) > 1
                and np.linalg.norm(np.diff(piece, axis=0), axis=1).sum() >= 4.0 * template.scale
            ):
                pieces.append(piece)
    return pieces


def solid_mask(
    outline: Float64[np.ndarray, "N 2"], openings: tuple[Float64[np.ndarray, "_ 2"], ...], plane: Plane
) -> Bool[np.ndarray, "H W"]:
    """The pixels whose centre the finished object should cover: inside the outline, outside the openings."""
    mask = np.zeros((plane.height, plane.width), dtype=np.uint8)
    _fill(mask, plane, outline, 1)
    for opening in openings:
        _fill(mask, plane, opening, 0)
    return mask.astype(bool)


def _fill(mask: np.ndarray, plane: Plane, contour: np.ndarray, value: int) -> None:
    # cv2 counts from pixel centres, in sixteenths of a pixel here
    points = np.round((plane.to_pixels(contour) - 0.5) * 16.0).astype(np.int32)
    cv2.fillPoly(mask, [points.reshape(-1, 1, 2)], value, lineType=cv2.LINE_8, shift=4)


def _distance_to_lines(lines: list[np.ndarray], plane: Plane, closed: bool) -> np.ndarray:
    """Distance of every pixel centre to the nearest polyline, mm; large where there is none."""
    if not lines:
        return np.full((plane.height, plane.width), 1e3)
    drawn = np.ones((plane.height, plane.width), dtype=np.uint8)
    for line in lines:
        points = np.round((plane.to_pixels(line) - 0.5) * 16.0).astype(np.int32)
        cv2.polylines(drawn, [points.reshape(-1, 1, 2)], closed, 0, 1, cv2.LINE_8, shift=4)
    distance = distance_transform_edt(drawn) * plane.pixel_mm
    # a raster line has steps that a print would show: near the lines the distance is that to the points of the curve
    rows, columns = np.nonzero(distance < _EXACT_MM)
    dense = np.concatenate(
        [resample_open(np.vstack([line, line[:1]]) if closed else line, 0.08) for line in lines]
    )
    near = plane.to_mm(np.column_stack([columns + 0.5, rows + 0.5]))
    distance[rows, columns], _ = cKDTree(dense).query(near)
    return distance


def _swell(
    placed: PlacedDrawing, strokes: list[np.ndarray], settings: InflateSettings, scale: float
) -> tuple[np.ndarray, Plane]:
    """The cushion, mm, on a grid of 1 mm (solved at 2 mm) times `scale`."""
    plane = Plane.around(placed.outline, scale, 12.0 * scale)
    plane = Plane(
        plane.left_mm, plane.top_mm, scale, plane.width + plane.width % 2, plane.height + plane.height % 2
    )
    coarse = Plane(plane.left_mm, plane.top_mm, 2.0 * scale, plane.width // 2, plane.height // 2)
    domain = solid_mask(placed.outline, (), coarse)
    lines = np.exp(-((_distance_to_lines(strokes, coarse, False) / (2.0 * scale)) ** 2))
    sockets = np.exp(-((_distance_to_lines(list(placed.openings), coarse, True) / (4.0 * scale)) ** 2))
    borders = np.exp(-((_distance_to_lines(list(placed.regions), coarse, True) / (2.0 * scale)) ** 2))
    damping = np.clip(lines + borders, 0, 1) / (14.0 * scale) ** 2 + sockets / (12.0 * scale) ** 2
    u = _membrane(domain, damping, coarse.pixel_mm)
    soft, limit = 7.0 * scale, settings.swell_limit_mm * scale
    swell = settings.swell * (np.sqrt(2.0 * u + soft**2) - soft)
    swell = limit * np.tanh(swell / limit)
    x, z = plane.centres()
    fine = coarse.sample(gaussian_filter(swell, 1.0), np.column_stack([x.ravel(), z.ravel()]), order=3)
    return np.maximum(fine.reshape(x.shape), 0.0), plane


def _membrane(domain: np.ndarray, damping: np.ndarray, pixel_mm: float) -> np.ndarray:
    """u of (−Δ + damping) u = 1 in the domain, 0 outside it, mm²."""
    index = np.full(domain.shape, -1)
    index[domain] = np.arange(domain.sum())
    rows, columns = [], []
    for axis, shift in ((0, 1), (1, 1)):
        first = index[:-shift, :] if axis == 0 else index[:, :-shift]
        second = index[shift:, :] if axis == 0 else index[:, shift:]
        both = (first >= 0) & (second >= 0)
        rows.append(first[both])
        columns.append(second[both])
    i, j = np.concatenate(rows), np.concatenate(columns)
    count = int(domain.sum())
    neighbours = sparse.coo_matrix((np.ones(len(i)), (i, j)), shape=(count, count))
    matrix = (4.0 * sparse.identity(count) - neighbours - neighbours.T) / pixel_mm**2
    matrix = (matrix + sparse.diags(damping[domain])).tocsc()
    u = np.zeros(domain.shape)
    u[domain] = splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve(
        np.ones(count)
    )
    return u


def _hollows(placed: PlacedDrawing, template: Template, plane: Plane) -> np.ndarray:
    """Regions above the face (inner ears) are shallow hollows of the sheet itself, mm (<= 0)."""
    hollow, scale = np.zeros((plane.height, plane.width)), template.scale
    for region in placed.regions:
        if not _is_ear(region, template):
            continue
        inside = np.zeros((plane.height, plane.width), dtype=np.uint8)
        _fill(inside, plane, region, 1)
        depth = signed_distance_image(inside.astype(bool), plane.pixel_mm)
        hollow -= 3.0 * scale * np.clip((depth + scale) / (8.0 * scale), 0.0, 1.0) ** 1.5
    return gaussian_filter(hollow, 1.5)


def _is_ear(region: np.ndarray, template: Template) -> bool:
    high = region[:, 1].mean() > template.outline[:, 1].max() - 5.0 * template.scale
    return bool(high and abs(signed_area(region)) > 150.0 * template.scale**2)


def _detail(
    placed: PlacedDrawing, strokes: list[np.ndarray], template: Template, settings: InflateSettings
) -> tuple[np.ndarray, Plane]:
    """Beads and cushions, mm, on a grid of 0.25 mm times their scale."""
    scale = max(template.scale, _LEAST_DETAIL)
    fine = Plane.around(placed.outline, 0.25 * scale, 3.0 * scale)
    half = 0.5 * max(settings.stroke_width_mm * scale, min(placed.stroke_width_mm, 3.2 * scale))
    high = settings.stroke_height_mm * scale
    detail = high * _bead(_distance_to_lines(strokes, fine, False), half)
    for region in placed.regions:
        border = high * _bead(_distance_to_lines([region], fine, True), half)
        detail = np.maximum(detail, border)
        if not _is_ear(region, template):
            inside = np.zeros((fine.height, fine.width), dtype=np.uint8)
            _fill(inside, fine, counter_clockwise(region), 1)
            depth = np.maximum(signed_distance_image(inside.astype(bool), fine.pixel_mm), 0.0)
            reach = min(4.0 * scale, max(float(depth.max()), 0.5 * scale))
            arch = np.sqrt(np.clip(1.0 - (1.0 - np.minimum(depth / reach, 1.0)) ** 2, 0.0, 1.0))
            height = settings.region_height_mm * scale * min(1.0, reach / (3.0 * scale))
            detail = np.maximum(detail, height * arch)
    if settings.rim_height_mm > 0.0:
        # the sheet ends half a wall inside the outline: the bead stands on its last 3 mm
        centre = 0.5 * template.wall_mm + 1.2 * scale
        for contour in (placed.outline, *placed.openings):
            away = np.abs(_distance_to_lines([contour], fine, True) - centre)
            detail = np.maximum(detail, settings.rim_height_mm * scale * _bead(away, 1.8 * scale))
    return gaussian_filter(detail, 0.2 * scale / fine.pixel_mm), fine


def _bead(distance: np.ndarray, half_width: float) -> np.ndarray:
    """A rounded ridge of height 1: a parabola with a soft foot."""
    share = np.clip(distance / half_width, 0.0, 1.0)
    return (1.0 - share**2) ** 1.5
