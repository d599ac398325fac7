"""A cell of the comparison: one method on one design; computed once, kept in a folder of its own, found again by its key.

The key is a hash of the recipe, the bytes of its input files, the guidance mesh and fabcraft's version: what it says the
same, is the same. `cell.json` is written last, so a folder without it is a cell that was not finished.
"""

import functools
import hashlib
import json
import os
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from fabcraft import __version__
from fabcraft.errors import FabcraftError, MissingError
from fabcraft.evaluate.metrics import clip_metrics, fit_metrics, likeness_metrics
from fabcraft.evaluate.reference import Reference, guidance_mesh, guidance_recipe, reference_of
from fabcraft.evaluate.suite import TEXT_METHODS, Design, drawing_of
from fabcraft.pipeline import Made, make
from fabcraft.read.mesh_file import read_mesh
from fabcraft.recipe import Recipe, recipe_toml
from fabcraft.road.shaped import Tell
from fabcraft.write.atomic import write_atomically
from fabcraft.write.camera import VIEWS, View, views_towards
from fabcraft.write.files import write_mesh
from fabcraft.write.maps import evolution_strip, penetration_map
from fabcraft.write.picture import png_bytes
from fabcraft.write.wardrobe import worn_picture

SCHEMA = 3
"""Raised when what a cell keeps, or how it is computed, changes."""
SIZE = (420, 420)
MAP_MM = 3.0
"""Where the colours of the maps end, the same for all, on a body of a person's size."""
_REPORTED = ("wall_min_mm", "wall_ok_share", "self_intersections", "genus", "donnable", "volume_mm3")
"""What is taken from the print report."""


@dataclass(frozen=True)
class Options:
    """How the cells are computed."""

    out: Path
    preset: Literal["draft", "standard"] = "draft"
    steps: int = 0
    """Of the fit; 0 is the preset's."""
    seed: int = 0
    encoder: str = ""
    """That the text methods run on, and, where `judge` is empty, that scores; the default when left out."""
    judge: str = ""
    """The encoder that scores; "" for none."""


@dataclass(frozen=True)
class Cell:
    """What one method made of one design."""

    method: str
    design: str
    title: str
    key: str
    folder: str
    """Under the output: pictures and the part as STL."""
    metrics: Mapping[str, float | bool]
    """What was measured, by name."""
    seconds: float
    error: str = ""
    """Why there is no object."""
    next_step: str = ""
    missing: bool = False
    """Something needed is not on this machine: it is tried again the next time."""


def recipe_for(method: str, design: Design, options: Options, guidance: Path) -> Recipe:
    """What makes the cell: the method with the input that it reads."""
    given: dict[str, Any]
    if method == "direct":
        given = drawing_of(design)
    elif method in TEXT_METHODS:
        given = {"text": design.prompt, "via": "clip", "encoder": options.encoder}
    else:
        given = {"guidance": str(guidance)}
    return Recipe(
        template=design.template,
        body=design.body,
        preset=options.preset,
        steps=options.steps,
        seed=options.seed,
        method=method,
        strap_slots=False,
        **given,
    )


def key_of(recipe: Recipe, guidance: Path, *more: str) -> str:
    """Hash of a recipe, the files that it reads, the guidance mesh, fabcraft's version and `more`."""
    said = [str(SCHEMA), __version__, recipe_toml(recipe), *more]
    digest = hashlib.sha256(json.dumps(said).encode())
    for path in (guidance, *(Path(name) for name in (recipe.sketch, recipe.guidance, recipe.encoder))):
        if path.is_file():
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def guidance_of(design: Design, options: Options) -> Path:
    """The design's guidance mesh as a file under the output, made if it is not there yet."""
    recipe = guidance_recipe(design)
    drawn = Path(recipe.sketch).read_bytes() if recipe is not None and recipe.sketch else b""
    told = repr(design) if recipe is None else recipe_toml(recipe)
    key = hashlib.sha256(f"{SCHEMA} {__version__} {told}".encode() + drawn).hexdigest()
    path = options.out / "guidance" / f"{design.name.partition('@')[0]}-{key[:12]}.ply"
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_mesh(path, guidance_mesh(design))
    return path


def cell_of(method: str, design: Design, options: Options, tell: Tell | None = None) -> Cell:
    """The cell, from its folder or computed.  What goes wrong with it is said in it.

    Raises `KeyboardInterrupt` when it is stopped, `InputError` when the output refuses.
    """
    start = time.perf_counter()
    said: dict[str, Any] = {"method": method, "design": design.name, "title": design.title}
    key, folder = "", ""
    try:
        guidance = guidance_of(design, options)
        recipe = recipe_for(method, design, options, guidance)
        key = key_of(recipe, guidance, design.prompt, options.judge)
        folder = f"cells/{method}-{design.name}-{key[:12]}".replace("@", "-")
        if (known := _kept(options.out / folder, key)) is not None:
            return known
        made = make(recipe, tell)
        if made.interrupted:
            raise KeyboardInterrupt
        reference = _reference(design, guidance)
        metrics = _measured(made, reference, design, options)
        _draw(made, options.out / folder)
        cell = Cell(**said, key=key, folder=folder, metrics=metrics, seconds=_since(start))
    except MissingError as error:
        return Cell(
            **said,
            key=key,
            folder="",
            metrics={},
            seconds=0.0,
            error=error.message,
            next_step=error.next_step,
            missing=True,
        )
    except FabcraftError as error:
        told: dict[str, Any] = {"error": error.message, "next_step": error.next_step}
        cell = Cell(**said, key=key, folder=folder, metrics={}, seconds=_since(start), **told)
        if not folder:  # its guidance mesh could not be made
            return cell
    except Exception as error:
        if os.environ.get("FABCRAFT_TRACEBACK"):
            raise
        # a night's work must not end at one cell; it is tried again the next time
        told = {
            "error": f"this is a defect in fabcraft: {type(error).__name__}: {error}",
            "next_step": "Run that cell alone (--only) with FABCRAFT_TRACEBACK=1 to see where, and report that.",
        }
        return Cell(**said, key=key, folder="", metrics={}, seconds=_since(start), **told)
    _keep(options.out / folder, cell)
    return cell


def _since(start: float) -> float:
    return round(time.perf_counter() - start, 2)


def _kept(folder: Path, key: str) -> Cell | None:
    """The cell in `folder`; None where it is not there, not finished, or another one."""
    try:
        table = json.loads((folder / "cell.json").read_text("utf-8"))
        found = Cell(**table)
    except (OSError, ValueError, TypeError):
        return None
    return found if found.key == key else None


def _keep(folder: Path, cell: Cell) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(folder / "cell.json", json.dumps(asdict(cell), indent=1, allow_nan=False).encode())


@functools.lru_cache(maxsize=2)
def _reference(design: Design, guidance: Path) -> Reference:
    """Cells come design by design, so the last one is asked for again."""
    return reference_of(design, read_mesh(guidance))


@functools.lru_cache(maxsize=1)
def _judge(name: str) -> Any:
    from fabcraft.guidance.clip import load_clip

    return load_clip(name)


def _measured(made: Made, reference: Reference, design: Design, options: Options) -> dict[str, float | bool]:
    """Everything that can be measured, by name; one of a pair stands for both."""
    one = made.worn.object or made.object
    reported = made.report.metrics
    found: dict[str, Any] = {name: reported[name] for name in _REPORTED if reported.get(name) is not None}
    found |= fit_metrics(one, reference) | likeness_metrics(one, reference.goal, reference.picture)
    if options.judge:
        found |= clip_metrics(one, design.prompt, _judge(options.judge))
    plain = {name: value if isinstance(value, bool) else float(value) for name, value in found.items()}
    return {name: value for name, value in plain.items() if np.isfinite(value)}


def _draw(made: Made, folder: Path) -> None:
    """What figures and study show of the object, and the part as it is printed."""
    folder.mkdir(parents=True, exist_ok=True)
    motifs = made.template.motifs
    views = views_towards(motifs[0].outward) if motifs else VIEWS
    side = views["three_quarter"]
    other = View(side.azimuth_deg - 80.0, side.elevation_deg)
    inside = (
        views["back"] if made.template.kind == "sheet" else side
    )  # a ring shows its inner side through its hole
    limit = MAP_MM * made.template.scale
    pictures = {
        "worn": worn_picture(made.template, made.object, size=SIZE),
        "other": worn_picture(made.template, made.object, other, SIZE),
        "map": penetration_map(made.object, made.clearance_mm, inside, SIZE, limit_mm=limit),
    }
    if made.recipe.method == "ours":
        stages = [*made.stages, ("object", made.object)]
        meshes, labels = [mesh for _, mesh in stages], [label for label, _ in stages]
        pictures["evolution"] = evolution_strip(meshes, labels, view=side, size=(260, 280))
    for name, picture in pictures.items():
        write_atomically(folder / f"{name}.png", png_bytes(picture))
    write_mesh(folder / "part.stl", made.on_bed)
