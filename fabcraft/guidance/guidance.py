"""`Guidance`: what an object should look like, as objectives on rendered views and on its surface.

The loop renders, hands over `Views`, and adds up what comes back; it knows no kind of guidance by name. Means over views,
never sums, so that views may come in chunks: a chunk's value counts with its share of the views.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64, Int


@dataclass(frozen=True, eq=False)
class Views:
    """What a guidance sees of the object at one step: K views of one chunk, and the surface itself.

    Images are in the layout of the renderer, (K, H, W) or (K, H, W, 3), row 0 on top; None where not asked for.
    """

    step: int
    """Of the run, from 0."""
    steps: int
    """Of the whole run."""
    camera: Int[np.ndarray, " K"]
    """Index of every view's camera in the fixed bank."""
    azimuth_deg: Float64[np.ndarray, " K"]
    """0 looks at the wearer's face, 90 from the wearer's left."""
    elevation_deg: Float64[np.ndarray, " K"]
    positions: Float[torch.Tensor, "V 3"]
    """Vertices in the optimiser's frame (longest template side = 2)."""
    faces: Int[torch.Tensor, "F 3"]
    pixels: Float[torch.Tensor, "K V 2"]
    """(column, row) of every vertex in every view, detached."""
    visible: Bool[torch.Tensor, "K V"]
    """Whether a face around the vertex owns a pixel of the view."""
    shaded: Float[torch.Tensor, "K H W"] | None = None
    mask: Float[torch.Tensor, "K H W"] | None = None
    normal: Float[torch.Tensor, "K H W 3"] | None = None
    depth: Float[torch.Tensor, "K H W"] | None = None


@runtime_checkable
class Guidance(Protocol):
    """An objective. `weights` says how much each of its losses counts; `outputs` which pictures it needs."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Pictures that it needs."""
        ...

    @property
    def weights(self) -> Mapping[str, float]:
        """How much each of its losses counts."""
        ...

    def describe(self) -> str:
        """One line for the report."""
        ...

    def losses(self, views: Views) -> Mapping[str, torch.Tensor]:
        """0-d tensors by name, unweighted, lower is better; a mean over the views of the chunk."""
        ...
