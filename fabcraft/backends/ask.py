"""A recipe that names back ends becomes one without: words become a picture, a picture becomes a mesh.

What they answered is looked at, kept by what was asked, and goes on as the recipe's own sketch or guidance mesh.  The
user hears what a call costs and where things go before it is made, and only when one is made: an answer that is kept is
used without a word to anybody.
"""

import hashlib
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fabcraft.backends import cache
from fabcraft.backends.answer import MESHES, PICTURES, checked_mesh, checked_picture
from fabcraft.backends.backend import Request, Terms
from fabcraft.backends.registry import Group, backend
from fabcraft.errors import InputError
from fabcraft.read.image_file import read_image
from fabcraft.recipe import Recipe
from fabcraft.write.picture import png_bytes

Consent = Callable[[Group, str, Terms], None]
"""Called with the kind of back end, its name and its terms before a call; raises `InputError` to have none."""
Tell = Callable[[str, int, int], None]

DRAWN = "{}, simple black line drawing on white, bold closed outline, symmetric front view, nothing else"
SHOWN = "{}, a single object, front view, centred, plain white background, soft even light"
"""What is asked of a picture that will be read as a drawing, and of one that will become a mesh."""


MOST_LETTERS = 2000
"""Of a text that is sent to a back end."""


@dataclass(frozen=True)
class Answered:
    """What has become of a recipe."""

    recipe: Recipe
    """It names no back end, but the files that they made."""
    route: tuple[str, ...] = ()


def refuse(group: Group, name: str, terms: Terms) -> None:
    """The consent of nobody: only what needs none is called."""
    if terms.ask != "never":
        raise InputError(
            f"the back end {name} needs a yes: {'; '.join(terms.said)}",
            "Give consent (--yes on the command line).",
        )


def agree(group: Group, name: str, terms: Terms) -> None:
    """The consent of someone who has read the terms."""


def answered(recipe: Recipe, consent: Consent = refuse, tell: Tell | None = None) -> Answered:
    """Call the recipe's back ends, or take what they answered before.

    Raises `InputError` for a recipe that gives them nothing to work on, for an answer of no use and for want of
    consent; `MissingError` for what is not installed, not set, not running or too busy.
    """
    require_sense(recipe)
    route: list[str] = []
    if recipe.text_to_image:
        style = SHOWN if recipe.mesh_wanted else DRAWN
        picture = _picture(recipe.sketch) if recipe.sketch else b""
        request = Request(picture, style.format(recipe.text), recipe.seed)
        path, line = _called("text_to_image", recipe.text_to_image, request, consent, tell)
        over = f" over the sketch {Path(recipe.sketch).name}" if recipe.sketch else ""
        route.append(f'picture of "{recipe.text}"{over} by {line}')
        recipe = replace(recipe, text="", via="", text_to_image="", sketch=str(path))
    if recipe.mesh_wanted:
        request = Request(_picture(recipe.sketch), seed=recipe.seed)
        path, line = _called("image_to_3d", recipe.image_to_3d, request, consent, tell)
        route.append(f"mesh of {Path(recipe.sketch).name} by {line}")
        recipe = replace(recipe, sketch="", guidance=str(path))
    return Answered(replace(recipe, image_to_3d=""), tuple(route))


def require_sense(recipe: Recipe) -> None:
    """Raise `InputError` unless the recipe's back ends have something to work on."""
    if recipe.text_to_image and not recipe.text:
        raise InputError("--text-to-image was given without words", 'Give --text "WORDS" as well.')
    if recipe.text_to_image and (len(recipe.text) > MOST_LETTERS or not _is_plain(recipe.text)):
        raise InputError(
            f"the text has {len(recipe.text):,} characters, or some that cannot be written",
            f"Give at most {MOST_LETTERS:,} letters in a line.",
        )
    if recipe.text_to_image and (recipe.encoder or recipe.via not in ("", "picture")):
        other = f"--via {recipe.via}" if recipe.via else f"the encoder {recipe.encoder}"
        raise InputError(f"both --text-to-image and {other} were given", "Leave one of them out.")
    if recipe.mesh_wanted and not (recipe.sketch or recipe.text_to_image):
        raise InputError(
            "--image-to-3d was given without a picture",
            "Give --sketch FILE, or --text WORDS with --text-to-image NAME.",
        )
    if (recipe.mesh_wanted or recipe.text_to_image) and recipe.guidance:
        raise InputError(
            f"both a back end and the guidance mesh {Path(recipe.guidance).name} were given",
            "Leave one of them out.",
        )


def _is_plain(text: str) -> bool:
    """Without control characters and halves of characters, which no service takes."""
    return not any(unicodedata.category(letter) in ("Cc", "Cs") for letter in text.strip())


def _called(
    group: Group, asked: str, request: Request, consent: Consent, tell: Tell | None
) -> tuple[Path, str]:
    """(the answer's file, back end and content in words)."""
    name, made = backend(group, asked)
    kept = cache.name_of(name, made.key(), request)
    path = cache.found(kept, MESHES if group == "image_to_3d" else PICTURES)
    how = "kept from an earlier run"
    if path is None:
        how = "asked for now"
        consent(group, name, made.terms(request))
        answer = made.make(
            request, lambda done, of: tell(f"ask: {name}", done, of) if tell is not None else None
        )
        ending = (checked_mesh if group == "image_to_3d" else checked_picture)(answer, name)
        path = cache.kept(kept, ending, answer.data)
    content = hashlib.sha256(path.read_bytes()).hexdigest()[:12]
    where = "".join(f", {value}" for key, value in made.key().items() if key in ("url", "model"))
    return path, f"{name}{where} ({how}, sha256 {content})"


def _picture(path: str) -> bytes:
    """The picture as it is sent: upright, on white, as large as it is read, and without what a camera wrote into it."""
    rgba = read_image(path).astype(np.float64)
    alpha = rgba[:, :, 3:] / 255.0
    return png_bytes(np.rint(rgba[:, :, :3] * alpha + 255.0 * (1.0 - alpha)).astype(np.uint8))
