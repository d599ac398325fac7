"""Cells that other processes can be asked for: of a design called "dies", the process ends."""

import os
import time

from fabcraft.evaluate.cells import Cell, Options
from fabcraft.evaluate.suite import Design


def pretended(method: str, design: Design, options: Options) -> Cell:
    """A cell that is there at once; one called "slow" takes a minute."""
    if method == "dies":
        os._exit(9)
    if method == "slow":
        (options.out / "begun").write_text(f"{os.getpid()}\n")
        time.sleep(60.0)
    return Cell(method, design.name, design.title, "k", "f", {"pen_max_mm": 0.0}, 1.0)
