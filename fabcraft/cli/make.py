"""`fabcraft make`: a recipe, from flags or a file, becomes an object with its report, page and pictures."""

import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from fabcraft.cli.backends import consent
from fabcraft.cli.console import Progress, result, say, show_report
from fabcraft.cli.own import NOTHING, OwnFlags
from fabcraft.cli.plate import AS_IT_IS, PlateFlags
from fabcraft.cli.slicing import UNSLICED, SliceFlags
from fabcraft.cli.wearer import Units
from fabcraft.errors import InputError
from fabcraft.template.kinds import is_own, known

if TYPE_CHECKING:
    from fabcraft.recipe import Recipe


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Flags:
    """What can be said about an object; what is left out is the recipe file's, or the default."""

    sketch: str | None = None
    """Picture of a line drawing: PNG, JPEG, WebP or SVG; or a photograph, with --foreground."""
    foreground: Literal["auto", "alpha", "grabcut", "rembg"] | None = None
    """The picture is a photograph or an illustration: how its object is told from the background. [default: a drawing]"""
    guidance: str | None = None
    """Mesh to look like, instead of a sketch: STL, OBJ, PLY, GLB or 3MF of any size."""
    guidance_transform: str | None = None
    """Where that mesh lies: its 4 x 4 matrix to the body's space, mm, as transform in a .toml or .json file.
    [default: found]"""
    force: Annotated[bool | None, Parameter(negative="", show_default=False)] = None
    """Take the mesh although it resembles the template too little. [default: no]"""
    text: str | None = None
    """What it should look like in words, instead of a sketch, such as "a cat with a star" (fabcraft subjects)."""
    via: Literal["clip", "picture", "subjects"] | None = None
    """The road of --text: an encoder (fabcraft weights), a text-to-image back end, or the library of drawings.
    [default: the best that there is]"""
    encoder: str | None = None
    """The encoder of --text: a name from fabcraft weights, or a checkpoint with its config beside it."""
    image_to_3d: str | None = None
    """What makes a mesh of the sketch, to look like that: NAME or NAME:ARGUMENT from fabcraft backends. [default: inflate,
    the drawing becomes a relief]"""
    text_to_image: str | None = None
    """What makes a picture of --text, over the sketch if there is one: NAME or NAME:ARGUMENT from fabcraft backends."""
    set: Annotated[tuple[str, ...], Parameter(show_default=False, negative=())] = ()
    """A parameter of the template as name=value, again for more: width=6, size="US 7" (see fabcraft templates show)."""
    reading: Annotated[Literal["object", "motif"] | None, Parameter(name="--as")] = None
    """What the drawing shows: the object, or a motif to be worked into it. [default: a mask the object, others a motif]"""
    frame: str | None = None
    """Place of the motif. [default: the template's usual one]"""
    motif_size: float | None = None
    """Longer side of the motif in mm. [default: as large as its place]"""
    body: str | None = None
    """Who wears it: man, woman, teenager, child, toddler, a character (fabcraft bodies), or the file of a scan.
    [default: man]"""
    height: float | None = None
    """Height of a character in mm. [default: its own, a desk toy's]"""
    contacts: str | None = None
    """File of contacts, where it shall rest or keep away besides the template's own: .toml or .json."""
    measure: Annotated[tuple[str, ...], Parameter(show_default=False, negative=())] = ()
    """What the wearer measures, again for more: wrist=158 in mm, or a size: ring_finger=US7, foot=EU42,
    head=hat58."""
    body_units: Units | None = None
    """Unit of the scan; proposed from its size when left out."""
    body_kind: str | None = None
    """What the scan shows: head, hand, foot or body. [default: found]"""
    body_up: str | None = None
    """Axis of the scan's file that points up: x, y, z, -x, -y or -z. [default: found]"""
    body_front: str | None = None
    """Axis of the scan's file that the face, toes or fingers point along. [default: found]"""
    body_landmarks: str | None = None
    """File of the scan's landmarks, name to x, y, z: JSON, TOML or CSV."""
    printer: str | None = None
    """Printer profile: a name from `fabcraft printers`, or a TOML file. [default: prusa-mk4]"""
    output: Annotated[
        tuple[str, ...], Parameter(name=("--output", "-o"), show_default=False, negative=())
    ] = ()
    """File to write, again for more: .3mf, .stl, .glb or .ply. Report, page and pictures go beside the
    first."""
    preset: Literal["draft", "standard"] | None = None
    """How patiently to fit and how finely to build. [default: standard]"""
    seed: int | None = None
    """Of everything random. [default: 0]"""
    device: Literal["cpu", "cuda", "auto"] | None = None
    """Where the fit is computed. [default: on a graphics card, if there is one, where that is faster]"""
    wall: float | None = None
    """Wall thickness in mm. [default: the template's, or the printer's if that is more]"""
    title: str | None = None
    """What slicers and the page call it. [default: the output's name]"""
    scale: float | None = None
    """Size of the drawing over the size that fabcraft would choose (0.5-2)."""
    up: float | None = None
    """Shift of the drawing upwards, mm."""
    left: float | None = None
    """Shift of the drawing towards the wearer's left, mm."""
    swell: float | None = None
    """Height of the cushion that the drawing becomes over its half width; 0 is flat. [default: 0.26]"""
    swell_limit: float | None = None
    """The cushion stays lower than this, mm. [default: 11]"""
    stroke_height: float | None = None
    """Height of the beads that strokes become, mm. [default: 1.2]"""
    stroke_width: float | None = None
    """Least width of a bead, mm. [default: 1.8]"""
    region_height: float | None = None
    """Height of the cushion that a drawn region (a nose) becomes, mm. [default: 2.2]"""
    rim_height: float | None = None
    """Height of the bead along the outline and around the openings, mm; 0 for none. [default: 0.8]"""
    shade_height: float | None = None
    """How far the light parts of a photograph stand out, mm; 0 ignores its shading. [default: 1.6]"""
    strap_slots: Annotated[bool | None, Parameter(negative="--no-strap-slots", show_default=False)] = None
    """Cut a slot beside each eye for an elastic band. [default: yes]"""
    pictures: Annotated[bool | None, Parameter(negative="--no-pictures", show_default=False)] = None
    """Also write the report, the page and the pictures. [default: yes]"""


_NO_FLAGS = Flags()
_PLACES = {
    "wall": ("", "wall_mm"),
    "motif_size": ("", "motif_mm"),
    "height": ("", "height_mm"),
    "scale": ("placement", "scale"),
    "up": ("placement", "up_mm"),
    "left": ("placement", "left_mm"),
    "swell": ("inflate", "swell"),
    "swell_limit": ("inflate", "swell_limit_mm"),
    "stroke_height": ("inflate", "stroke_height_mm"),
    "stroke_width": ("inflate", "stroke_width_mm"),
    "region_height": ("inflate", "region_height_mm"),
    "rim_height": ("inflate", "rim_height_mm"),
    "shade_height": ("inflate", "shade_height_mm"),
}
"""Flags that have another name, or live in a table, in a recipe."""


def make(
    what: str,
    /,
    *,
    flags: Flags = _NO_FLAGS,
    own: OwnFlags = NOTHING,
    slicing: SliceFlags = UNSLICED,
    plate: PlateFlags = AS_IT_IS,
    yes: bool = False,
    json: bool = False,
    quiet: bool = False,
) -> int:
    """Make a wearable from a drawing (or a mesh to look like), a body and a printer.

    Examples:

      fabcraft make mask --sketch cat.png --body woman -o cat.3mf
      fabcraft make mask --sketch cat.png --preset draft -o cat.3mf -o cat.stl
      fabcraft make mask --sketch cat.png --body woman --measure head=hat57 -o cat.3mf
      fabcraft make mask --text "a mask that looks like a cat" -o cat.3mf
      fabcraft make mask --guidance bust.stl --printer form4 -o bust.3mf
      fabcraft make mask --sketch cat.png --image-to-3d gradio:http://127.0.0.1:7860 -o cat.3mf
      fabcraft make my-visor.stl --like visor --sketch star.png -o star.3mf
      fabcraft make cat.toml --wall 3
      fabcraft make cat.3mf --body child -o small.3mf

    Ctrl-C while it fits keeps the best so far and writes that.

    Parameters
    ----------
    what
        A template (see fabcraft templates), the mesh file of your own one, or a recipe whose settings any flag overrides: a
        .toml file, or a 3MF that fabcraft made, which carries one.
    yes
        Agree to what a back end costs, sends away or binds to, without being asked.
    json
        Print the report as JSON, and nothing else, on stdout.
    quiet
        No progress on stderr.
    """
    recipe = recipe_from(what, flags, own, plate)
    if not recipe.output:
        raise InputError("no output was named", "Give -o OUT.3mf, for example -o cat.3mf.")
    from fabcraft.outputs import inputs_of, outputs_of, require_outputs, write_all
    from fabcraft.recipe import is_recipe

    require_outputs(recipe, what if is_recipe(what) else "")
    if slicing != UNSLICED:
        from fabcraft.profile import load_profile

        source = what if is_recipe(what) else ""
        slicing.require(load_profile(recipe.printer), outputs_of(recipe), inputs_of(recipe, source))
    from fabcraft import pipeline

    with Progress(quiet) as progress:
        typed = frozenset(key for key in ("image_to_3d", "text_to_image") if getattr(flags, key) is not None)
        made = pipeline.make(recipe, progress.tell, consent(yes, typed, progress.paused))
        if slicing.slice:
            progress.tell("slice", 0, 1)
        made = replace(made, report=slicing.told(made.report, made.on_bed, made.profile))
        report = replace(made.report, files=write_all(made, progress.tell))
    if made.interrupted:
        say("interrupted: the best so far was written")
    if json:
        result(report.to_json().rstrip("\n"))
    else:
        show_report(report, made.profile.title)
    return 130 if made.interrupted else int(not report.printable)


def recipe_from(what: str, flags: Flags, own: OwnFlags = NOTHING, plate: PlateFlags = AS_IT_IS) -> "Recipe":
    """The recipe of a template's name, its mesh file or a recipe file, with the flags over it.

    Raises `InputError` for an unknown template, an unreadable recipe, or a number that is none.
    """
    from fabcraft.recipe import Recipe, is_recipe, read_recipe, require_inputs

    repeats = is_recipe(what) and not (own.given() and Path(what).suffix.lower() == ".3mf")
    if not (repeats or is_own(what)):
        known(what)
    given = {key: value for key, value in asdict(flags).items() if value is not None and value != ()}
    for key, value in given.items():
        if isinstance(value, float) and not math.isfinite(value):
            raise InputError(
                f"--{key.replace('_', '-')} {value} is not a finite number", "Give a number such as 1.5."
            )
    from fabcraft.body.sizes import parse

    recipe = read_recipe(what) if repeats else Recipe(template=what)
    inputs = [name for name in ("sketch", "guidance", "text") if name in given]
    fresh: dict[str, Any] = {"guidance_transform": "", "force": False}
    if inputs == ["guidance"]:  # it takes the place of the file's own, and of what would have made one
        given = {
            "sketch": "",
            "text": "",
            "via": "",
            "image_to_3d": "",
            "text_to_image": "",
            **fresh,
            **given,
        }
    elif len(inputs) == 1 and not given.get("text_to_image", recipe.text_to_image):
        via = {} if "text" in given else {"via": ""}
        given = {"sketch": "", "guidance": "", "text": "", **via, **fresh, **given}
    if "set" in given:
        given["parameters"] = {**recipe.parameters, **dict(setting(text) for text in given.pop("set"))}
    tables: dict[str, dict[str, Any]] = {"own": own.given(), "plate": plate.given()}
    for flag, value in given.items():
        table, key = _PLACES.get(flag, ("", flag))
        tables.setdefault(table, {})[key] = value
    changes = tables.pop("", {})
    if "measure" in changes:
        changes["measures"] = {**recipe.measures, **parse(changes.pop("measure"))}
    changes |= {table: replace(getattr(recipe, table), **values) for table, values in tables.items()}
    recipe = replace(recipe, **changes)
    if repeats and Path(what).suffix.lower() == ".3mf":
        require_inputs(what, recipe)
    return recipe


def setting(text: str) -> tuple[str, float | str]:
    """name=value as (name, number or word).  Raises `InputError` for anything else."""
    name, equals, value = text.partition("=")
    if not (name.strip() and equals and value.strip()):
        raise InputError(
            f"--set {text} was given; name=value was expected", "Give for example --set width=6."
        )
    try:
        number = float(value)
    except ValueError:
        return name.strip(), value.strip()
    if not math.isfinite(number):
        raise InputError(f"--set {text} is not a finite number", "Give a number such as 6.")
    return name.strip(), number
