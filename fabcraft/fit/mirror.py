"""`Mirror`: a plane about which an object stays symmetric while it is deformed.

The unknowns X of a face are averaged with those of its mirror image: with S = I − 2 n nᵀ, face g the image of f and W the
tangent frames, X_f ← ½ (X_f + S X_g Wᵀ_g S W_f), and the translation loses its part along n. Linear, so it has a gradient.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float64
from scipy.spatial import cKDTree
from torch import Tensor

from fabcraft.errors import InputError
from fabcraft.geometry.frame import Frame
from fabcraft.geometry.poisson import PoissonSystem

_TOLERANCE = 0.02  # of the longest side: how far a mesh may be from its own mirror image


@dataclass(frozen=True, eq=False)
class Mirror:
    """A plane through `point` (mm) with a `normal` of any length."""

    point: Float64[np.ndarray, "3"]
    normal: Float64[np.ndarray, "3"]


def symmetric(
    mirror: Mirror, system: PoissonSystem, frame: Frame, device: torch.device | str = "cpu"
) -> Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]:
    """What of offset and translation is symmetric, as `Ways.admit` wants it.

    Raises `InputError` when the rest mesh is not its own mirror image, within 2 % of its size.
    """
    normal = mirror.normal / np.linalg.norm(mirror.normal)
    reflection = np.eye(3) - 2.0 * np.outer(normal, normal)
    middle = frame.inside(mirror.point[None])[0]
    centres = system.rest[system.faces].mean(1)
    distances, image = cKDTree(centres).query((centres - middle) @ reflection + middle)
    spacing = float(np.sqrt(system.areas.mean()))
    if float(np.quantile(distances, 0.95)) > 2.0 * _TOLERANCE + spacing:
        raise InputError(
            f"the object is not symmetric about the plane: its mirror image misses it by "
            f"{float(np.quantile(distances, 0.95)) / frame.scale:.1f} mm",
            "Give another plane, or none.",
        )
    bend = np.einsum("fdk,de,fel->fkl", system.frames[image], reflection, system.frames)
    across, turned, along = (
        torch.from_numpy(matrix).float().to(device) for matrix in (reflection, bend, np.outer(normal, normal))
    )
    index = torch.from_numpy(image.astype(np.int64)).to(device)

    def admit(offset: Tensor, translation: Tensor) -> tuple[Tensor, Tensor]:
        mirrored = torch.einsum("de,fek,fkl->fdl", across, offset[index], turned)
        return 0.5 * (offset + mirrored), translation - along @ translation

    return admit
