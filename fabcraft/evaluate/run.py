"""`evaluate`: all cells, then table, figures, page, study and manifest under one folder.

OUT/table.json, table.md, index.html     what was found
OUT/figures/*.png                        the paper's figures
OUT/study/study.html, study-key.json     the user study, without results
OUT/cells/, OUT/guidance/                what is found again the next time
OUT/manifest.json                        versions, seed, options and the key of every cell
"""

import json
import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from fabcraft import __version__
from fabcraft.errors import InputError
from fabcraft.evaluate.cells import Cell, Options, cell_of
from fabcraft.evaluate.figures import Figure, extra_cells, figures
from fabcraft.evaluate.jobs import in_processes
from fabcraft.evaluate.page import page_html
from fabcraft.evaluate.reference import guidance_recipe
from fabcraft.evaluate.study import items_of, key_json, study_page
from fabcraft.evaluate.suite import BODIES, JOINT, SUITE, TARGETS, Design, chosen
from fabcraft.evaluate.table import Row, by_design, comparison, markdown, rows_of
from fabcraft.recipe import Recipe
from fabcraft.write.atomic import write_atomically
from fabcraft.write.picture import png_bytes
from fabcraft.write.places import require_places

QUICK_STEPS = 16
"""Steps of a quick fit: enough to run every part, too few to say anything of the methods."""
MOST_JOBS = 64
_LIBRARIES = ("numpy", "scipy", "torch", "open_clip_torch", "manifold3d", "libigl", "trimesh")

Told = Callable[[Cell, int, int], None]
"""Called with every cell when it is there, how many are, and how many there will be."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What came out."""

    rows: tuple[Row, ...]
    compared: dict[str, float]
    cells: tuple[Cell, ...]
    """Of the table and of the figures."""
    figures: tuple[Figure, ...]
    files: tuple[str, ...]
    seconds: float

    def to_dict(self) -> dict[str, Any]:
        """What `--json` prints."""
        return {
            "schema": 1,
            "version": __version__,
            "table": [row.to_dict() for row in self.rows],
            "ours_against_no_body_loss": self.compared,
            "cells": [
                {"method": one.method, "design": one.design, "seconds": one.seconds, **one.metrics}
                | ({"error": one.error, "next_step": one.next_step} if one.error else {})
                for one in self.cells
            ],
            "figures": {one.name: "there" if one.picture is not None else one.why for one in self.figures},
            "files": list(self.files),
            "seconds": round(self.seconds, 1),
        }


def evaluate(
    options: Options,
    *,
    quick: bool = False,
    only: Sequence[str] = (),
    jobs: int = 1,
    told: Told | None = None,
) -> Evaluation:
    """Compute or find every cell, and write everything under `options.out`.

    quick : one design with few steps, to see that it runs.  only : METHOD, DESIGN or METHOD/DESIGN; figures then show what
    there is.  jobs : processes that compute cells at the same time.
    Raises `InputError` for an unknown name or a place that refuses, before the long work.
    """
    start = time.perf_counter()
    if not 1 <= jobs <= MOST_JOBS:
        raise InputError(f"{jobs} jobs were asked", f"Choose 1 to {MOST_JOBS}.")
    Recipe(steps=options.steps, preset=options.preset)  # refuses what no cell could be made with
    table = chosen(only, quick)
    if quick:
        options = replace(options, preset="draft", steps=options.steps or QUICK_STEPS)
    require_places([options.out / "table.json"])
    options.out.mkdir(parents=True, exist_ok=True)
    asked = list(dict.fromkeys([*table, *(() if only else extra_cells(quick))]))
    for _, design in asked:
        guidance_recipe(design)  # refuses a drawing that is not there
    cells = _computed(asked, options, jobs, told)
    rows = rows_of(cells[: len(table)])
    compared = comparison(cells[: len(table)])
    drawn = figures(cells, options.out)
    files = _written(options, quick, rows, compared, cells, len(table), drawn)
    return Evaluation(rows, compared, cells, drawn, files, time.perf_counter() - start)


def _computed(
    asked: Sequence[tuple[str, Design]], options: Options, jobs: int, told: Told | None
) -> tuple[Cell, ...]:
    """The cells in the order asked for; what is done stays when it is stopped."""
    cells: list[Cell] = []
    found = (cell_of(*one, options) for one in asked) if jobs == 1 else in_processes(asked, options, jobs)
    for cell in found:
        cells.append(cell)
        if told is not None:
            told(cell, len(cells), len(asked))
    return tuple(cells)


def _written(
    options: Options,
    quick: bool,
    rows: Sequence[Row],
    compared: dict[str, float],
    cells: Sequence[Cell],
    in_table: int,
    drawn: Sequence[Figure],
) -> tuple[str, ...]:
    """Everything that is read by people and programs; returns the paths."""
    out = options.out
    pngs = {one.name: png_bytes(one.picture) for one in drawn if one.picture is not None}
    manifest = {
        "version": __version__,
        "python": platform.python_version(),
        "libraries": {name: found for name in _LIBRARIES if (found := _version(name))},
        "machine": f"{platform.system()} {platform.machine()}",
        "preset": options.preset,
        "quick": quick,
        "steps": options.steps,
        "seed": options.seed,
        "encoder": options.encoder,
        "judge": options.judge,
        "cells": len(cells),
        "keys": {f"{one.method}/{one.design}": one.key for one in cells},
    }
    prompts = {design.name: design.prompt for design in (*SUITE, *TARGETS, *BODIES, *JOINT)}
    designs = by_design(cells[:in_table])
    items = items_of(cells[:in_table], prompts, out, options.seed)
    said = {"table": [row.to_dict() for row in rows], "ours_against_no_body_loss": compared}
    shown = {name: value for name, value in manifest.items() if name != "keys"}
    texts = {
        "table.json": json.dumps(said, indent=1, allow_nan=False) + "\n",
        "table.md": markdown(rows, designs),
        "manifest.json": json.dumps(manifest, indent=1) + "\n",
        "index.html": page_html(rows, compared, designs, drawn, pngs, shown),
        "study/study.html": study_page(items),
        "study/study-key.json": key_json(items),
    }
    data = {name: text.encode() for name, text in texts.items()}
    data |= {f"figures/{name}.png": png for name, png in pngs.items()}
    for one in drawn:
        if one.picture is None:  # of an earlier run: the page says that it is not there
            (out / f"figures/{one.name}.png").unlink(missing_ok=True)
    for name, content in data.items():
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        write_atomically(out / name, content)
    return tuple(str(out / name) for name in data)


def _version(library: str) -> str:
    try:
        return version(library)
    except PackageNotFoundError:
        return ""
