"""`Recipe`: everything that decides one object, as flags, a TOML file or Python fill it.

Paths inside a recipe file are relative to that file, except `output`, which is relative to where the command runs.
Unknown keys are refused, so a misspelt one is never silently ignored.
"""

import difflib
import math
import re
import shlex
import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

import msgspec

from fabcraft.errors import InputError
from fabcraft.fit.presets import MOST_STEPS, baseline
from fabcraft.guidance.inflate import InflateSettings
from fabcraft.guidance.placement import PlacementSettings
from fabcraft.solid.plate_settings import PlateSettings
from fabcraft.template.kinds import is_own, known
from fabcraft.template.mask import WALL_MM
from fabcraft.template.own import OwnSettings
from fabcraft.write.threemf import read_recipe as carried_recipe

_FILES = (
    "template",
    "sketch",
    "guidance",
    "guidance_transform",
    "body",
    "body_landmarks",
    "contacts",
    "printer",
)
_FILE = "file:"
_OWN_FILES = ("transform", "landmarks", "locked")
"""Keys that may name files, of a recipe and of its table `own`."""


@dataclass(frozen=True)
class Recipe:
    """One object: what it is, what it looks like, who wears it and what prints it."""

    template: str = "mask"
    """Kind of wearable: mask, ring, bangle, necklace, glasses, visor, helmet or slippers; or a mesh file of your own."""
    parameters: dict[str, float | str] = field(default_factory=dict)
    """What is set of the template, by name (`fabcraft templates show NAME`): a number, or the name of a standard size."""
    reading: Literal["", "object", "motif"] = ""
    """What the drawing shows: the object itself, or a motif to be worked into it. A mask is drawn, others get a motif."""
    frame: str = ""
    """Place of the motif; the template's usual one when left out."""
    motif_mm: float = 0.0
    """Longer side of the motif; 0 is as large as its place."""
    sketch: str = ""
    """Picture of a line drawing: PNG, JPEG, WebP or SVG; or a photograph, see `foreground`."""
    foreground: Literal["", "auto", "alpha", "grabcut", "rembg"] = ""
    """The picture is a photograph or an illustration: how its object is told from the background. A line drawing when left
    out."""
    guidance: str = ""
    """Mesh to look like, instead of a sketch: STL, OBJ, PLY, GLB or 3MF of any size."""
    guidance_transform: str = ""
    """File of the 4 x 4 matrix that brings the mesh to the body's space, mm, as transform in .toml or .json; found when left
    out."""
    force: bool = False
    """Take a guidance mesh that resembles the template too little."""
    text: str = ""
    """What it should look like in words, instead of a sketch, such as "a cat with a star"."""
    via: Literal["", "clip", "picture", "subjects"] = ""
    """The road of a text: an encoder (`fabcraft weights`), a text-to-image back end, or the library of drawings (`fabcraft
    subjects`); the best that there is when left out."""
    encoder: str = ""
    """The encoder: a name from `fabcraft weights`, or a checkpoint with its config beside it."""
    image_to_3d: str = ""
    """What makes a mesh of the sketch, or of the picture of the text: NAME or NAME:ARGUMENT from `fabcraft backends`."""
    text_to_image: str = ""
    """What makes a picture of the text, over the sketch if there is one: NAME or NAME:ARGUMENT from `fabcraft backends`."""
    body: str = "man"
    """Who wears it: man, woman, teenager, child, toddler, a character (`fabcraft bodies`), or a scan (STL, OBJ, PLY,
    GLB, 3MF)."""
    height_mm: float = 0.0
    """Height of a character; 0 is its own."""
    contacts: str = ""
    """File of contacts, where it shall rest or keep away besides the template's own: .toml or .json."""
    body_units: Literal["", "mm", "cm", "m", "in"] = ""
    """Unit of a scan; proposed from its size when left out."""
    body_kind: str = ""
    """What a scan shows: head, hand, foot or body; found when left out."""
    body_up: str = ""
    """Axis of a scan's file to the top of the head or leg, or out of the back of the hand: x, -x, ...; found if left out."""
    body_front: str = ""
    """Axis of a scan's file that the face or toes look along, or that the fingers point along; found when left out."""
    body_landmarks: str = ""
    """File of a scan's landmarks, name to x, y, z in the scan's own unit and frame: JSON, TOML or CSV."""
    measures: dict[str, float | str] = field(default_factory=dict)
    """What the wearer measures: mm, or a size of a standard such as "US7" for ring_finger; see `fabcraft bodies show`."""
    printer: str = "prusa-mk4"
    """Printer profile: a name from `fabcraft printers`, or a TOML file."""
    output: tuple[str, ...] = ()
    """Files to write; the extension chooses the format: .3mf, .stl, .glb or .ply. The report, the page and the pictures
    go beside the first."""
    preset: Literal["draft", "standard"] = "standard"
    """How patiently to fit and how finely to build."""
    steps: int = 0
    """Steps of a fit towards a guidance mesh or a text; 0 is the preset's."""
    method: str = ""
    """A method to compare with (`fabcraft evaluate`): direct, template, guidance, guidance+body, no-body-loss, ...; what
    fabcraft does when left out."""
    seed: int = 0
    """Of everything random."""
    device: Literal["", "cpu", "cuda", "auto"] = ""
    """Where the fit is computed; left out: on a graphics card, if there is one, where that is faster."""
    wall_mm: float = 0.0
    """Wall thickness; 0 is the template's own, or the printer's if that is more."""
    strap_slots: bool = True
    """Cut a slot for a band on each side, where there is room."""
    title: str = ""
    """What slicers and the page call it; the output's name when left out."""
    pictures: bool = True
    """Also write the page, the report and the pictures."""
    own: OwnSettings = field(default_factory=OwnSettings)
    placement: PlacementSettings = field(default_factory=PlacementSettings)
    inflate: InflateSettings = field(default_factory=InflateSettings)
    plate: PlateSettings = field(default_factory=PlateSettings)

    @property
    def mesh_wanted(self) -> bool:
        """Whether a back end makes a mesh of the picture; otherwise the picture is read as a drawing."""
        return self.image_to_3d not in ("", "inflate")

    @property
    def mesh_file(self) -> str:
        """The file of the back end `file:MESH`, or nothing."""
        return self.image_to_3d.removeprefix(_FILE) if self.image_to_3d.startswith(_FILE) else ""

    def __post_init__(self) -> None:
        if isinstance(self.output, str):
            object.__setattr__(self, "output", (self.output,))
        if not is_own(self.template):
            known(self.template)
            if said := self.own.said:
                raise InputError(
                    f"{said[0]} was given for the {self.template}, which is a built-in template",
                    "It is for a mesh file of your own: fabcraft make FILE.stl ...",
                )
        if (self.guidance_transform or self.force) and not self.guidance:
            what = "a guidance transform" if self.guidance_transform else "force"
            raise InputError(
                f"{what} was given without a guidance mesh", "Give --guidance MESH, or leave it out."
            )
        if self.preset not in (presets := ("draft", "standard")):
            raise InputError(f"preset '{self.preset}' was asked", f"Choose one of: {', '.join(presets)}.")
        if self.method not in ("", "direct"):
            baseline(self.method)
        if not 0 <= self.steps <= MOST_STEPS:
            raise InputError(
                f"{self.steps} steps were asked", f"Choose 1 to {MOST_STEPS}, or 0 for the preset's."
            )
        if self.wall_mm and not WALL_MM[0] <= self.wall_mm <= WALL_MM[1]:
            raise InputError(
                f"a wall of {self.wall_mm} mm was asked",
                f"Choose between {WALL_MM[0]:g} and {WALL_MM[1]:g} mm.",
            )
        for table in (self.placement, self.inflate):
            for entry in fields(table):
                if not math.isfinite(value := getattr(table, entry.name)):
                    raise InputError(
                        f"{entry.name} is {value}, which is not a finite number", "Give one such as 1.5."
                    )


def is_recipe(what: str) -> bool:
    """Whether `what` names a recipe: a TOML file, or a 3MF that carries one."""
    kind = Path(what).suffix.lower()
    return kind == ".toml" or (kind == ".3mf" and Path(what).is_file() and carried_recipe(what) is not None)


def read_recipe(path: Path | str) -> Recipe:
    """The recipe in a TOML file, or the one that a 3MF of ours carries; that one is without its output.

    Raises `InputError` for a file that cannot be read, an unknown key, a value of the wrong kind, and a 3MF without one.
    """
    path = Path(path)
    carried = path.suffix.lower() == ".3mf"
    table = _carried(path) if carried else _toml(path)
    recipe = recipe_of(table, str(path))
    own = replace(recipe.own, **_beside(path.parent, recipe.own, _OWN_FILES))
    names = _FILES if is_own(recipe.template) else _FILES[1:]
    recipe = replace(recipe, own=own, **_beside(path.parent, recipe, names))
    return replace(recipe, output=()) if carried else recipe


def _toml(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > 1_000_000:
            raise InputError(
                f"{path} is {path.stat().st_size:,} bytes; a recipe has a few hundred", "Check the path."
            )
        return tomllib.loads(path.read_text("utf-8"))
    except IsADirectoryError:
        raise InputError(f"{path} is a folder; a recipe file was expected", "Give a .toml file.") from None
    except FileNotFoundError:
        raise InputError(f"there is no recipe {path}", "Check the path.") from None
    except UnicodeDecodeError:
        raise InputError(f"{path} is not text; a recipe in TOML was expected", "Give a .toml file.") from None
    except OSError as error:
        raise InputError(
            f"{path} cannot be read: {error.strerror}", "Check the path and its permissions."
        ) from None
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(f"{path} is not valid TOML: {error}", "Mend the line named.") from None


def _carried(path: Path) -> dict[str, Any]:
    text = carried_recipe(path)
    if text is None:
        raise InputError(f"{path} carries no recipe", "Give a 3MF that fabcraft made, or a .toml file.")
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(f"the recipe in {path} is not valid TOML: {error}", "Make the 3MF again.") from None


def require_inputs(path: Path | str, recipe: Recipe) -> None:
    """Raise `InputError` when a file of the recipe that the 3MF at `path` carries is neither beside it nor here."""
    own = recipe.own
    always = {
        name: getattr(recipe, name) for name in ("sketch", "guidance", "guidance_transform", "contacts")
    }
    always["body_landmarks"] = recipe.body_landmarks
    always |= {f"own.{name}": getattr(own, name) for name in ("transform", "landmarks")}
    # a body, a printer or a template may be a name as well
    named = ("template", "body", "printer")
    always |= {name: getattr(recipe, name) for name in named if Path(getattr(recipe, name)).suffix}
    for name, file in always.items():
        if file and not Path(file).is_file():
            raise InputError(
                f"the recipe in {path} needs the file {file} ({name}), which is neither beside it nor here",
                "A 3MF carries the names of its inputs, not the files: put the file beside the 3MF.",
            )


def _beside(folder: Path, table: Recipe | OwnSettings, names: tuple[str, ...]) -> dict[str, Any]:
    """The files named in `table` that lie in `folder`, by key."""
    said = {name: folder / getattr(table, name) for name in names if getattr(table, name)}
    found = {name: str(path) for name, path in said.items() if path.is_file()}
    if (
        isinstance(table, Recipe)
        and table.image_to_3d.startswith(_FILE)
        and (folder / table.mesh_file).is_file()
    ):
        found["image_to_3d"] = f"{_FILE}{folder / table.mesh_file}"
    return found


def _travelling(asked: str) -> str:
    """A back end as it is written down: the files that its argument names without their folders."""
    name, colon, argument = asked.partition(":")
    if name == "diffusers":
        argument = "#".join(_bare(one) if Path(one).is_absolute() else one for one in argument.split("#"))
    elif name == "file":
        argument = _bare(argument)
    elif name == "command":
        try:
            argument = shlex.join(map(_bare, shlex.split(argument)))
        except ValueError:
            argument = ""
    return f"{name}{colon}{argument}"


def _bare(word: str) -> str:
    """A path, or that after an =, without its folders; an address as it is."""
    before, equals, path = word.rpartition("=")
    return word if "://" in word else f"{before}{equals}{Path(path).name}"


def recipe_of(table: Mapping[str, Any], source: str = "the recipe") -> Recipe:
    """A recipe from nested plain values.  Raises `InputError` naming the key that does not fit."""
    refuse_unknown(Recipe, table, source)
    if isinstance(table.get("output"), str):
        table = {**table, "output": [table["output"]]}
    try:
        return msgspec.convert(dict(table), Recipe)
    except msgspec.ValidationError as error:
        raise InputError(
            f"{source}: {_plain(str(error))}",
            "Mend that value; `fabcraft make --help` tells what each one takes.",
        ) from None


def _plain(message: str) -> str:
    """msgspec's message with the key first and, for a choice, what there is to choose from."""
    parts = re.fullmatch(r"(?P<what>.*?)(?: - at `\$\.?(?P<key>.*)`)?", message, re.DOTALL)
    if parts is None or not parts["key"]:
        return message
    choices = next((get_args(entry.type) for entry in fields(Recipe) if entry.name == parts["key"]), ())
    said = ", ".join(repr(one) for one in choices if isinstance(one, str) and one)
    what = parts["what"][:1].lower() + parts["what"][1:].replace("`", "")
    return f"{parts['key']}: {what}" + (f"; expected {said}" if said else "")


def refuse_unknown(kind: type, table: Mapping[str, Any], source: str, prefix: str = "") -> None:
    """Raise `InputError` for a key of `table` that the dataclass has not, with the nearest one that it has."""
    known = {entry.name: entry for entry in fields(kind)}
    for key, value in table.items():
        if key not in known:
            close = difflib.get_close_matches(key, known, n=1)
            hint = f"Did you mean {prefix}{close[0]}?" if close else f"Known: {', '.join(known)}."
            raise InputError(f"{source}: unknown key {prefix}{key}", hint)
        factory = known[key].default_factory
        if factory is not MISSING and is_dataclass(factory) and isinstance(value, Mapping):
            refuse_unknown(factory, value, source, f"{prefix}{key}.")


def recipe_toml(recipe: Recipe) -> str:
    """The recipe as TOML, only what differs from the defaults; file names without their folders."""

    def text(value: Any) -> str:
        if isinstance(value, bool):
            return "true" if value else "false"
        if isinstance(value, tuple):
            return "[" + ", ".join(text(one) for one in value) + "]"
        # a JSON string or number is a TOML one, but for the control character that JSON leaves bare
        return msgspec.json.encode(value).decode().replace("\x7f", "\\u007f")

    lines, tables = [], []
    for entry in fields(recipe):
        value = getattr(recipe, entry.name)
        if is_dataclass(value):
            if isinstance(value, OwnSettings):
                bare: dict[str, Any] = {name: Path(getattr(value, name)).name for name in _OWN_FILES}
                value = replace(value, **bare)
            inner = [
                f"{one.name} = {text(getattr(value, one.name))}"
                for one in fields(value)
                if getattr(value, one.name) != one.default
            ]
            if inner:
                tables += ["", f"[{entry.name}]", *inner]
        elif isinstance(value, Mapping):
            if value:
                inner = [f"{text(str(key))} = {text(one)}" for key, one in value.items()]
                tables += ["", f"[{entry.name}]", *inner]
        elif value != entry.default or entry.name in ("template", "body", "printer", "preset", "seed"):
            if entry.name in _FILES:
                value = Path(value).name  # a recipe that travels must not tell where a user keeps their files
            if entry.name in ("image_to_3d", "text_to_image"):
                value = _travelling(value)
            if entry.name == "output":
                value = tuple(Path(one).name for one in value)
            lines.append(f"{entry.name} = {text(value)}")
    return "\n".join(lines + tables) + "\n"
