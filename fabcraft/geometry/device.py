"""Where tensors live: on the CPU or on a graphics card."""

import torch

from fabcraft.errors import InputError, MissingError


def device_of(asked: str) -> torch.device:
    """The device that is asked for; `auto` is a CUDA device where there is one.

    Raises `MissingError` when a CUDA device is asked for and there is none, `InputError` for any other word.
    """
    if asked not in ("cpu", "cuda", "auto"):
        raise InputError(f"the device '{asked}' was asked", "Choose cpu, cuda or auto.")
    there = torch.cuda.is_available()
    if asked == "cuda" and not there:
        raise MissingError(
            f"a CUDA device was asked, and torch {torch.__version__} finds none",
            "Choose auto or cpu; or install a build of torch for CUDA and the driver of the card.",
        )
    return torch.device("cuda" if there and asked != "cpu" else "cpu")
