"""Sizes that people know of themselves, turned into millimetres, and how a measure is asked for.

A bare number is mm; `158mm`, `15.8cm`, `6.2in` say their unit.  Standards, C in mm:

ring    ISO54       C = 54, ISO 8653: the inner circumference        (rings are sized to the finger they sit on)
        US7         C = 36.5 + 2.55 n      CH14, IT14, ES14   C = n + 40
head    hat58       C = 10 n, head girth in cm                       US7.25  C = pi x 25.4 n, inches over pi
        UK7.125     an eighth less than US
foot    EU42        L = 20/3 n - 12.5: Paris points of the last, 10 to 15 mm longer than the foot (the middle is taken)
        MP265       Mondopoint, ISO 9407: the foot's length
bangle  IN2-6       folded hand: inner diameter of 2 and 6/16 inch, less 4 mm of play on C
"""

import difflib
import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from fabcraft.body.measures import MEASURES, SIDES, sided
from fabcraft.errors import InputError

FOLDED_HAND = "hand_folded"
BANGLE_PLAY_MM = 4.0
"""A bangle is this much longer inside than the folded hand that passes it."""

_UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
_Rule = Callable[[float], float]
_RING: Mapping[str, _Rule] = {
    "ISO": lambda n: n,
    "US": lambda n: 36.5 + 2.55 * n,
    **dict.fromkeys(("CH", "IT", "ES"), lambda n: n + 40.0),
}
_HAT: Mapping[str, _Rule] = {
    "hat": lambda n: 10.0 * n,
    "US": lambda n: math.pi * 25.4 * n,
    "UK": lambda n: math.pi * 25.4 * (n + 0.125),
}
_SHOE: Mapping[str, _Rule] = {"EU": lambda n: 20.0 / 3.0 * n - 12.5, "MP": lambda n: n}
_BANGLE: Mapping[str, _Rule] = {"IN": lambda n: math.pi * 25.4 * (2.0 + n / 16.0) - BANGLE_PLAY_MM}
STANDARDS: Mapping[str, Mapping[str, _Rule]] = {
    "ring_finger": _RING,
    "head": _HAT,
    "foot": _SHOE,
    FOLDED_HAND: _BANGLE,
}
"""Measure to its standards: name to mm."""

_EXAMPLES = {"ring_finger": "54, ISO54 or US7", "head": "574, hat58 or US7.25", "foot": "265, EU42 or MP265"}
_EXAMPLES[FOLDED_HAND] = "200 or IN2-6"
_LARGEST_MM = 3000.0


@dataclass(frozen=True)
class Asked:
    """One measure that somebody asked for."""

    name: str
    """A name of `measures.MEASURES`, or `hand_folded`, with or without its side."""
    mm: float
    words: str = ""
    """The size as it was asked, where that was not a number of millimetres: "US 7"."""


def parse(texts: Iterable[str]) -> dict[str, str]:
    """`name=value` texts as a mapping.  Raises `InputError` for one without `=`, and for a name given twice."""
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise InputError(f"--measure {text!r} is not name=value", "Write --measure wrist=158.")
        if name in found:
            raise InputError(f"{name} was measured twice: {found[name]} and {value}", "Give one of them.")
        found[name] = value
    return found


def asked(measures: Mapping[str, str | float | int]) -> list[Asked]:
    """The measures in mm, in the order given.

    Raises `InputError` for a name or a size that is not known, and for a pair given both plain and with a side.
    """
    found = []
    for name, value in measures.items():
        base, side = _known(name)
        if side and base in measures:
            raise InputError(
                f"{base} and {name} were both given", f"Give {base}, or {base}_left and {base}_right."
            )
        millimetres, words = _millimetres(base, name, value)
        found.append(Asked(name, millimetres, words))
    return found


def _known(name: str) -> tuple[str, str]:
    """(the measure, its side).  Raises `InputError` for an unknown one, with those that come close."""
    base, side = sided(name)
    if name.removesuffix("_left").removesuffix("_right") == FOLDED_HAND:
        return FOLDED_HAND, name[len(FOLDED_HAND) + 1 :]
    if base in MEASURES and (not side or MEASURES[base].paired):
        return base, side
    if side:
        raise InputError(f"{base} has no {side} side", f"Measure {base}.")
    known = [*MEASURES, FOLDED_HAND]
    close = difflib.get_close_matches(name, known, n=1)
    hint = f"; did you mean {close[0]}?" if close else ""
    pairs = ", ".join(key for key in MEASURES if MEASURES[key].paired)
    raise InputError(
        f"there is no measure called {name!r}{hint}",
        f"Measures: {', '.join(known)}. With a side, as in wrist_{SIDES[0]}: {pairs}.",
    )


def _millimetres(base: str, name: str, value: str | float | int) -> tuple[float, str]:
    """(mm, the size in words where it was no number of mm)."""
    text = str(value).strip()
    parts = re.fullmatch(r"([A-Za-z]*)[ :]*([0-9]+(?:[.,][0-9]+)?)(?:-([0-9]+))?[ ]*([A-Za-z]*)", text)
    standards = STANDARDS.get(base, {})
    rules = {key.lower(): (key, rule) for key, rule in standards.items()}
    example = _EXAMPLES.get(base, "158 or 15.8cm")
    if parts is None:
        raise InputError(f"{name} {text!r} is not a size", f"Give mm or a known size, such as {example}.")
    standard, number, sixteenths, unit = parts.groups()
    size = float(number.replace(",", "."))
    words = ""
    if standard:
        if standard.lower() not in rules or unit:
            known = ", ".join(standards) or "none, only millimetres"
            raise InputError(
                f"{name} {text!r}: there is no standard {standard!r} for {base}",
                f"Standards: {known}. For example {example}.",
            )
        label, rule = rules[standard.lower()]
        if (label == "IN") != (sixteenths is not None) or (label == "IN" and size != 2.0):
            raise InputError(f"{name} {text!r} is not a size", f"Give, for example, {example}.")
        words = f"{label} {number}" + (f"-{sixteenths}" if sixteenths else "")
        millimetres = rule(float(sixteenths) if sixteenths else size)
    elif sixteenths or (unit and unit.lower() not in _UNITS):
        raise InputError(f"{name} {text!r} is not a size", f"Give mm or a known size, such as {example}.")
    else:
        millimetres = size * _UNITS[unit.lower() or "mm"]
        words = text if unit and unit.lower() != "mm" else ""
    if not 1.0 <= millimetres <= _LARGEST_MM:
        raise InputError(
            f"{name} {text} would be {millimetres:.4g} mm", f"Give a size of a person, such as {example}."
        )
    return millimetres, words
