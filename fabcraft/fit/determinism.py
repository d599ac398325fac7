"""Same input, same bytes: torch adds up gradients of indexed values in the order of its threads unless told not to."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def same_every_time() -> Iterator[None]:
    """Deterministic algorithms inside the block (also as a decorator); the user's own choice is restored after it."""
    before = torch.are_deterministic_algorithms_enabled()
    torch.use_deterministic_algorithms(True)
    try:
        yield
    finally:
        torch.use_deterministic_algorithms(before)
