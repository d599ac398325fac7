"""The devices that a test runs on: always the CPU, and a graphics card where there is one."""

import pytest
import torch

CUDA = pytest.param(
    "cuda",
    marks=pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device on this machine"),
)
DEVICES = ["cpu", CUDA]
