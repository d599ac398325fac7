"""Every kind of wearable by name; a kind is imported when it is asked for."""

import difflib
from importlib import import_module
from typing import TYPE_CHECKING

from fabcraft.errors import InputError

if TYPE_CHECKING:
    from fabcraft.template.catalogue import Kind

SOLIDS = ("ring", "bangle", "necklace", "glasses", "visor", "helmet", "slippers")
"""Kinds that are finished solids before a motif is worked into them."""
NAMES = ("mask", *SOLIDS)


def kind_of(name: str) -> "Kind":
    """The solid kind called `name`.  Raises `InputError` for another name, with the ones that come close."""
    if name not in SOLIDS:
        close = difflib.get_close_matches(name, SOLIDS, n=1)
        hint = f"Did you mean {close[0]}?" if close else f"Choose one of: {', '.join(SOLIDS)}."
        raise InputError(f"there is no solid template '{name}'", hint)
    found: "Kind" = import_module(f"fabcraft.template.{name}").KIND
    return found
