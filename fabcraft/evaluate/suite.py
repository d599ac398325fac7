"""The designs, wearers and methods that are compared, as plain tables.

Every category and prompt of the paper is there. Nobody is compared on the body that the guidance was made for: the
guidance mesh of a design is its drawing, made an object for another person, as an image-to-3D model would hand one over
that knows nothing of the wearer.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal

import fabcraft
from fabcraft.errors import InputError, MissingError
from fabcraft.fit.presets import BASELINES, LOSSES

METHODS = (*BASELINES, "direct")
"""The rows of the table."""
TEXT_METHODS = tuple(name for name, (_, guided, _) in BASELINES.items() if guided == "text")
"""The rows that need an encoder's weights."""
ABLATION = tuple(f"loss-{name}" for name in LOSSES)
"""The paper's ablation of the body's terms, for a figure."""
WORDS = {
    "template": "template",
    "guidance": "guidance",
    "guidance+body": "guidance + body",
    "no-body-loss": "no body loss",
    "ours": "ours",
    "textdeformer": "TextDeformer",
    "body-aware-textdeformer": "body-aware TextDeformer",
    "direct": "direct",
    "loss-none": "neither term",
    "loss-contact": "contact only",
    "loss-penetration": "penetration only",
    "loss-both": "both terms",
}
"""Methods as people write them."""


@dataclass(frozen=True)
class Design:
    """One thing to be made for somebody."""

    name: str
    template: str
    prompt: str
    """For the methods that read words, and for the score of the encoder."""
    example: str = ""
    """Its drawing, a file in the folder `examples` of the repository; that of the prompt in the library when left out."""
    body: str = "man"
    """Who wears it."""
    made_for: str = "woman"
    """Whose body the guidance mesh is made for."""
    reading: Literal["", "object", "motif"] = ""
    scale: float = 1.0
    """Of the drawing on the guidance mesh: a wall that is thick enough to bend well needs more room around the eyes."""
    shape: Literal["", "thin bangle", "closed helmet"] = ""
    """A guidance mesh that is no drawing: what a refinement of the guidance alone cannot mend."""

    @property
    def title(self) -> str:
        """As people write it."""
        return f"{self.name.replace('-', ' ').partition('@')[0]}, {self.body}"


SUITE = (
    Design("cat-mask", "mask", "a cat mask", "cat-mask.png"),
    Design("heart-glasses", "glasses", "heart glasses", body="child", reading="object"),
    Design("alligator-bangle", "bangle", "an alligator bangle", reading="object"),
    Design("dinosaur-helmet", "helmet", "a dinosaur helmet", body="child", reading="object"),
    Design("cow-visor", "visor", "a cow visor", reading="object"),
    Design("rose-necklace", "necklace", "a rose necklace", body="child", reading="object"),
    Design("star-ring", "ring", "a star ring", "objects/star.png"),
    Design("bunny-slippers", "slippers", "bunny slippers", "bunny.png", "child"),
    Design("butterfly-mask", "mask", "a butterfly mask", "butterfly.png", "child", scale=1.25),
    Design("fox-mask", "mask", "a fox mask", "fox.png", "dinosaur"),
    Design("owl-ring", "ring", "an owl ring", "owl.png", "child"),
    Design("star-bangle", "bangle", "a star bangle", "objects/star.png", "dinosaur"),
    Design("cat-ring", "ring", "a cat ring", "objects/ring.png", "dinosaur", reading="object"),
    Design("butterfly-visor", "visor", "a butterfly visor", "butterfly.png", "dinosaur"),
)
"""The designs of the table."""
QUICK = ("star-ring",)
"""The designs of `--quick`."""
STAR = next(design for design in SUITE if design.name == "star-ring")
TARGETS = (
    STAR,
    replace(STAR, name="owl-ring@man", prompt="an owl ring", example="owl.png"),
    replace(STAR, name="cat-ring@man", prompt="a cat ring", example="objects/ring.png", reading="object"),
    replace(STAR, name="bunny-ring@man", prompt="a bunny ring", example="bunny.png"),
)
"""One template on one body, towards many targets."""
BODIES = tuple(
    STAR if body == STAR.body else replace(STAR, name=f"star-ring@{body}", body=body)
    for body in ("man", "child", "dinosaur", "frog")
)
"""One design, for many bodies."""
JOINT = (
    Design("thin-bangle", "bangle", "a bangle", shape="thin bangle"),
    Design("closed-helmet", "helmet", "a helmet", shape="closed helmet"),
)
"""Guidance that is too thin, and guidance without an opening."""


def drawing_of(design: Design) -> dict[str, Any]:
    """The drawing of a design, as fields of a recipe.  Raises `MissingError` where the repository's examples are not."""
    if not design.example:
        return {"text": design.prompt, "via": "subjects", "reading": design.reading}
    path = Path(fabcraft.__file__).parents[1] / "examples" / design.example
    if not path.is_file():
        raise MissingError(
            f"the drawing {design.example} of the {design.name} is not beside the package",
            "Run the comparison from a checkout of the repository (pip install -e .).",
        )
    return {"sketch": str(path), "reading": design.reading}


def chosen(only: Sequence[str], quick: bool) -> list[tuple[str, Design]]:
    """The cells of the table, design by design, that `only` names as METHOD, DESIGN or METHOD/DESIGN; all if it is empty.

    Raises `InputError` for a name that is neither, with the one that comes close.
    """
    wanted = [_named(one) for one in only] or [("", "")]

    def asked(method: str, design: Design) -> bool:
        # a design that is named is meant, also where only a few are looked at quickly
        usual = not quick or design.name in QUICK
        return any(
            one in ("", method) and (name == design.name or (not name and usual)) for one, name in wanted
        )

    return [(method, design) for design in SUITE for method in METHODS if asked(method, design)]


def _named(word: str) -> tuple[str, str]:
    """(method, design) of METHOD, DESIGN or METHOD/DESIGN; "" for all.  Raises `InputError` for what is neither."""
    names = tuple(design.name for design in SUITE)
    method, slash, name = word.partition("/")
    if not slash and word in names:
        return "", word
    if method not in METHODS:
        raise _unknown(word, method, (*METHODS, *names))
    if slash and name not in names:
        raise _unknown(word, name, names)
    return method, name


def _unknown(word: str, part: str, known: Sequence[str]) -> InputError:
    close = get_close_matches(part, known, n=1)
    return InputError(
        f"--only {word}: there is no '{part}'" + (f"; did you mean {close[0]}?" if close else ""),
        f"Methods: {', '.join(METHODS)}. Designs: {', '.join(design.name for design in SUITE)}.",
    )
