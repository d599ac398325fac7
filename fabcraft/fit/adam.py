"""One step of Adam (Kingma and Ba, "Adam: a method for stochastic optimization", 2015, algorithm 1).

Written out, since making torch's own optimiser loads its compiler: seconds at the start of every run.
"""

import math

from torch import Tensor

EPSILON = 1e-8


def adam_step(
    parameter: Tensor,
    gradient: Tensor,
    first: Tensor,
    second: Tensor,
    step: int,
    rate: float,
    betas: tuple[float, float],
) -> None:
    """Change `parameter` and its two moments in place; `step` counts from 1."""
    first.lerp_(gradient, 1.0 - betas[0])
    second.mul_(betas[1]).addcmul_(gradient, gradient, value=1.0 - betas[1])
    root = (second.sqrt() / math.sqrt(1.0 - betas[1] ** step)).add_(EPSILON)
    parameter.addcdiv_(first, root, value=-rate / (1.0 - betas[0] ** step))
