"""A small file of settings (TOML or JSON) becomes plain values, or an `InputError` that says what is wrong with it."""

import json
import tomllib
from pathlib import Path
from typing import Any

from fabcraft.errors import InputError

MAX_BYTES = 1_000_000


def read_table(path: Path | str, what: str) -> Any:
    """The values in the file `path`: of a TOML file a table, of a JSON file whatever it holds.

    what : what the file is called in errors, "contact file".
    Raises `InputError` for another kind of file, one that is missing, too large, no text or not valid.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in (".toml", ".json"):
        raise InputError(f"{path.name} is no {what}", "Give a .toml or a .json file.")
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(
                f"{path} is {path.stat().st_size:,} bytes; a {what} has a few hundred", "Check the path."
            )
        text = path.read_text("utf-8")
    except FileNotFoundError:
        raise InputError(f"there is no {what} {path}", "Check the path.") from None
    except UnicodeDecodeError:
        raise InputError(f"{path} is not text; a {what} is TOML or JSON", "Check the path.") from None
    except OSError as error:
        raise InputError(
            f"{path} cannot be read: {error.strerror}", "Check the path and its permissions."
        ) from None
    try:
        return tomllib.loads(text) if kind == ".toml" else json.loads(text)
    except (ValueError, RecursionError) as error:  # both parsers' errors are ValueErrors
        raise InputError(f"{path} is not valid {kind[1:].upper()}: {error}", "Mend the line named.") from None
