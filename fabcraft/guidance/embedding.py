"""Losses on an encoder's vectors, as pure functions to 0-d tensors; means over views.

`cosine_loss` is 1 - cos (a constant above the paper's -cos). `direction_loss` compares the way a picture has gone with
the way from a base prompt to the prompt, on raw vectors as in TextDeformer (Gao et al. 2023):

    1 - cos(E(I) - E(I0), E(P) - E(P0)).

A picture that has not moved has no direction: there the cosine jumps and its gradient has no bound, and that is the very
first step of a fit. So lengths are softened, sqrt(|d|² + s²) with s a share of |E(I0)|; the loss of a picture at rest is
1, with a gradient towards the prompt, and of one that has gone far it is the plain cosine's.
"""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

SOFTENING = 0.05
"""Of the length of a rest picture's vector; two pictures at that distance have a cosine of 0.999."""


def cosine_loss(vectors: Float[Tensor, "K D"], targets: Float[Tensor, "#K D"]) -> Float[Tensor, ""]:
    """1 - mean over K of cos(vector, target)."""
    return 1.0 - functional.cosine_similarity(vectors, targets, dim=-1).mean()


def direction_loss(
    vectors: Float[Tensor, "K D"], rest: Float[Tensor, "K D"], direction: Float[Tensor, " D"]
) -> Float[Tensor, ""]:
    """1 - mean over K of cos(vector - rest, direction), softened; finite, with a bounded gradient, also at rest."""
    moved = vectors - rest
    soft = SOFTENING * torch.linalg.vector_norm(rest, dim=-1)
    length = torch.sqrt(moved.square().sum(-1) + soft.square())
    return 1.0 - ((moved @ functional.normalize(direction, dim=0)) / length).mean()
