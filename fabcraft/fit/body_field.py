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

    values: Float[Tensor, "Z Y X"]
    lower: Float64[np.ndarray, "3"]
    cell_mm: float

    @staticmethod
    def around(
        distance: SurfaceDistance,
        lower: Float64[np.ndarray, "3"],
        upper: Float64[np.ndarray, "3"],
        cell_mm: float,
        device: torch.device | str = "cpu",
    ) -> "BodyField":
        """Sample the exact distance on the nodes of the box from `lower` to at least `upper`."""
        counts = np.maximum(np.ceil((upper - lower) / cell_mm).astype(int), 1) + 1
        axes = [lower[axis] + cell_mm * np.arange(counts[axis]) for axis in range(3)]
        z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
        signed = distance.signed(np.column_stack([x.ravel(), y.ravel(), z.ravel()]))
        values = torch.from_numpy(signed.reshape(x.shape)).float().to(device)
        return BodyField(values, np.array(lower, dtype=np.float64), cell_mm)

    def __call__(self, points: Float[Tensor, "N 3"]) -> Float[Tensor, " N"]:
        """Signed distance at points in mm, trilinear, differentiable."""
        # eight look-ups instead of grid_sample, which has no deterministic derivative on a graphics card
        lower = torch.from_numpy(self.lower).to(points)
        last = points.new_tensor(self.values.shape[::-1]) - 1.0
        node = torch.minimum(((points - lower) / self.cell_mm).clamp_min(0.0), last)
        first = torch.minimum(node.detach().floor(), last - 1.0)
        x, y, z = first.long().unbind(1)
        _, high, wide = self.values.shape
        corner = (z * high + y) * wide + x
        steps = [up + step for up in (0, high * wide) for step in (0, 1, wide, wide + 1)]
        at = [torch.take(self.values, corner + step).to(points.dtype) for step in steps]
        for share in (node - first).unbind(1):
            at = [torch.lerp(low, more, share) for low, more in zip(at[::2], at[1::2], strict=True)]
        return at[0]
