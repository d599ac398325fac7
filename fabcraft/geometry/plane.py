"""`Plane`: an image grid laid in the front view, so that pictures and millimetres speak of the same place.

The front view looks along +y: picture columns grow with +x, picture rows grow with -z. A pixel (column c, row r)
has its centre at (c + 0.5, r + 0.5) in pixel coordinates.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64
from scipy.ndimage import map_coordinates


@dataclass(frozen=True)
class Plane:
    """A grid of `height` x `width` square pixels in the x-z plane, mm."""

    left_mm: float
    """x of the left border of column 0."""
    top_mm: float
    """z of the upper border of row 0."""
    pixel_mm: float
    """Side of a pixel."""
    width: int
    height: int

    def to_pixels(self, xz: Float64[np.ndarray, "N 2"]) -> Float64[np.ndarray, "N 2"]:
        """(x, z) in mm to (column, row) in pixel coordinates."""
        return np.stack([(xz[:, 0] - self.left_mm), (self.top_mm - xz[:, 1])], 1) / self.pixel_mm

    def to_mm(self, pixels: Float64[np.ndarray, "N 2"]) -> Float64[np.ndarray, "N 2"]:
        """(column, row) in pixel coordinates to (x, z) in mm."""
        return np.stack(
            [self.left_mm + pixels[:, 0] * self.pixel_mm, self.top_mm - pixels[:, 1] * self.pixel_mm], 1
        )

    def centres(self) -> tuple[Float64[np.ndarray, "H W"], Float64[np.ndarray, "H W"]]:
        """x and z of every pixel centre, mm."""
        x = self.left_mm + (np.arange(self.width) + 0.5) * self.pixel_mm
        z = self.top_mm - (np.arange(self.height) + 0.5) * self.pixel_mm
        return np.meshgrid(x, z)

    def sample(
        self, image: Float[np.ndarray, "H W"], xz: Float64[np.ndarray, "N 2"], order: int = 1
    ) -> Float64[np.ndarray, " N"]:
        """The image at points (x, z), interpolated (`order` 1: bilinear, 3: cubic); the border value outside."""
        column, row = (self.to_pixels(xz) - 0.5).T
        return map_coordinates(image.astype(np.float64), [row, column], order=order, mode="nearest")

    @staticmethod
    def around(xz: Float64[np.ndarray, "N 2"], pixel_mm: float, margin_mm: float) -> "Plane":
        """The smallest grid of `pixel_mm` that holds the points with `margin_mm` to spare on every side."""
        lower, upper = xz.min(0) - margin_mm, xz.max(0) + margin_mm
        width, height = np.ceil((upper - lower) / pixel_mm).astype(int)
        return Plane(float(lower[0]), float(upper[1]), pixel_mm, int(width), int(height))
