"""`take` rows of a table, and the `total` of rows by place: gathers whose sums come out the same every time.

Torch adds up what an index collects with atomic operations on a graphics card, in the order in which its threads arrive.
Here the rows of one place are brought next to each other by a stable sort and added up in ascending order. The two
functions are each other's derivative.
"""

from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

BLOCK = 256
"""Rows that one thread adds up: longer runs are added block by block, then the blocks."""


@dataclass(frozen=True, eq=False)
class Places:
    """Which of M places each of N rows belongs to; build it with `Places.of`, or `Places.runs` where rows are in order."""

    index: Int[Tensor, " N"]
    order: Int[Tensor, " N"] | None
    """The rows by place; None where they are so already."""
    offsets: tuple[Int[Tensor, " _"], ...]
    """Starts and end of the runs to add up, in one round or in two."""

    @staticmethod
    def of(index: Int[Tensor, " N"], count: int) -> "Places":
        """Rows that belong to the places `index`, each below `count`, in any order."""
        ascending, order = index.sort(stable=True)
        starts = torch.searchsorted(ascending, torch.arange(count + 1, device=index.device))
        return Places(index, order, _rounds(starts))

    @staticmethod
    def runs(lengths: Int[Tensor, " M"]) -> "Places":
        """The first lengths[0] rows belong to place 0, the next lengths[1] rows to place 1, and so on."""
        index = torch.arange(len(lengths), device=lengths.device).repeat_interleave(lengths)
        return Places(index, None, _rounds(_starts(lengths)))

    def added(self, rows: Float[Tensor, "N C"]) -> Float[Tensor, "M C"]:
        """The sum of the rows of every place; 0 where there are none."""
        if len(rows) == 0:
            return rows.new_zeros(len(self.offsets[-1]) - 1, rows.shape[1])
        sums = rows if self.order is None else rows[self.order]
        for offsets in self.offsets:
            sums = torch.segment_reduce(sums, "sum", offsets=offsets, axis=0, unsafe=True)
        return sums


def take(table: Float[Tensor, "M C"], places: Places) -> Float[Tensor, "N C"]:
    """(N, C): the row of the table at every place; differentiable."""
    taken: Tensor = _Take.apply(table, places)
    return taken


def total(rows: Float[Tensor, "N C"], places: Places) -> Float[Tensor, "M C"]:
    """(M, C): the sum of the rows at every place; differentiable."""
    added: Tensor = _Total.apply(rows, places)
    return added


class _Take(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, table: Tensor, places: Places) -> Tensor:
        ctx.places = places
        return table[places.index]

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None]:
        return ctx.places.added(grads[0].contiguous()), None


class _Total(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, rows: Tensor, places: Places) -> Tensor:
        ctx.places = places
        return places.added(rows.contiguous())

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None]:
        return grads[0][ctx.places.index], None


def _starts(lengths: Int[Tensor, " M"]) -> Int[Tensor, " _"]:
    """Where every run starts, and where the last one ends."""
    return torch.nn.functional.pad(lengths.cumsum(0), (1, 0))


def _rounds(starts: Int[Tensor, " _"]) -> tuple[Int[Tensor, " _"], ...]:
    """The runs that start at `starts`: as they are, or in blocks first where one is long."""
    lengths = starts.diff()
    if len(lengths) == 0 or int(lengths.max()) <= BLOCK:
        return (starts,)
    blocks = (lengths + BLOCK - 1) // BLOCK
    firsts = _starts(blocks)
    owner = torch.arange(len(lengths), device=starts.device).repeat_interleave(blocks)
    within = torch.arange(len(owner), device=starts.device) - firsts[owner]
    return torch.cat([starts[owner] + BLOCK * within, starts[-1:]]), firsts
