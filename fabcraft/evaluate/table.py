"""The paper's Table 1 from its cells: a row for every method, a column for every metric, means over the designs.

`pen_max_mm` is the worst of all designs, `donnable` the share that can be put on; every other column is a mean over the
designs that were measured, and `designs` says how many. What was not measured has no key.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fabcraft.evaluate.cells import Cell
from fabcraft.evaluate.suite import METHODS, TEXT_METHODS, WORDS

COLUMNS = (
    ("clip_cos", "CLIP ↑", "{:.3f}"),
    ("paper_Dp", "D_p ↓", "{:.2e}"),
    ("paper_Dc", "D_c ↓", "{:.2e}"),
    ("pen_max_mm", "deepest, mm ↓", "{:.2f}"),
    ("pen_rms_mm", "depth rms, mm ↓", "{:.3f}"),
    ("pen_area_pct", "area inside, % ↓", "{:.1f}"),
    ("pen_volume_mm3", "volume inside, mm³ ↓", "{:.1f}"),
    ("contact_rms_mm", "contact rms, mm ↓", "{:.2f}"),
    ("contact_within_1mm_pct", "contact within 1 mm, % ↑", "{:.0f}"),
    ("silhouette_iou", "silhouette IoU ↑", "{:.3f}"),
    ("drawing_iou", "drawing IoU ↑", "{:.3f}"),
    ("chamfer_mm", "chamfer, mm ↓", "{:.2f}"),
    ("wall_min_mm", "thinnest wall, mm ↑", "{:.2f}"),
    ("wall_ok_share", "wall kept, % ↑", "{:.0%}"),
    ("donnable", "can be put on ↑", "{:.0%}"),
)
"""(name, heading, how it is written)."""
PER_DESIGN = ("pen_max_mm", "contact_rms_mm", "silhouette_iou", "drawing_iou", "chamfer_mm", "wall_min_mm")
"""What is shown of every design, ours against no body loss."""
NO_WEIGHTS = "not measured: weights absent, fabcraft weights fetch"


@dataclass(frozen=True)
class Row:
    """A method over its designs."""

    method: str
    designs: int
    """How many were measured."""
    numbers: dict[str, float]
    note: str = ""
    """Why something is absent."""

    def to_dict(self) -> dict[str, Any]:
        """As `--json` prints it."""
        told = {"note": self.note} if self.note else {}
        return {"method": self.method, "designs": self.designs, **self.numbers, **told}


def rows_of(cells: Sequence[Cell]) -> tuple[Row, ...]:
    """A row for every method that has a cell, in the table's order."""
    return tuple(
        _row(method, mine) for method in METHODS if (mine := [c for c in cells if c.method == method])
    )


def _row(method: str, cells: Sequence[Cell]) -> Row:
    good = [cell for cell in cells if not cell.error]
    numbers = {}
    for name, _, _ in COLUMNS:
        values = [float(cell.metrics[name]) for cell in good if name in cell.metrics]
        if values:
            numbers[name] = float(np.max(values) if name == "pen_max_mm" else np.mean(values))
    absent = [cell for cell in cells if cell.missing]
    if absent and method in TEXT_METHODS and not good:
        return Row(method, 0, numbers, NO_WEIGHTS)
    failed = [f"{cell.title}: {cell.error}" for cell in cells if cell.error]
    return Row(method, len(good), numbers, "; ".join(failed))


def comparison(cells: Sequence[Cell]) -> dict[str, float]:
    """Ours against no body loss, over the designs that have both: how many times smaller, and the likeness given up.

    A ratio is absent where ours has nothing left to divide by.
    """
    pairs = _pairs(cells)
    found: dict[str, float] = {"designs": float(len(pairs))}
    if not pairs:
        return found
    for name in ("pen_rms_mm", "pen_volume_mm3", "contact_rms_mm", "paper_Dp", "paper_Dc"):
        both = [
            (float(a.metrics[name]), float(b.metrics[name]))
            for a, b in pairs
            if name in a.metrics and name in b.metrics
        ]
        ours, without = (float(np.mean(side)) for side in zip(*both, strict=True)) if both else (0.0, 0.0)
        if ours > 0.0:
            found[f"{name}_times_smaller"] = without / ours
    found["pen_max_mm_ours"] = max(float(a.metrics["pen_max_mm"]) for a, _ in pairs)
    for name in ("silhouette_iou", "drawing_iou"):
        lost = [
            float(b.metrics[name]) - float(a.metrics[name])
            for a, b in pairs
            if name in a.metrics and name in b.metrics
        ]
        if lost:
            found[f"{name}_lost"] = float(np.mean(lost))
    return found


def by_design(cells: Sequence[Cell]) -> tuple[tuple[str, ...], ...]:
    """A line in words for every design that has both, ours / no body loss; the first line is the headings."""
    shown = [column for column in COLUMNS if column[0] in PER_DESIGN]
    lines = [("design", *(heading for _, heading, _ in shown))]
    for ours, without in _pairs(cells):
        both = [
            " / ".join(
                form.format(one.metrics[name]) if name in one.metrics else "–" for one in (ours, without)
            )
            for name, _, form in shown
        ]
        lines.append((ours.title, *both))
    return tuple(lines)


def _pairs(cells: Sequence[Cell]) -> list[tuple[Cell, Cell]]:
    good = {(cell.method, cell.design): cell for cell in cells if not cell.error}
    designs = [design for method, design in good if method == "ours"]
    return [
        (good["ours", design], good["no-body-loss", design])
        for design in designs
        if ("no-body-loss", design) in good
    ]


def written(row: Row) -> tuple[str, ...]:
    """A row in words: method, designs, and every column; – for what was not measured."""
    cells = [form.format(row.numbers[name]) if name in row.numbers else "–" for name, _, form in COLUMNS]
    return (WORDS[row.method], str(row.designs), *cells)


def markdown(rows: Sequence[Row], designs: Sequence[Sequence[str]]) -> str:
    """The table as Markdown, with a line for every note, and below it `designs` (`by_design`)."""
    head = ("method", "designs", *(heading for _, heading, _ in COLUMNS))
    notes = [f"- {WORDS[row.method]}: {row.note}" for row in rows if row.note]
    parts = [_piped([head, *map(written, rows)]), "", *notes]
    if len(designs) > 1:
        parts += ["", "Ours / no body loss, design by design:", "", _piped(designs)]
    return "\n".join(parts) + "\n"


def _piped(lines: Sequence[Sequence[str]]) -> str:
    ruled = [lines[0], ("---",) * len(lines[0]), *lines[1:]]
    return "\n".join("| " + " | ".join(line) + " |" for line in ruled)
