"""View consistency: a point of the surface should look alike from neighbouring views (TextDeformer, Gao et al. 2023, 3.3).

For every pair of views that are close in angle, and every vertex that is seen in both, the cosine between the features
of the patches nearest to its pixels; the loss is 1 minus the mean over all of them. Turns wrap around: 359 and 1 degrees
are neighbours.

Vertices that share their patch in both views contribute the same number, so they are counted: with N the (patches, patches)
counts of a pair and F, G the unit features of its views, the pair's sum of cosines is sum(F * (N G)).
"""

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64, Int
from torch import Tensor
from torch.nn import functional

NEAR_AZIMUTH_DEG = 20.0
NEAR_ELEVATION_DEG = 30.0


def consistency_loss(
    features: Float[Tensor, "K rows columns C"],
    patches: Int[Tensor, "K V"],
    azimuth_deg: Float64[np.ndarray, " K"],
    elevation_deg: Float64[np.ndarray, " K"],
) -> Float[Tensor, ""]:
    """1 - mean cosine over close pairs of views and the vertices seen in both; 0 when there are none.

    patches : the patch of every vertex in every view (`nearest_patch`), row after row; -1 where it is not seen.
    """
    unit = functional.normalize(features.flatten(1, 2), dim=-1)
    count = unit.shape[1]
    total, seen = unit.sum() * 0.0, 0
    for first, second in near_pairs(azimuth_deg, elevation_deg):
        both = (patches[first] >= 0) & (patches[second] >= 0)
        number = int(both.sum())
        if number:
            joint = patches[first][both] * count + patches[second][both]
            shared = torch.bincount(joint, minlength=count * count).reshape(count, count).to(unit)
            total = total + (unit[first] * (shared @ unit[second])).sum()
            seen += number
    return 1.0 - total / seen if seen else total


def near_pairs(
    azimuth_deg: Float64[np.ndarray, " K"], elevation_deg: Float64[np.ndarray, " K"]
) -> list[tuple[int, int]]:
    """Pairs (k, l), k < l, of views less than 20 degrees apart around and less than 30 degrees up or down."""
    around = np.abs(azimuth_deg[:, None] - azimuth_deg) % 360.0
    around = np.minimum(around, 360.0 - around)
    steep = np.abs(elevation_deg[:, None] - elevation_deg)
    near = np.triu((around < NEAR_AZIMUTH_DEG) & (steep < NEAR_ELEVATION_DEG), 1)
    return [(int(first), int(second)) for first, second in np.argwhere(near)]


def nearest_patch(
    pixels: Float[Tensor, "K V 2"],
    visible: Bool[Tensor, "K V"],
    picture: tuple[int, int],
    size: tuple[int, int],
    grid: tuple[int, int],
    patch: int,
) -> Int[Tensor, "K V"]:
    """The patch whose centre is nearest to every vertex, row after row; -1 where the vertex is hidden or off the picture.

    pixels : (column, row) in a rendered picture, pixel centres at halves.
    picture, size : (height, width) of the rendered picture and of the one that the encoder reads, px.
    grid : rows and columns of patches, the outermost flush with the picture's border.  patch : their side, px.
    """
    on = visible.clone()
    place = torch.zeros_like(visible, dtype=torch.int64)
    for axis, coordinate in ((0, pixels[..., 1]), (1, pixels[..., 0])):
        on &= (coordinate >= 0) & (coordinate < picture[axis])
        stride = (size[axis] - patch) / max(grid[axis] - 1, 1)
        scaled = coordinate * (size[axis] / picture[axis]) - 0.5 * patch
        index = torch.floor(torch.nan_to_num(scaled) / max(stride, 1.0) + 0.5).clamp(0, grid[axis] - 1)
        place = place * grid[axis] + index.to(torch.int64)
    return torch.where(on, place, torch.full_like(place, -1))
