"""What people see: progress and errors on stderr, results on stdout.

Colours and moving bars only in a terminal (and not with NO_COLOR); in a pipe or a log one line a stage.
"""

import contextlib
import errno
import json
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from types import TracebackType
from typing import Any

from fabcraft.check.report import Finding, PrintReport
from fabcraft.errors import InputError

STAGES = {
    "ask": "Asking the back end",
    "read": "Reading",
    "body": "Preparing the body",
    "template": "Building the template",
    "guidance": "Understanding the guidance",
    "fit": "Fitting the template",
    "solid": "Making it solid",
    "check": "Checking",
    "slice": "Slicing",
    "pictures": "Drawing the pictures",
}
"""The stages of a run, as people say them."""

_COLOURS = {"fail": "31", "warn": "33", "note": "2", "good": "32", "bold": "1", "dim": "2"}
_FIGURES = (
    ("size_mm", "size", "mm"),
    ("volume_mm3", "volume", "cm³"),
    ("wall_min_mm", "thinnest wall", "mm"),
    ("silhouette_iou", "overlap with the drawing", ""),
    ("pen_max_mm", "deepest in the body", "mm"),
    ("contact_rms_mm", "contacts within", "mm"),
)


def say(text: str) -> None:
    """A sentence on stderr."""
    with contextlib.suppress(OSError, ValueError):  # nobody listens
        print(f"fabcraft: {text}", file=sys.stderr, flush=True)  # noqa: T201


def result(text: str) -> None:
    """Text on stdout.  A reader that has gone is fine; raises `InputError` when stdout refuses."""
    try:
        print(text, flush=True)  # noqa: T201
    except BrokenPipeError:
        drop_stdout()
    except OSError as error:
        drop_stdout()
        why = "the disk is full" if error.errno == errno.ENOSPC else (error.strerror or str(error))
        raise InputError(
            f"the result could not be written to standard output: {why}", "Redirect it elsewhere."
        ) from None


def result_json(value: Any) -> None:
    """A value as JSON on stdout."""
    result(json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False))


def drop_stdout() -> None:
    """Let nothing more go to a stdout that refuses, not even what Python flushes at its end."""
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def painted(text: str, colour: str) -> str:
    """`text` in a colour of the terminal, or as it is where there is none."""
    plain = bool(os.environ.get("NO_COLOR")) or os.environ.get("TERM") == "dumb"
    return text if plain or not is_terminal(sys.stdout) else f"\033[{_COLOURS[colour]}m{text}\033[0m"


def show_report(report: PrintReport, on: str = "") -> None:
    """Verdict, findings, the figures that matter and the files, on stdout.  on : the printer's title."""
    verdict = f"{on}: {report.verdict[:1].lower()}{report.verdict[1:]}" if on else report.verdict
    lines = [painted(verdict, "good" if report.printable else "fail" if report.failed else "warn"), ""]
    lines += [_finding(finding) for finding in report.findings]
    figures = [_figure(report.metrics, *figure) for figure in _FIGURES if figure[0] in report.metrics]
    if figures:
        lines += ["", "; ".join(figures)]
    if report.files:
        lines += ["", *(f"wrote {file}" for file in report.files)]
    result("\n".join(lines))


def _finding(finding: Finding) -> str:
    mark, _, rest = finding.to_text().partition(" ")
    return f"{painted(mark, finding.severity)} {rest}"


def _figure(metrics: Mapping[str, Any], key: str, label: str, unit: str) -> str:
    value = metrics[key]
    if key == "wall_min_mm" and value >= metrics.get("wall_measured_to_mm", value + 1):
        label = "wall at least"  # thicker was not measured
    if unit == "cm³":
        text = f"{value / 1000:.1f}"
    elif isinstance(value, tuple):
        text = " x ".join(f"{one:.0f}" for one in value)
    else:
        text = f"{value:.3g}"
    return f"{label} {text} {unit}".strip()


def table(rows: Sequence[tuple[str, ...]]) -> str:
    """Rows of words in columns as wide as they need to be."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    )


def is_terminal(stream: Any) -> bool:
    try:
        return stream is not None and stream.isatty()
    except ValueError:  # closed
        return False


class Progress:
    """A run's stages on stderr: bars in a terminal, otherwise a line for each; nothing when `quiet`."""

    def __init__(self, quiet: bool = False) -> None:
        self._quiet, self._stage, self._task = quiet, "", None
        self._bars: Any = None

    def __enter__(self) -> "Progress":
        if not self._quiet and is_terminal(sys.stderr) and os.environ.get("TERM") != "dumb":
            from rich.console import Console
            from rich.progress import BarColumn, SpinnerColumn, TextColumn, TimeElapsedColumn
            from rich.progress import Progress as Bars

            columns = (SpinnerColumn(finished_text="✓"), TextColumn("{task.description:<28}"), BarColumn(24))
            console = Console(stderr=True)
            text = TextColumn("{task.fields[part]}")
            self._bars = Bars(*columns, TimeElapsedColumn(), text, console=console, redirect_stdout=False)
            self._bars.start()
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._bars is not None:
            if error is None:
                self._finish()
            self._bars.stop()

    @contextlib.contextmanager
    def paused(self) -> Iterator[None]:
        """The bars put aside, for a question."""
        if self._bars is not None:
            self._bars.stop()
        try:
            yield
        finally:
            if self._bars is not None:
                self._bars.start()

    def tell(self, stage: str, step: int, steps: int) -> None:
        """A `fabcraft.pipeline.Tell`: stage (`fit: relief` is a part of `fit`), step, number of steps."""
        name, _, part = stage.partition(": ")
        if name != self._stage:
            self._begin(name)
        if self._bars is not None:
            # a stage without steps of its own shows a bar that comes and goes until it is done
            whole = steps if steps > 1 else None
            self._bars.update(self._task, completed=step, total=whole, part=part)

    def _begin(self, name: str) -> None:
        words = STAGES.get(name, name)
        if self._bars is not None:
            self._finish()
            self._task = self._bars.add_task(words, total=None, part="")
        elif not self._quiet:
            say(f"{words[:1].lower()}{words[1:]}")
        self._stage = name

    def _finish(self) -> None:
        if self._task is not None:
            self._bars.update(self._task, completed=1, total=1, part="")
            self._bars.stop_task(self._task)
