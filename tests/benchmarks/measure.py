"""Times of rivals that take turns, and the rows they end up in."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from time import perf_counter, process_time

import numpy as np


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    name: str
    ratio: float | None
    """What the aim is about: peer's time over ours, a slope, a share or an exponent; None for what is only timed."""
    aim: str
    """As ">= 5", "<= 30 ms" or "0.97..1.03"; empty where there is none."""
    peer: str = ""
    ours_ms: float | None = None
    peer_ms: float | None = None
    note: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the aim is reached; None where there is none or nothing was measured."""
        value = self.ours_ms if self.aim.endswith("ms") else self.ratio
        if not self.aim or value is None:
            return None
        if ".." in self.aim:
            low, high = map(float, self.aim.split(".."))
            return low <= value <= high
        sign, bound = self.aim.removesuffix(" ms").split()
        return value >= float(bound) if sign == ">=" else value <= float(bound)

    def answer(self) -> dict[str, object]:
        """As it is written."""
        return {
            key: round(value, 4) if isinstance(value, float) else value for key, value in asdict(self).items()
        }


@dataclass(frozen=True)
class Times:
    """Of one rival, a value for every round."""

    wall_ms: np.ndarray
    cpu_ms: np.ndarray
    """Of all threads of the process together: what a neighbour on the machine hardly changes."""

    @property
    def ms(self) -> float:
        return float(np.median(self.wall_ms))

    @property
    def cpu(self) -> float:
        return float(np.median(self.cpu_ms))


def take_turns(
    rivals: Mapping[str, Callable[[], object]], rounds: int = 9, warm: int = 2
) -> dict[str, Times]:
    """Run the rivals in turn, `rounds` times after `warm` turns that do not count."""
    wall, cpu = {name: [] for name in rivals}, {name: [] for name in rivals}
    for turn in range(warm + rounds):
        for name, function in rivals.items():
            started, used = perf_counter(), process_time()
            function()
            if turn >= warm:
                wall[name].append(1e3 * (perf_counter() - started))
                cpu[name].append(1e3 * (process_time() - used))
    return {name: Times(np.array(wall[name]), np.array(cpu[name])) for name in rivals}


def compared(name: str, aim: str, peer: str, ours: Times, theirs: Times, note: str = "") -> Row:
    """Peer's wall time over ours, the median over the rounds; the note says it in CPU time too."""
    ratio = float(np.median(theirs.wall_ms / ours.wall_ms))
    told = f"in CPU time {theirs.cpu / ours.cpu:.1f}" + (f"; {note}" if note else "")
    return Row(name, ratio, aim, peer, ours.ms, theirs.ms, told)


def table(rows: list[Row]) -> str:
    """The rows as text."""
    cells = [("", "ratio", "aim", "", "ours ms", "peer ms", "peer", "note")]
    for row in rows:
        met = {None: "", True: "met", False: "MISSED"}[row.met]
        numbers = ["" if value is None else f"{value:.4g}" for value in (row.ratio, row.ours_ms, row.peer_ms)]
        cells.append((row.name, numbers[0], row.aim, met, numbers[1], numbers[2], row.peer, row.note))
    widths = [max(len(line[column]) for line in cells) for column in range(len(cells[0]))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in cells
    )
