"""`write_all`: everything that `make` leaves behind: the object, and beside it report, page and pictures.

`cat.3mf` brings `cat.json`, `cat.html`, `cat-front.png` and so on. Pictures are drawn before the first file
is written, and when a file cannot be written those that this call created go again: all or nothing. The
report inside a 3MF carries no times, memory or paths, so the same recipe gives the same bytes.
"""

import contextlib
import functools
import json
import os
import tempfile
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fabcraft.body.body import Body
from fabcraft.errors import InputError
from fabcraft.mesh import Mesh
from fabcraft.recipe import Recipe, recipe_toml
from fabcraft.solid.orient import onto_bed
from fabcraft.write.atomic import REASONS, write_atomically
from fabcraft.write.camera import VIEWS, camera_for
from fabcraft.write.colours import BODY
from fabcraft.write.files import checked_extension, write_mesh
from fabcraft.write.maps import evolution_strip, penetration_map
from fabcraft.write.page import write_page
from fabcraft.write.picture import Item, png_bytes, scene_picture

if TYPE_CHECKING:
    from fabcraft.pipeline import Made

CAPTIONS = {
    "front": "Front",
    "three-quarter": "Three quarters",
    "side": "Side",
    "back": "Inside",
    "fit": "Distance of the inside to the skin",
    "evolution": "From the template to the object",
    "input": "What was understood of the drawing",
}
"""Pictures by the end of their file name, in the page's order."""
PORTRAIT = (900, 1000)
BESIDE_BAR = (725, 1000)
"""With the colour bar about as wide as `PORTRAIT`."""
BELOW_CHIN_MM = 40.0
"""How much neck is in a picture of the head."""
FIT_LIMIT_MM = 20.0
"""Where the colours of the fit picture end: what rests and what floats has to be told apart."""
NOT_IN_3MF = ("seconds", "peak_memory_bytes", "files")


def side_files(recipe: Recipe) -> dict[str, Path]:
    """The files beside the first output by what they are: report, page and the pictures of `CAPTIONS`."""
    if not (recipe.pictures and recipe.output):
        return {}
    first = Path(recipe.output[0])
    names = {"report": f"{first.stem}.json", "page": f"{first.stem}.html"}
    names |= {name: f"{first.stem}-{name}.png" for name in CAPTIONS if name != "input" or recipe.sketch}
    return {name: first.with_name(file) for name, file in names.items()}


def require_places(paths: Iterable[Path | str], inputs: Iterable[str] = ()) -> None:
    """Raise `InputError` for a path that could not be written after the work, or that is one of `inputs`.

    One missing folder is fine (it will be created), two are taken for a misspelt path.
    """
    seen: set[str] = set()
    given = {os.path.realpath(one): one for one in inputs if one and Path(one).exists()}
    for path in map(Path, paths):
        real = os.path.realpath(path)
        if real in seen:
            raise InputError(f"{path} would be written twice", "Give every output a name of its own.")
        if real in given:
            raise InputError(
                f"{path} would overwrite {given[real]}, which is read", "Choose another name with -o."
            )
        seen.add(real)
        _require_place(path)


def _require_place(path: Path) -> None:
    folder = path.parent
    try:
        if path.is_dir():
            raise InputError(
                f"cannot write {path}: there is a folder of that name", "Give the path of a file."
            )
        if folder.exists() and not folder.is_dir():
            raise InputError(f"cannot write {path}: {folder} is a file, not a folder", "Choose another path.")
        if not folder.exists() and not folder.parent.is_dir():
            raise InputError(
                f"cannot write {path}: the folder {folder.parent} does not exist",
                f"Create it first: mkdir -p {folder}",
            )
        exists, folder_exists = path.exists(), folder.exists()
    except (OSError, ValueError) as error:  # a name that is too long, or holds a zero byte
        reason = REASONS.get(getattr(error, "errno", None) or 0, (str(error), ""))[0]
        raise InputError(f"cannot write {str(path)!r}: {reason}", "Choose another path.") from error
    if exists and not os.access(path, os.W_OK):
        raise InputError(f"cannot write {path}: no permission to replace it", "Choose another name.")
    try:  # to ask for permission is not enough: disks are read-only, quotas used up
        with tempfile.TemporaryFile(dir=folder if folder_exists else folder.parent):
            pass
    except OSError as error:
        reason, step = REASONS.get(error.errno or 0, (error.strerror or str(error), "Choose another folder."))
        raise InputError(f"cannot write {path}: {reason}", step) from error


def require_outputs(recipe: Recipe, source: str = "") -> None:
    """Raise `InputError` when something of what `write_all` would write cannot be: ask before the long work.

    source : the recipe file, which must not be overwritten either.
    """
    for output in recipe.output:
        checked_extension(output)
    inputs = (recipe.sketch, recipe.guidance, recipe.body, recipe.printer, source)
    require_places([*recipe.output, *side_files(recipe).values()], inputs)


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
    files = (*recipe.output, *(str(path) for path in beside.values()))
    report = replace(made.report, files=files)
    pictures = _pictures(made, tell) if beside else {}
    thumbnail = png_bytes(scene_picture([Item(made.object)], VIEWS["three_quarter"], (512, 512)))
    title = recipe.title or Path(recipe.output[0]).stem
    carried = {key: value for key, value in report.to_dict().items() if key not in NOT_IN_3MF}

    on_bed, _ = onto_bed(made.object, made.profile)

    def output(path: str) -> None:
        # what goes to the slicer lies on the bed; what goes to a viewer or a modeller stays on the body
        write_mesh(
            path,
            on_bed if checked_extension(path) in (".3mf", ".stl") else made.object,
            title=title,
            metadata={
                "Description": f"{made.template.name.capitalize()} for {made.body.name}. {report.verdict}"
            },
            recipe=recipe_toml(recipe),
            report_json=json.dumps(carried, indent=2, ensure_ascii=False, allow_nan=False) + "\n",
            thumbnail_png=thumbnail,
        )

    def page(path: Path) -> None:
        thickness = made.inspection.thickness
        write_page(
            path,
            report.to_dict(),
            made.object,
            made.template.body.mesh,
            None if thickness is None else thickness.vertex_values(made.object),
            made.clearance_mm,
            {CAPTIONS[name]: png for name, png in pictures.items()},
            title,
            recipe_toml(recipe),
            wall_mm=made.template.wall_mm,
        )

    jobs: list[tuple[Path, Callable[[], object]]] = []
    for path in recipe.output:
        jobs.append((Path(path), functools.partial(output, path)))
    if beside:
        jobs.append((beside["report"], lambda: write_atomically(beside["report"], report.to_json().encode())))
        jobs.append((beside["page"], lambda: page(beside["page"])))
    for name, png in pictures.items():
        jobs.append((beside[name], functools.partial(write_atomically, beside[name], png)))
    write_together(jobs)
    return files


def write_together(jobs: list[tuple[Path, Callable[[], object]]]) -> None:
    """Run every job, which writes the file beside it; when one fails, what the others created goes again."""
    created: list[Path] = []
    folders: list[Path] = []
    try:
        for path, write in jobs:
            if not path.parent.exists():
                _created(path.parent)
                folders.append(path.parent)
            fresh = not os.path.lexists(path)
            write()
            if fresh:
                created.append(path)
    except BaseException:  # Ctrl-C too
        for path in created:
            with contextlib.suppress(OSError):
                path.unlink()
        for folder in folders:
            with contextlib.suppress(OSError):
                folder.rmdir()
        raise


def _created(folder: Path) -> None:
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        reason, step = REASONS.get(error.errno or 0, (str(error), "Choose another folder."))
        raise InputError(f"cannot create the folder {folder}: {reason}", step) from error


def _pictures(made: "Made", tell: Callable[[str, int, int], None] | None) -> dict[str, bytes]:
    """PNG bytes by the names of `CAPTIONS`."""
    worn = [Item(made.template.body.mesh, BODY, gloss=0.15), Item(made.object)]
    frame = head_frame(made.template.body, made.object)

    def on_body(view: str) -> np.ndarray:
        return scene_picture(worn, VIEWS[view], PORTRAIT, frame_on=frame)

    def drawing() -> np.ndarray:
        from fabcraft.guidance.show import picture_of

        assert made.drawing is not None
        return picture_of(made.drawing)

    painters: dict[str, Callable[[], np.ndarray]] = {
        "front": lambda: on_body("front"),
        "three-quarter": lambda: on_body("three_quarter"),
        "side": lambda: on_body("side"),
        "back": lambda: scene_picture([Item(made.object)], VIEWS["back"], PORTRAIT),
        "fit": lambda: penetration_map(
            made.object, made.clearance_mm, VIEWS["back"], BESIDE_BAR, limit_mm=FIT_LIMIT_MM
        ),
        "evolution": lambda: _evolution(made),
    }
    if made.drawing is not None:
        painters["input"] = drawing
    # two at a time: numpy and the rasteriser let go of the interpreter while they work
    pictures: dict[str, bytes] = {}
    with ThreadPoolExecutor(2) as pool:
        drawn = {name: pool.submit(paint) for name, paint in painters.items()}
        for name, future in drawn.items():
            _tell(tell, len(pictures), len(drawn))
            pictures[name] = png_bytes(future.result())
    _tell(tell, len(drawn), len(drawn))
    return pictures


def _tell(tell: Callable[[str, int, int], None] | None, step: int, steps: int) -> None:
    if tell is not None:
        tell("pictures", step, steps)


def head_frame(body: Body, object: Mesh | None = None) -> Mesh:
    """Points that fill a picture of the head: everything above the upper neck, and the object."""
    points = body.mesh.vertices[body.mesh.vertices[:, 2] > body.landmarks["menton"][2] - BELOW_CHIN_MM]
    if object is not None:
        points = np.concatenate([points, object.vertices])
    return Mesh(points, np.zeros((0, 3), dtype=np.int32))


def _evolution(made: "Made") -> np.ndarray:
    """The template, its way to the drawn outline, the fitted sheet and the object."""
    stages = dict(made.design.stages)
    names = list(stages)
    steps = [name for name in names if name.startswith("outline ")]
    kept = {"template": names[0]}
    kept |= {f"outline, step {name.split()[-1]}": name for name in steps[:2]}
    kept |= {"outline": "outline"} if "outline" in stages else {}
    kept |= {"relief, fitted to the body": names[-1]}
    meshes = [stages[name] for name in kept.values()]
    return evolution_strip([*meshes, made.object], [*kept, "object"], size=(420, 480))


def body_picture(body: Body) -> np.ndarray:
    """The head from the front and from its left, with a dot and a name at every landmark."""
    from fabcraft.write.sheet import contact_sheet

    return contact_sheet([_marked(body, view) for view in ("front", "side")], columns=2)


def _marked(body: Body, name: str) -> np.ndarray:
    """One view of the head; landmarks on its far side are left out."""
    from PIL import Image, ImageDraw, ImageFont

    head, size, view = head_frame(body), (1150, 1000), VIEWS[name]
    image = Image.fromarray(scene_picture([Item(body.mesh, BODY, gloss=0.15)], view, size, frame_on=head))
    towards = head.vertices @ view.axes[2]
    far = 0.5 * (towards.min() + towards.max()) - 0.1 * np.ptp(towards)
    near = {name: point for name, point in body.landmarks.items() if point @ view.axes[2] > far}
    camera = camera_for(view, body.mesh.vertices[np.unique(body.mesh.faces)], size, head)
    seen = camera.project(np.stack(list(near.values())))[:, :2]
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(16)
    rows = {True: 0.0, False: 0.0}
    for index in np.argsort(seen[:, 1], kind="stable"):
        label, (x, y) = list(near)[index], seen[index]
        right = bool(x >= size[0] / 2)
        row = rows[right] = max(float(y), rows[right] + 20.0)  # labels of near landmarks give way downwards
        edge = size[0] - 12.0 if right else 12.0
        start = edge - draw.textlength(label, font) - 8 if right else edge + draw.textlength(label, font) + 8
        draw.line([(x, y), (start, row)], fill=(128, 134, 142), width=1)
        draw.text((edge, row), label, (38, 42, 48), font, anchor="rm" if right else "lm")
        draw.ellipse((x - 4, y - 4, x + 4, y + 4), fill=(190, 38, 42), outline=(255, 255, 255))
    return np.asarray(image)
