"""`Camera`: where a picture is taken from, as a floating-point projection that torch can differentiate.

View space: x to the right of the picture, y downwards, z away from the camera (right-handed, so nothing is
mirrored). With f the `focal` length in halves of the picture's height,

    column = width / 2 + f (height / 2) x / d,    row = height / 2 + f (height / 2) y / d,    depth = z,

where d = z in a perspective view and d = 1 in an orthographic one. A perspective focal length is
f = 1 / tan(fov / 2): 3.73, 1.73 and 1 for 30, 60 and 90 degrees, never rounded. Azimuth 0 looks along +y, at
a face from the front; azimuth 90 stands at +x, the wearer's left.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float64
from torch import Tensor

from fabcraft.errors import InputError
from fabcraft.geometry.plane import Plane

NEAR = 1e-6
"""mm; what is nearer to a perspective camera, or behind it, is divided by this instead of its depth."""


@dataclass(frozen=True, eq=False)
class Camera:
    """One view.

    view : (4, 4) float64, world to view space (a rotation and a translation), made read-only.
    focal : focal length in halves of the picture's height; for an orthographic view, in 1 / mm.
    orthographic : parallel rays instead of rays through one point.
    width, height : size of the picture, px.
    """

    view: Float64[np.ndarray, "4 4"]
    focal: float
    orthographic: bool
    width: int
    height: int

    def __post_init__(self) -> None:
        view = np.array(self.view, dtype=np.float64)
        if not np.isfinite(view).all() or np.linalg.det(view[:3, :3]) <= 0:
            raise InputError(
                "a camera's view matrix has no finite, unmirrored rotation",
                "Give a world-to-view matrix whose upper left 3 x 3 block is a rotation.",
            )
        view.setflags(write=False)
        object.__setattr__(self, "view", view)

    def project(self, vertices: Float[Tensor, "V 3"]) -> Float[Tensor, "V 3"]:
        """(V, 3) world points, mm, to (V, 3) column and row in pixel coordinates and depth, mm."""
        return stack([self]).project(vertices)[0]


@dataclass(frozen=True, eq=False)
class Cameras:
    """K views of one picture size, projected together.

    views : (K, 4, 4) float64, world to view space.
    focals : (K,) float64.
    orthographic : one flag for all views.
    width, height : size of the pictures, px.
    """

    views: Float64[np.ndarray, "K 4 4"]
    focals: Float64[np.ndarray, " K"]
    orthographic: bool
    width: int
    height: int

    def project(self, vertices: Float[Tensor, "V 3"]) -> Float[Tensor, "K V 3"]:
        """(V, 3) world points, mm, to (K, V, 3) column and row in pixel coordinates and depth, mm."""
        matrix = self.views[:, :3].copy()
        matrix[:, :2] *= 0.5 * self.height * self.focals[:, None, None]
        rows = torch.tensor(matrix, dtype=vertices.dtype, device=vertices.device)
        centre = vertices.new_tensor([[0.5 * self.width], [0.5 * self.height]])
        seen = (rows[:, :, :3].reshape(-1, 3) @ vertices.T).reshape(-1, 3, len(vertices)) + rows[:, :, 3:]
        flat, depth = seen[:, :2], seen[:, 2:]
        if not self.orthographic:
            flat = flat / depth.clamp(min=NEAR)
        return torch.cat([flat + centre, depth], 1).transpose(1, 2)


def stack(cameras: Sequence[Camera]) -> Cameras:
    """The `cameras` as one value.

    Raises `InputError` when there is none, or they differ in picture size or in the kind of projection.
    """
    kinds = {(camera.orthographic, camera.width, camera.height) for camera in cameras}
    if len(kinds) != 1:
        raise InputError(
            f"{len(cameras)} cameras of {len(kinds)} picture sizes or projections cannot be drawn together",
            "Give at least one camera, all with the same size and projection.",
        )
    orthographic, width, height = kinds.pop()
    views = np.stack([camera.view for camera in cameras])
    focals = np.array([camera.focal for camera in cameras], dtype=np.float64)
    return Cameras(views, focals, orthographic, width, height)


def front(plane: Plane) -> Camera:
    """The orthographic camera that looks along +y and whose picture is `plane`; the depth is y, mm."""
    view = np.eye(4)
    view[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    view[0, 3] = -(plane.left_mm + 0.5 * plane.width * plane.pixel_mm)
    view[1, 3] = plane.top_mm - 0.5 * plane.height * plane.pixel_mm
    return Camera(view, 2.0 / (plane.height * plane.pixel_mm), True, plane.width, plane.height)


def orbit(
    centre: Sequence[float] | Float[np.ndarray, "3"],
    radius_mm: float,
    azimuth_deg: float,
    elevation_deg: float,
    fov_deg: float = 60.0,
    resolution: int = 224,
) -> Camera:
    """A perspective camera at `radius_mm` from `centre`, looking at it, z up in a square picture.

    azimuth_deg : 0 looks along +y (at a face from the front), 90 along -x (at its left side).
    elevation_deg : how far above the horizon the camera stands, within -90..90.
    fov_deg : the opening angle of the picture, in (0, 180).

    Raises `InputError` for a radius or an angle out of range.
    """
    if not (radius_mm > 0 and 0 < fov_deg < 180 and abs(elevation_deg) <= 90):
        raise InputError(
            f"no camera at {radius_mm} mm, elevation {elevation_deg} and field of view {fov_deg} degrees",
            "Give a radius above 0, an elevation within -90..90 and a field of view in 0..180 degrees.",
        )
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    right = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    flat = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    forward = np.cos(elevation) * flat - np.sin(elevation) * np.array([0.0, 0.0, 1.0])
    view = np.eye(4)
    view[:3, :3] = [right, np.cross(forward, right), forward]
    position = np.asarray(centre, dtype=np.float64) - radius_mm * forward
    view[:3, 3] = -view[:3, :3] @ position
    return Camera(view, float(1.0 / np.tan(np.radians(fov_deg) / 2)), False, resolution, resolution)


def bank(
    count: int,
    centre: Sequence[float] | Float[np.ndarray, "3"],
    radius_mm: float,
    *,
    fov_deg: float = 45.0,
    resolution: int = 224,
    seed: int = 0,
) -> tuple[Camera, ...]:
    """`count` fixed cameras around a bounding sphere of `radius_mm`; the same seed gives the same cameras.

    Azimuths: even shares of the circle, each with a random turn within its share. Elevations: 60 Beta(1, 5)
    degrees, and for every fifth camera uniform in -20..0. Distances: 1.2..1.6 times the one at which the
    bounding sphere just fits the picture.
    """
    random = np.random.default_rng(seed)
    share = 360.0 / max(count, 1)
    azimuths = share * (np.arange(count) + random.uniform(-0.5, 0.5, count))
    above = 60.0 * random.beta(1, 5, count)
    below = random.uniform(-20.0, 0.0, count)
    elevations = np.where(np.arange(count) % 5 == 4, below, above)
    fitting = radius_mm / np.sin(np.radians(fov_deg) / 2)
    radii = fitting * random.uniform(1.2, 1.6, count)
    return tuple(
        orbit(centre, float(r), float(a), float(e), fov_deg, resolution)
        for r, a, e in zip(radii, azimuths, elevations, strict=True)
    )
