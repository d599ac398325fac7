"""What a slicer's preset inherits: files that lie beside it, never elsewhere, and never in a circle."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from fabcraft.errors import InputError
from fabcraft.presets.machine import words

Reader = Callable[[Path], dict[str, Any]]
"""Reads a JSON object from a file, bounded.  Raises `InputError`."""

_DEEPEST = 20


def with_parents(
    table: dict[str, Any],
    path: Path,
    read: Reader,
    *,
    name: str,
    ending: str,
    missing: str,
    complete: Callable[[dict[str, Any]], bool] = lambda _: False,
) -> list[dict[str, Any]]:
    """The table of `path`, what it inherits, what that inherits, and so on up to one that is `complete`.

    name : what the others would call this one.  ending : of their files.  missing : what to do where one is not there.
    Raises `InputError` for a parent that does not lie beside the file, and for a circle.
    """
    chain, seen = [table], {name}
    while (parent := words(chain[-1].get("inherits"), "")) and not complete(chain[-1]):
        if parent in seen or len(chain) > _DEEPEST:
            raise InputError(
                f"{path.name} inherits from {parent!r}, which comes back to itself or takes more than {_DEEPEST} steps",
                "Export the printer anew.",
            )
        seen.add(parent)
        file = beside(path.parent, parent, ending)
        if file is None:
            raise InputError(
                f"{path.name} inherits from {parent!r}, which does not lie beside it",
                f"Put {parent}{ending} into the same folder{missing}",
            )
        chain.append(read(file))
    return chain


def beside(folder: Path, name: str, ending: str) -> Path | None:
    """The file NAME.ending in the folder, never one elsewhere."""
    if not name or name != Path(name).name or "\\" in name or name.startswith("."):
        return None
    try:
        file = folder / f"{name}{ending}"
        return file if file.is_file() else None
    except (OSError, ValueError):  # a name that is too long
        return None
