"""Every kind of wearable by name; a kind is imported when it is asked for."""

import difflib
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from fabcraft.errors import InputError

if TYPE_CHECKING:
    from fabcraft.template.catalogue import Kind

KINDS: Mapping[str, str] = MappingProxyType(
    {
        "mask": "before the face, with two eye openings; rests on forehead, cheekbones and nose bridge",
        "ring": "around the ring finger, passed over its knuckle; flat or raised on the back",
        "bangle": "around the wrist, passed over the folded hand; or a cuff with a gap",
        "necklace": "a collar or a hoop around the neck, open at the nape, with a pendant",
        "glasses": "a front with two lens openings on the nose, temples over the ears",
        "visor": "a band around the forehead, open behind, with a brim",
        "helmet": "a shell over the crown of the head, with a rim",
        "slippers": "a pair of closed-toe mules, the second mirrored",
    }
)
"""What each is, in a line."""
NAMES = tuple(KINDS)
SOLIDS = NAMES[1:]
"""Kinds that are finished solids before a motif is worked into them."""


def with_article(name: str) -> str:
    """A kind as it stands in a sentence: "a ring", but "glasses"."""
    return name if name.endswith("s") else f"a {name}"


def is_own(name: str) -> bool:
    """Whether a template's name is the file of a mesh of the user's own."""
    return bool(Path(name).suffix) and Path(name).suffix.lower() != ".toml"


def known(name: str) -> str:
    """`name`, when it is a template.  Raises `InputError` with the one that comes close."""
    if name in KINDS:
        return name
    close = difflib.get_close_matches(name, NAMES, n=1)
    raise InputError(
        f"there is no template called {name!r}" + (f"; did you mean {close[0]}?" if close else ""),
        f"Templates: {', '.join(NAMES)}, or a mesh file of your own. A recipe file ends in .toml.",
    )


def kind_of(name: str) -> "Kind":
    """The kind called `name`.  Raises `InputError` for another name."""
    found: "Kind" = import_module(f"fabcraft.template.{known(name)}").KIND
    return found
