"""Same input, same bytes: torch adds up gradients of indexed values in the order of its threads unless told not to.

On a graphics card so does cuBLAS, unless its workspace is fixed before it is first used.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def same_every_time() -> Iterator[None]:
    """Deterministic algorithms inside the block (also as a decorator); the user's own choice is restored after it."""
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")
    # use_deterministic_algorithms does the same, but imports the compiler first, for seconds
    before = torch.get_deterministic_debug_mode()
    torch.set_deterministic_debug_mode("error")
    try:
        yield
    finally:
        torch.set_deterministic_debug_mode(before)
