"""Back ends by name: fabcraft's own, and those that other packages offer in the same entry-point groups.

A package adds one with `[project.entry-points."fabcraft.image_to_3d"]` and `name = "module:Class"` (or
`"fabcraft.text_to_image"`), the class being a `Backend`.  Its own are listed here, not in the package's metadata, so that
a checkout finds them before it is installed again; they cannot be taken over by another package.
"""

from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Literal

from fabcraft.backends.backend import Backend
from fabcraft.errors import InputError, MissingError

Group = Literal["image_to_3d", "text_to_image"]
BUILT_IN = "inflate"
"""The road from a drawing to a relief that needs no back end."""
_OWN = {
    "image_to_3d": {
        "file": "fabcraft.backends.file:File",
        "gradio": "fabcraft.backends.gradio:Gradio",
        "tripo": "fabcraft.backends.tripo:Tripo",
        "command": "fabcraft.backends.command:MeshCommand",
    },
    "text_to_image": {
        "diffusers": "fabcraft.backends.diffusion:Diffusion",
        "openai": "fabcraft.backends.openai:OpenAI",
        "command": "fabcraft.backends.command:PictureCommand",
    },
}


@dataclass(frozen=True)
class Listed:
    """A back end as `fabcraft backends` shows it."""

    group: str
    name: str
    about: str
    usage: str
    lacks: str
    """What is missing on this machine; nothing when it can be used."""
    next_step: str


def backend(group: Group, asked: str) -> tuple[str, Backend]:
    """(name, back end) of `NAME[:argument]`.

    Raises `InputError` for an unknown name or an argument of no use, `MissingError` with the command that gets what is
    missing on this machine.
    """
    name, _, argument = asked.partition(":")
    points = _points(group)
    if name not in points:
        known = [BUILT_IN, *points] if group == "image_to_3d" else list(points)
        raise InputError(
            f"there is no back end {name[:60]!r} for {_flag(group)}", f"There are: {', '.join(known)}."
        )
    kind = _loaded(points[name])
    made = kind(argument)
    if lacking := kind.lacks():
        raise lacking
    return name, made


def listed() -> list[Listed]:
    """All back ends, and whether they can be used here.  Uses no network."""
    rows = [Listed("image_to_3d", BUILT_IN, "the drawing becomes a relief; the default", BUILT_IN, "", "")]
    for group in ("image_to_3d", "text_to_image"):
        for name, point in _points(group).items():
            try:
                kind = _loaded(point)
                lacking = kind.lacks()
                about, usage = kind.about, kind.usage
            except MissingError as error:
                about, usage, lacking = point.value, name, error
            rows.append(
                Listed(
                    group,
                    name,
                    about,
                    usage,
                    lacking.message if lacking else "",
                    lacking.next_step if lacking else "",
                )
            )
    return rows


def _flag(group: str) -> str:
    return f"--{group.replace('_', '-')}"


def _points(group: str) -> dict[str, EntryPoint]:
    own = {name: EntryPoint(name, value, f"fabcraft.{group}") for name, value in _OWN[group].items()}
    others = {point.name: point for point in sorted(entry_points(group=f"fabcraft.{group}"))}
    return own | {name: point for name, point in others.items() if name not in own and name != BUILT_IN}


def _loaded(point: EntryPoint) -> Any:
    """The class of a `Backend`.  Raises `MissingError` for a package that is broken, or offers something else."""
    try:
        found = point.load()
    except Exception as error:  # another package's code
        raise MissingError(
            f"the back end {point.name} ({point.value}) cannot be loaded: {type(error).__name__}: {error}",
            "Install that package again, or remove it.",
        ) from error
    missing = [
        part for part in ("about", "usage", "lacks", "terms", "key", "make") if not hasattr(found, part)
    ]
    if missing:
        raise MissingError(
            f"the back end {point.name} ({point.value}) has no {missing[0]}",
            "It was made for another version of fabcraft: install it again, or remove it.",
        )
    return found
