"""What stands behind the object when an encoder looks at it.

Before a background that never changes, an encoder's loss can be lowered by what is *not* there; before one that changes
from view to view only the object counts (Jain et al. 2022, Gao et al. 2023). A third each: noise on a colour, a
checkerboard of 5 to 10 fields, a plain colour; blurred. A camera of the fixed bank always has the same one, so that
vectors of the rest shape can be kept.
"""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, Float32, Int
from scipy.ndimage import gaussian_filter
from torch import Tensor

BLUR_SHARES = (0.0, 0.005, 0.01, 0.02)
"""Of the picture's height: standard deviations of the blur."""


def jittered(
    cameras: Int[np.ndarray, " K"] | Sequence[int], size: tuple[int, int], seed: int = 0
) -> Float[Tensor, "K h w 3"]:
    """(K, *size, 3) float32 backgrounds in 0..1 of K cameras; the same camera and seed give the same one."""
    return torch.from_numpy(np.stack([_one(int(camera), size, seed) for camera in cameras]))


def _one(camera: int, size: tuple[int, int], seed: int) -> Float32[np.ndarray, "h w 3"]:
    random = np.random.default_rng((seed, camera))
    first, second = random.uniform(0.0, 1.0, (2, 3))
    kind, blur = random.integers(3), size[0] * random.choice(BLUR_SHARES)
    if kind == 0:
        picture = first + 0.2 * random.standard_normal((*size, 3))
    elif kind == 1:
        fields = random.integers(5, 11)
        rows, columns = ((np.arange(side) * fields) // side for side in size)
        odd = (rows[:, None] + columns) % 2
        picture = np.where(odd[..., None] == 1, first, second)
    else:
        picture = np.broadcast_to(first, (*size, 3))
    if blur > 0:
        picture = gaussian_filter(picture, (blur, blur, 0.0), mode="nearest")
    return np.clip(picture, 0.0, 1.0).astype(np.float32)
