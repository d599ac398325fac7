"""`Neighbours`: the faces across each face's edges, and how much a field of faces varies between them.

The variation is a quadratic form, so its derivative needs no scatter: both directions only look up three rows a face, which
is fast and adds up in one order on every device.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from fabcraft.geometry.operators import edge_faces


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Build it with `Neighbours.of(faces)`."""

    table: Int[Tensor, "3 F"]
    """The face across each of the three edges; the face itself where there is none."""
    pairs: int
    """Neighbouring pairs, each counted once."""

    @staticmethod
    def of(faces: Int[np.ndarray, "F 3"], device: torch.device | str = "cpu") -> "Neighbours":
        """Of a mesh in which no edge has more than two faces."""
        _, pairs = edge_faces(faces)
        return Neighbours.paired(pairs[pairs[:, 1] >= 0], len(faces), device)

    @staticmethod
    def paired(pairs: Int[np.ndarray, "E 2"], count: int, device: torch.device | str = "cpu") -> "Neighbours":
        """Of pairs of faces below `count`; a face is in three of them at most."""
        ends, others = np.concatenate([pairs[:, 0], pairs[:, 1]]), np.concatenate([pairs[:, 1], pairs[:, 0]])
        order = np.argsort(ends, kind="stable")
        ends, others = ends[order], others[order]
        slot = np.arange(len(ends)) - np.searchsorted(ends, ends)
        table = np.tile(np.arange(count, dtype=np.int64), (3, 1))
        table[slot, ends] = others
        return Neighbours(torch.from_numpy(table).to(device), len(pairs))

    def variation(self, field: Float[Tensor, "F C"]) -> Tensor:
        """Mean over neighbouring pairs of |x_f − x_g|²; 0 where there are none."""
        varied: Tensor = _Variation.apply(field, self.table, max(self.pairs, 1))
        return varied


class _Variation(torch.autograd.Function):
    """½ Σ_f Σ_k |x_f − x_{g(f, k)}|² / E, whose gradient is 2 L x / E with L the Laplacian of the pairs."""

    @staticmethod
    def forward(ctx: Any, field: Tensor, table: Tensor, pairs: int) -> Tensor:
        laplacian, total = torch.zeros_like(field), field.new_zeros(())
        for across in table:
            difference = field - field.index_select(0, across)
            total += difference.square().sum()
            laplacian += difference
        ctx.save_for_backward(laplacian)
        ctx.pairs = pairs
        return total * (0.5 / pairs)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None, None]:
        (laplacian,) = ctx.saved_tensors
        return laplacian * (2.0 / ctx.pairs * grads[0]), None, None
