"""The front of glasses as a maker draws it: lenses in the boxing system, rims round them, a bridge and two end pieces.

Boxing system (ISO 8624): every lens is named by the box round it, A wide and B high; DBL is the distance between the two
boxes.  Places are (u, v) in the front's picture: u to the wearer's left from the middle, v up from the middle of the boxes,
mm.  The front is symmetric; it is drawn for u >= 0.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from fabcraft.errors import InputError
from fabcraft.geometry.contour import counter_clockwise, inside, level_contours, smooth
from fabcraft.geometry.implicit import smooth_common, smooth_union

Outline = Float64[np.ndarray, "_ 2"]

SHAPES: Mapping[str, tuple[tuple[float, float], ...]] = {
    "panto": (
        (0.98, 0.30),
        (0.80, 0.82),
        (0.10, 1.00),
        (-0.70, 0.88),
        (-0.99, 0.38),
        (-0.88, -0.28),
        (-0.50, -0.84),
        (0.05, -1.00),
        (0.62, -0.78),
        (0.92, -0.25),
    ),
    "round": tuple((np.cos(a), np.sin(a)) for a in 2.0 * np.pi * np.arange(12) / 12),
    "square": (
        (1.00, 0.20),
        (0.93, 0.84),
        (0.30, 1.00),
        (-0.40, 0.98),
        (-0.93, 0.80),
        (-1.00, 0.20),
        (-0.90, -0.62),
        (-0.42, -0.98),
        (0.30, -1.00),
        (0.88, -0.72),
    ),
    "cat-eye": (
        (0.96, 0.28),
        (1.00, 0.92),
        (0.30, 0.92),
        (-0.50, 0.78),
        (-0.97, 0.34),
        (-0.86, -0.34),
        (-0.40, -0.90),
        (0.15, -1.00),
        (0.64, -0.66),
        (0.88, -0.18),
    ),
}
"""Points of the wearer's left lens in its box, the temple at +1, the nose at -1, counter-clockwise."""
_BROWED = 0.3
"""How much wider the rim is over the eye than under it, as a share."""
_PIXEL = 0.1
"""Of the grid that a front is drawn on, as a share of the rim."""


@dataclass(frozen=True)
class FrontSizes:
    """A front's lengths, mm."""

    lens_width: float
    """A."""
    lens_height: float
    """B."""
    bridge: float
    """DBL."""
    rim: float
    half_width: float
    """From the middle to the outer end of the end piece."""
    end_piece: float
    """Height of the end piece."""

    @property
    def lens_middle(self) -> float:
        """u of the middle of the box."""
        return 0.5 * (self.lens_width + self.bridge)

    @property
    def hinge_height(self) -> float:
        """v of the middle of the end piece."""
        return 0.30 * self.lens_height


def lens_outline(shape: str, sizes: FrontSizes) -> Outline:
    """The wearer's left lens, a smooth curve that fills its box.  Raises `InputError` for an unknown shape."""
    if shape not in SHAPES:
        raise InputError(f"there is no lens shape '{shape}'", f"Choose {', '.join(SHAPES)}.")
    points = np.array([*SHAPES[shape], SHAPES[shape][0]])
    knots = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1) ** 0.5)])
    curve = CubicSpline(knots, points, bc_type="periodic")(np.linspace(0.0, knots[-1], 720, endpoint=False))
    low, high = curve.min(0), curve.max(0)
    unit = 2.0 * (curve - low) / (high - low) - 1.0
    return unit * [0.5 * sizes.lens_width, 0.5 * sizes.lens_height] + [sizes.lens_middle, 0.0]


@dataclass(frozen=True, eq=False)
class Blank:
    """A front before it is cut out for the nose: distance to its border on a grid, about, negative on the front."""

    rim: float
    pixel: float
    u: Float64[np.ndarray, "H W"]
    """Of the pixels of the left half, from the middle line on."""
    v: Float64[np.ndarray, "H W"]
    field: Float64[np.ndarray, "H W"]

    def outline(self, nose: Float64[np.ndarray, "M 2"]) -> Outline:
        """The outer border of the front's left half, from (0, v) below the bridge round to (0, v) above it.

        nose : rows (v, u) of how wide the nose is where it passes through the front, with its clearance, v rising.
        """
        half = self.field
        if len(nose):
            width = np.interp(self.v, nose[:, 0], nose[:, 1], right=-1e3)
            cut = smooth_common(half.ravel(), (width - self.u).ravel(), 0.5 * self.rim)
            half = cut.reshape(half.shape)
        contour = level_contours(-np.concatenate([half[:, ::-1], half], axis=1), 0.0)[0]
        around = np.stack(
            [(contour[:, 0] - half.shape[1]) * self.pixel, self.v[0, 0] + (0.5 - contour[:, 1]) * self.pixel],
            1,
        )
        return _right_half(smooth(counter_clockwise(around), 0.28 * self.rim))


def blank(lens: Outline, sizes: FrontSizes) -> Blank:
    """The front round the wearer's left lens and its mirror image."""
    pixel = _PIXEL * sizes.rim
    top = 0.5 * sizes.lens_height + 3.0 * sizes.rim
    columns = int(np.ceil((sizes.half_width + 2.0 * sizes.rim) / pixel))
    rows = int(np.ceil(2.0 * top / pixel))
    # the whole grid is symmetric, with the middle line between two columns
    u, v = np.meshgrid((np.arange(columns) + 0.5) * pixel, top - (np.arange(rows) + 0.5) * pixel)
    field = _field(np.stack([u.ravel(), v.ravel()], 1), lens, sizes).reshape(u.shape)
    return Blank(sizes.rim, pixel, u, v, field)


def _field(points: Float64[np.ndarray, "N 2"], lens: Outline, sizes: FrontSizes) -> Float64[np.ndarray, " N"]:
    """Distance of places (u, v) to the border of the front, about, negative on it."""
    rim, height = sizes.rim, sizes.lens_height
    u, v = points.T
    away = cKDTree(lens).query(points)[0]
    away = np.where(inside(points, [lens]), -away, away)
    # stronger over the eye than under it, as acetate frames are
    material = away - rim * (1.0 + _BROWED * np.clip(0.5 + v / height, 0.0, 1.0))
    thick = 0.55 * rim + 0.03 * height
    across = np.maximum(u - (0.5 * sizes.bridge + 0.3 * rim), 0.0)
    saddle = 0.24 * height + 0.02 * sizes.bridge - (u / (0.5 * sizes.bridge + rim)) ** 2 * 0.05 * height
    bridge = np.hypot(across, v - saddle) - thick
    material = smooth_union(material, bridge, 1.6 * rim)
    # the end piece: a lug that flows out of the upper rim and becomes narrower towards the hinge
    start = np.array([sizes.lens_middle + 0.30 * sizes.lens_width, 0.36 * height])
    end = np.array([sizes.half_width - 0.5 * sizes.end_piece, sizes.hinge_height])
    along = np.clip(((points - start) @ (end - start)) / ((end - start) @ (end - start)), 0.0, 1.0)
    radius = sizes.end_piece * (0.62 - 0.12 * along)
    lug = np.linalg.norm(points - start - along[:, None] * (end - start), axis=1) - radius
    material = smooth_union(material, lug, 1.6 * rim)
    return np.maximum(material, -away)  # nothing of that before the lens


def _right_half(contour: Outline) -> Outline:
    """The part at u >= 0, ending on u = 0 exactly, from below to above."""
    u = contour[:, 0]
    count = len(contour)
    rising = np.flatnonzero((u < 0.0) & (np.roll(u, -1) >= 0.0))
    start = int(rising[0])
    order = (start + np.arange(count + 1)) % count
    turned = contour[order]
    stop = int(np.flatnonzero((turned[1:-1, 0] >= 0.0) & (turned[2:, 0] < 0.0))[0]) + 1
    inner = turned[1 : stop + 1]
    inner = inner[inner[:, 0] > 0.05 * np.abs(np.diff(contour[:2], axis=0)).max()]
    ends = [np.array([[0.0, side[1]]]) for side in (inner[0], inner[-1])]
    return np.concatenate([ends[0], inner, ends[1]])
