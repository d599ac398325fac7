"""What stands behind and under the object: a light studio backdrop and the soft shadow on an unseen floor."""

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32
from scipy.ndimage import gaussian_filter, map_coordinates

from fabcraft.geometry.raster import rasterize
from fabcraft.write.camera import Camera

_GRID = 240
_COARSE = 4


def backdrop(width: int, height: int) -> Float32[np.ndarray, "H W 3"]:
    """A light studio backdrop in linear light: bright behind the object, a little darker towards the
    borders."""
    y = np.linspace(-1.0, 1.0, height, dtype=np.float32)[:, None]
    x = np.linspace(-1.0, 1.0, width, dtype=np.float32)[None, :]
    glow = np.exp(-(x**2 + (y + 0.1) ** 2) * 0.9)
    level = 0.80 + 0.16 * glow - 0.05 * y
    return (level[..., None] * np.array([0.985, 0.995, 1.01], np.float32)).astype(np.float32)


def lay_floor_shadow(
    light: Float32[np.ndarray, "H W 3"],
    points: Float64[np.ndarray, "V 3"],
    faces: Int32[np.ndarray, "F 3"],
    camera: Camera,
    covered: Bool[np.ndarray, "H W"],
) -> None:
    """Darken `light` in place where it is not `covered`, as if the mesh (mm) stood on a floor at its lowest
    point."""
    lower, upper = points.min(0), points.max(0)
    reach = 0.9 * float(np.linalg.norm(upper - lower))
    middle = (lower + upper)[:2] / 2
    dark = _floor_darkness(points, faces, middle, float(lower[2]), reach)
    # The shadow is soft, so that one ray for every few samples is enough.
    height, width = covered.shape
    rows, columns = np.mgrid[: -(-height // _COARSE), : -(-width // _COARSE)] * _COARSE + _COARSE / 2
    start, direction = camera.rays(columns.ravel(), rows.ravel())
    down = direction[:, 2] < -1e-9
    along = np.where(down, (lower[2] - start[:, 2]) / np.where(down, direction[:, 2], -1.0), 0.0)
    place = (start + along[:, None] * direction)[:, :2]
    at = (place - middle + reach) * _GRID / (2 * reach) - 0.5
    shade = map_coordinates(dark, [at[:, 1], at[:, 0]], order=1, mode="constant") * down
    shade = (
        shade.reshape(rows.shape).astype(np.float32).repeat(_COARSE, 0).repeat(_COARSE, 1)[:height, :width]
    )
    light *= np.where(covered, 1.0, 1.0 - shade).astype(np.float32)[..., None]


def _floor_darkness(
    points: Float64[np.ndarray, "V 3"],
    faces: Int32[np.ndarray, "F 3"],
    middle: Float64[np.ndarray, "2"],
    floor_mm: float,
    reach: float,
) -> Float64[np.ndarray, "G G"]:
    """Shade on a floor of 2 `reach` a side: parts near the floor darken it sharply, parts far above it
    softly."""
    flat = (points[:, :2] - middle + reach) * _GRID / (2 * reach)
    # depth = height, so that the lowest surface over every place of the floor is kept
    height = rasterize(np.column_stack([flat, points[:, 2] - floor_mm]), faces, _GRID, _GRID).depth
    near = np.exp(-height.astype(np.float64) / (0.055 * reach))
    far = np.exp(-height.astype(np.float64) / (0.39 * reach))
    return 0.40 * gaussian_filter(near, 2.5) + 0.30 * gaussian_filter(far, 12.0)
