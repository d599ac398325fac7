"""`write_all`: everything that `make` leaves behind: the object, and beside it report, page and pictures.

`cat.3mf` brings `cat.json`, `cat.html`, `cat-front.png` and so on. Pictures are drawn before the first file
is written, and when a file cannot be written those that this call created go again: all or nothing. The
report inside a 3MF carries no times, memory or paths, so the same recipe gives the same bytes.
"""

import functools
import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fabcraft.check.report import PrintReport
from fabcraft.errors import InputError
from fabcraft.mesh import Mesh
from fabcraft.recipe import Recipe, recipe_toml
from fabcraft.road.text import text_road
from fabcraft.write.atomic import write_atomically
from fabcraft.write.camera import VIEWS, View, views_towards
from fabcraft.write.files import checked_extension, write_mesh
from fabcraft.write.landmarks import head_frame
from fabcraft.write.maps import evolution_strip, penetration_map
from fabcraft.write.page import write_page
from fabcraft.write.picture import Item, png_bytes, scene_picture
from fabcraft.write.places import require_places, write_together
from fabcraft.write.wearer import contact_picture, wearer_items

if TYPE_CHECKING:
    from fabcraft.pipeline import Made

CAPTIONS = {
    "front": "Front",
    "three-quarter": "Three quarters",
    "side": "Side",
    "back": "Inside",
    "fit": "Distance of the inside to the skin",
    "contacts": "Where it rests, and what it keeps clear of",
    "input": "What was understood of the drawing",
    "evolution": "From the template to the object",
}
"""Pictures by the end of their file name, in the page's order."""
PORTRAIT = (900, 1000)
BESIDE_BAR = (725, 1000)
"""With the colour bar about as wide as `PORTRAIT`."""
FIT_LIMIT_MM = 20.0
"""Where the colours of the fit picture end: what rests and what floats has to be told apart."""
NOT_IN_3MF = ("seconds", "peak_memory_bytes", "files")


def side_files(recipe: Recipe) -> dict[str, Path]:
    """The files beside the first output by what they are: report, page and the pictures of `CAPTIONS`."""
    if not (recipe.pictures and recipe.output):
        return {}
    first = Path(recipe.output[0])
    names = {"report": f"{first.stem}.json", "page": f"{first.stem}.html"}
    names |= {
        name: f"{first.stem}-{name}.png" for name in CAPTIONS if name != "input" or _has_drawing(recipe)
    }
    return {name: first.with_name(file) for name, file in names.items()}


def _has_drawing(recipe: Recipe) -> bool:
    if recipe.mesh_wanted:
        return False
    return bool(recipe.sketch) or (bool(recipe.text) and text_road(recipe)[0] != "clip")


def require_outputs(recipe: Recipe, source: str = "") -> None:
    """Raise `InputError` when something of what `write_all` would write cannot be: ask before the long work.

    source : the recipe file, which must not be overwritten either.
    """
    for output in recipe.output:
        checked_extension(output)
    require_places(outputs_of(recipe), inputs_of(recipe, source))


def outputs_of(recipe: Recipe) -> list[str]:
    """Every path that `write_all` would write."""
    return [*recipe.output, *map(str, side_files(recipe).values())]


def inputs_of(recipe: Recipe, source: str = "") -> list[str]:
    """What may be a file that the recipe reads.  source : the recipe's own file."""
    own = (recipe.template, recipe.own.transform, recipe.own.landmarks, recipe.own.locked)
    return [
        *own,
        recipe.sketch,
        recipe.guidance,
        recipe.guidance_transform,
        recipe.mesh_file,
        recipe.body,
        recipe.contacts,
        recipe.printer,
        source,
    ]


def write_all(made: "Made", tell: Callable[[str, int, int], None] | None = None) -> tuple[str, ...]:
    """Write the recipe's outputs and what belongs beside the first; returns all paths, the outputs first.

    Raises `InputError` when a place refuses or the recipe names no output; nothing new is left then.
    """
    recipe = made.recipe
    if not recipe.output:
        raise InputError(
            "the recipe names no output", "Set output, for example out/mask.3mf (-o on the command line)."
        )
    require_outputs(recipe)
    beside = side_files(recipe)
    files = (*recipe.output, *(str(path) for path in beside.values()), *made.report.files)
    report = replace(made.report, files=files)
    pictures = _pictures(made, tell) if beside else {}
    thumbnail = png_bytes(scene_picture([Item(made.object)], _views(made)["three_quarter"], (512, 512)))
    jobs: list[tuple[Path, Callable[[], object]]] = []
    for path in map(Path, recipe.output):
        # what goes to the slicer lies on the bed; what goes to a viewer or a modeller stays on the body
        sliced = checked_extension(path) in (".3mf", ".stl")
        meshes = made.pieces if sliced else (made.object,)
        jobs.append((path, functools.partial(_write_object, path, meshes, made, report, thumbnail)))
    if beside:
        text = report.to_json().encode()
        jobs.append((beside["report"], functools.partial(write_atomically, beside["report"], text)))
        jobs.append((beside["page"], functools.partial(_write_page, beside["page"], made, report, pictures)))
    for name, png in pictures.items():
        jobs.append((beside[name], functools.partial(write_atomically, beside[name], png)))
    write_together(jobs)
    return files


def _title(recipe: Recipe) -> str:
    return recipe.title or Path(recipe.output[0]).stem


def _write_object(
    path: Path, meshes: Sequence[Mesh], made: "Made", report: PrintReport, thumbnail: bytes
) -> None:
    carried = {key: value for key, value in report.to_dict().items() if key not in NOT_IN_3MF}
    write_mesh(
        path,
        meshes,
        title=_title(made.recipe),
        metadata={"Description": f"{made.template.name.capitalize()} for {made.body.name}. {report.verdict}"},
        recipe=recipe_toml(made.recipe),
        report_json=json.dumps(carried, indent=2, ensure_ascii=False, allow_nan=False) + "\n",
        thumbnail_png=thumbnail,
    )


def _write_page(path: Path, made: "Made", report: PrintReport, pictures: dict[str, bytes]) -> None:
    thickness = made.inspection.thickness
    write_page(
        path,
        report.to_dict(),
        made.object,
        made.template.body.mesh,
        None if thickness is None else thickness.vertex_values(made.object),
        made.clearance_mm,
        {CAPTIONS[name]: png for name, png in pictures.items()},
        _title(made.recipe),
        recipe_toml(made.recipe),
        wall_mm=made.template.wall_mm,
    )


def _pictures(made: "Made", tell: Callable[[str, int, int], None] | None) -> dict[str, bytes]:
    """PNG bytes by the names of `CAPTIONS`."""
    head = made.template.body
    # a character is shown whole: its head alone would look cut off
    worn = [*wearer_items(made.body if head.kind == "character" else head), Item(made.object)]
    frame, views = head_frame(head, made.object), _views(made)

    def on_body(view: str) -> np.ndarray:
        return scene_picture(worn, views[view], PORTRAIT, frame_on=frame)

    def drawing() -> np.ndarray:
        from fabcraft.guidance.show import picture_of

        assert made.drawing is not None
        return picture_of(made.drawing)

    painters: dict[str, Callable[[], np.ndarray]] = {
        "front": lambda: on_body("front"),
        "three-quarter": lambda: on_body("three_quarter"),
        "side": lambda: on_body("side"),
        "back": lambda: scene_picture([Item(made.object)], views["back"], PORTRAIT),
        "fit": lambda: penetration_map(
            made.object,
            made.clearance_mm,
            views["back"],
            BESIDE_BAR,
            limit_mm=FIT_LIMIT_MM * made.template.scale,
        ),
        "contacts": lambda: contact_picture(head, made.template.contacts),
        "input": drawing,
        "evolution": lambda: _evolution(made),
    }
    if made.drawing is None:
        del painters["input"]
    # two at a time: numpy and the rasteriser let go of the interpreter while they work
    pictures: dict[str, bytes] = {}
    with ThreadPoolExecutor(2) as pool:
        drawn = {name: pool.submit(paint) for name, paint in painters.items()}
        for name, future in drawn.items():
            _tell(tell, len(pictures), len(drawn))
            pictures[name] = png_bytes(future.result())
    _tell(tell, len(drawn), len(drawn))
    return pictures


def _views(made: "Made") -> Mapping[str, View]:
    """The views of the report; something with a motif is looked at from where the motif faces."""
    motifs = made.template.motifs
    return views_towards(motifs[0].outward) if motifs else VIEWS


def _tell(tell: Callable[[str, int, int], None] | None, step: int, steps: int) -> None:
    if tell is not None:
        tell("pictures", step, steps)


def _evolution(made: "Made") -> np.ndarray:
    """The template, its way to the drawn outline, the fitted sheet and the object."""
    stages = dict(made.stages)
    names = list(stages)
    steps = [name for name in names if name.startswith("outline ")]
    kept = {"template": names[0]}
    kept |= {f"outline, step {name.split()[-1]}": name for name in steps[:2]}
    kept |= {"outline": "outline"} if "outline" in stages else {}
    kept |= {"relief, fitted to the body": names[-1]}
    meshes = [stages[name] for name in kept.values()]
    view = _views(made)["three_quarter"]
    return evolution_strip([*meshes, made.object], [*kept, "object"], view=view, size=(420, 480))
