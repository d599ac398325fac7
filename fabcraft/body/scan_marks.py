"""Landmarks that a user gives: a small file of names and points, in the scan's own unit and frame.

JSON   {"sellion": [0.1, 95.2, 40.0], ...}
TOML   sellion = [0.1, 95.2, 40.0]
CSV    sellion, 0.1, 95.2, 40.0            (a heading line is skipped)
"""

import csv
import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from fabcraft.errors import InputError

MAX_BYTES = 100_000
NEEDED: Mapping[str, tuple[str, ...]] = {
    "head": ("sellion", "menton", "tragion_left", "tragion_right"),
    "hand": ("wrist_back_*", "index_knuckle_*", "little_knuckle_*", "middle_finger_tip_*"),
    "foot": ("heel_*", "toe_tip_*", "ball_medial_*", "instep_*"),
    "body": (
        "sellion",
        "menton",
        "middle_finger_tip_left",
        "middle_finger_tip_right",
        "heel_left",
        "heel_right",
    ),
}
"""What a landmark file must name at least; `*` is the side."""


def read_marks(path: Path | str, known: Sequence[str]) -> dict[str, Float64[np.ndarray, "3"]]:
    """Name to point as the file says them.

    known : the names that a scan can have.
    Raises `InputError` for a file that is missing, too large or malformed, an unknown name, a point that
    is none, and two landmarks at one place.
    """
    path = Path(path)
    table = _table(path)
    marks = {}
    for name, value in table.items():
        if name not in known:
            close = get_close_matches(str(name), known, n=1)
            hint = f"Did you mean {close[0]}?" if close else f"Landmarks: {', '.join(known)}."
            raise InputError(f"{path.name}: there is no landmark called '{str(name)[:80]}'", hint)
        marks[name] = _point(path, name, value)
    if not marks:
        raise InputError(f"{path.name} names no landmark", _SHAPE)
    for one, other in combinations(marks, 2):
        if np.array_equal(marks[one], marks[other]):
            raise InputError(
                f"{path.name} puts {one} and {other} at the same place", "Give every landmark its own place."
            )
    return marks


def has_enough(marks: Mapping[str, Any], kind: str) -> bool:
    """Whether every landmark that `kind` needs is there."""
    return all(name in marks for name in _needed(kind))


def require_enough(marks: Mapping[str, Any], kind: str, path: Path) -> None:
    """Raises `InputError` naming the landmarks that `kind` needs and that are missing."""
    if not has_enough(marks, kind):
        missing = [name for name in _needed(kind) if name not in marks]
        raise InputError(
            f"{path.name} lacks {', '.join(missing)}",
            f"For a {kind.partition('_')[0]} it must name {', '.join(_needed(kind))}; others are welcome.",
        )


def _needed(kind: str) -> list[str]:
    base, _, side = kind.partition("_")
    return [name.replace("*", side) for name in NEEDED[base]]


_SHAPE = "Write one landmark a line: name, x, y, z (CSV), or a JSON or TOML table of name to [x, y, z]."


def _table(path: Path) -> Mapping[str, Any]:
    if not path.is_file():
        raise InputError(f"there is no landmark file {path}", "Check the path.")
    if (size := path.stat().st_size) > MAX_BYTES:
        raise InputError(
            f"{path.name} has {size:,} bytes; a landmark file has a few thousand", "Check the path."
        )
    kind = path.suffix.lower()
    if kind not in (".json", ".toml", ".csv"):
        raise InputError(f"{path.name} is no landmark file that can be read", "Formats: JSON, TOML, CSV.")
    try:
        text = path.read_text("utf-8-sig")
        table: Any = (
            json.loads(text) if kind == ".json" else tomllib.loads(text) if kind == ".toml" else _rows(text)
        )
    except (ValueError, RecursionError, csv.Error) as error:  # both parsers' errors are ValueErrors
        reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise InputError(f"{path.name} cannot be read as {kind[1:].upper()}: {reason}", _SHAPE) from error
    if not isinstance(table, dict):
        raise InputError(f"{path.name} holds a {type(table).__name__}; a table of names was expected", _SHAPE)
    return table


def _rows(text: str) -> dict[str, list[str]]:
    """name, x, y, z; empty lines, comments and a heading are skipped."""
    rows = [[cell.strip() for cell in row] for row in csv.reader(text.splitlines())]
    rows = [row for row in rows if any(row) and not row[0].startswith("#")]
    if rows and [cell.lower() for cell in rows[0][1:]] == ["x", "y", "z"]:
        rows = rows[1:]
    names = [row[0] for row in rows]
    if twice := {name for name in names if names.count(name) > 1}:
        raise ValueError(f"{sorted(twice)[0][:80]} is named twice")
    return {row[0]: row[1:] for row in rows}


def _point(path: Path, name: str, value: Any) -> Float64[np.ndarray, "3"]:
    try:
        point = [float(one) for one in value]
    except (TypeError, ValueError):
        point = []
    if len(point) != 3 or not all(math.isfinite(one) for one in point) or isinstance(value, str):
        raise InputError(
            f"{path.name}: {name} is {str(value)[:60]}; three finite numbers were expected", _SHAPE
        )
    return np.array(point)
