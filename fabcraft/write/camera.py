"""Where a picture is taken from.

Azimuth 0 looks along +y at the wearer's face, 90 stands on the wearer's left (+x), 180 behind; elevation 90
looks straight down. In the camera's frame x is right, y up and z towards the camera; picture rows grow
downwards.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from jaxtyping import Float64

from fabcraft.mesh import Mesh


@dataclass(frozen=True)
class View:
    """A direction to look from, and how."""

    azimuth_deg: float
    """0 front, 90 from the wearer's left, 180 back."""
    elevation_deg: float = 0.0
    """90 from above."""
    field_of_view_deg: float = 14.0
    """Angle of view over the scene: small is calm and close to a drawing; 0 is orthographic."""
    margin: float = field(default=0.06)
    """Empty border, share of the picture."""

    @property
    def axes(self) -> Float64[np.ndarray, "3 3"]:
        """Rows: right, up, towards the camera, in the world."""
        azimuth, elevation = np.radians([self.azimuth_deg, self.elevation_deg])
        right = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        towards = np.array(
            [
                np.sin(azimuth) * np.cos(elevation),
                -np.cos(azimuth) * np.cos(elevation),
                np.sin(elevation),
            ]
        )
        return np.stack([right, np.cross(towards, right), towards])


def views_towards(outward: Float64[np.ndarray, "3"]) -> Mapping[str, View]:
    """The views that every report shows, turned so that the front one looks at what faces `outward`."""
    x, y, z = outward / np.linalg.norm(outward)
    azimuth = float(np.degrees(np.arctan2(x, -y))) if np.hypot(x, y) > 1e-6 else 0.0
    elevation = float(np.degrees(np.arcsin(np.clip(z, -1.0, 1.0))))
    lifted = float(np.clip(elevation + 12.0, -80.0, 80.0))
    return {
        "front": View(azimuth, elevation),
        "three_quarter": View(azimuth + 35.0, lifted),
        "side": View(azimuth + 90.0),
        "back": View(azimuth + 180.0, -elevation),
        "top": View(azimuth, min(elevation + 90.0, 90.0)),
    }


VIEWS: Mapping[str, View] = MappingProxyType(
    {
        "front": View(0.0),
        "three_quarter": View(35.0, 12.0),
        "side": View(90.0),
        "back": View(180.0),
        "top": View(0.0, 90.0),
    }
)
"""The views that every report shows."""


@dataclass(frozen=True)
class Camera:
    """A view of a scene at a picture size: turns millimetres into pixels and back."""

    axes: Float64[np.ndarray, "3 3"]
    """Rows: right, up, towards the camera, in the world."""
    centre: Float64[np.ndarray, "3"]
    """Middle of the scene, mm."""
    distance_mm: float
    """From the centre to the eye; infinite when orthographic."""
    scale: float
    """Pixels per millimetre at the centre's depth."""
    shift: Float64[np.ndarray, "2"]
    """What stands in the middle of the picture: right, up at the centre's depth, mm."""
    width: int
    height: int

    def project(self, points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, "N 3"]:
        """Column, row and depth key (smaller is nearer, linear over the image) of points, mm."""
        local = (points - self.centre) @ self.axes.T
        if np.isinf(self.distance_mm):
            shrink, key = np.ones(len(points)), -local[:, 2]
        else:
            away = self.distance_mm - local[:, 2]
            shrink, key = self.distance_mm / away, -1.0 / away
        column = self.width / 2 + (local[:, 0] * shrink - self.shift[0]) * self.scale
        row = self.height / 2 - (local[:, 1] * shrink - self.shift[1]) * self.scale
        return np.stack([column, row, key], axis=1)

    def rays(
        self, columns: Float64[np.ndarray, " N"], rows: Float64[np.ndarray, " N"]
    ) -> tuple[Float64[np.ndarray, "N 3"], Float64[np.ndarray, "N 3"]]:
        """World origin and direction (away from the camera, not unit) of the rays through pixel
        coordinates."""
        x = (columns - self.width / 2) / self.scale + self.shift[0]
        y = (self.height / 2 - rows) / self.scale + self.shift[1]
        plane = np.stack([x, y, np.zeros(len(x))], axis=1)
        if np.isinf(self.distance_mm):
            start, direction = plane, np.broadcast_to([0.0, 0.0, -1.0], plane.shape)
        else:
            eye = np.array([0.0, 0.0, self.distance_mm])
            start, direction = np.broadcast_to(eye, plane.shape), plane - eye
        return start @ self.axes + self.centre, direction @ self.axes


def camera_for(
    view: View,
    scene: Float64[np.ndarray, "N 3"],
    size: tuple[int, int],
    frame_on: Mesh | None = None,
) -> Camera:
    """The camera of `view` whose picture of `size` (width, height) is filled by `frame_on`, or by the whole
    `scene`.

    scene : (N, 3) all points that may be drawn, mm; they decide how far the eye stands back.
    """
    lower, upper = scene.min(0), scene.max(0)
    centre = (lower + upper) / 2
    radius = max(float(np.linalg.norm(upper - lower)) / 2, 1e-6)
    half_angle = np.radians(view.field_of_view_deg) / 2
    distance = radius / np.sin(half_angle) if half_angle > 1e-4 else np.inf
    local = ((scene if frame_on is None else frame_on.vertices) - centre) @ view.axes.T
    shrink = 1.0 if np.isinf(distance) else distance / (distance - local[:, 2:])
    flat = local[:, :2] * shrink
    low, high = flat.min(0), flat.max(0)
    room = np.array(size, dtype=np.float64) * (1.0 - 2.0 * view.margin)
    scale = float((room / np.maximum(high - low, 1e-3 * radius)).min())
    return Camera(view.axes, centre, float(distance), scale, (low + high) / 2, *size)
