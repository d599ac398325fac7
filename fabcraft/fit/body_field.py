"""The signed distance to a body on a grid, for the loop: fast and differentiable; exact values are asked at the end.

Cubic cells over the region of the product only. Trilinear; s > 0 outside. Outside the grid the border value is returned
with zero gradient, so the grid has to hold everything the object may reach.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float64
from torch import Tensor

from fabcraft.geometry.distance import SurfaceDistance


@dataclass(frozen=True, eq=False)
class BodyField:
    """Signed distances, mm, at the nodes of a grid; build it with `BodyField.around`."""

    values: Float[Tensor, "1 1 Z Y X"]
    lower: Float64[np.ndarray, "3"]
    cell_mm: float

    @staticmethod
    def around(
        distance: SurfaceDistance,
        lower: Float64[np.ndarray, "3"],
        upper: Float64[np.ndarray, "3"],
        cell_mm: float,
    ) -> "BodyField":
        """Sample the exact distance on the nodes of the box from `lower` to at least `upper`."""
        counts = np.ceil((upper - lower) / cell_mm).astype(int) + 1
        axes = [lower[axis] + cell_mm * np.arange(counts[axis]) for axis in range(3)]
        z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
        signed = distance.signed(np.column_stack([x.ravel(), y.ravel(), z.ravel()]))
        values = torch.from_numpy(signed.reshape(1, 1, *x.shape)).float()
        return BodyField(values, np.array(lower, dtype=np.float64), cell_mm)

    def __call__(self, points: Float[Tensor, "N 3"]) -> Float[Tensor, " N"]:
        """Signed distance at points in mm, trilinear, differentiable."""
        sizes = torch.tensor(self.values.shape[:1:-1], dtype=points.dtype)  # x, y, z node counts
        node = (points - torch.from_numpy(self.lower).to(points.dtype)) / self.cell_mm
        where = 2.0 * node / (sizes - 1.0) - 1.0
        sampled = torch.nn.functional.grid_sample(
            self.values.to(points.dtype),
            where.reshape(1, 1, 1, -1, 3),
            padding_mode="border",
            align_corners=True,
        )
        return sampled.reshape(-1)
