"""In which unit a scan is: its own, the one that was said, or the one that makes it as large as people are."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from fabcraft.body.scan_part import Kind
from fabcraft.errors import InputError
from fabcraft.read.mesh_file import UNITS_MM

_SIZE_MM: dict[str, tuple[float, float]] = {
    "head": (150.0, 700.0),
    "hand": (100.0, 560.0),
    "foot": (110.0, 560.0),
    "body": (600.0, 2600.0),
}
"""Largest side of a scan that is looked at: a child's face to a bust with shoulders; a toddler's hand to an arm below
the elbow with its hand; a toddler's foot to a leg below the knee; a toddler to a tall person, arms spread."""
_USUAL_MM: dict[str, tuple[float, float]] = {
    "head": (180.0, 520.0),
    "hand": (140.0, 480.0),
    "foot": (150.0, 450.0),
    "body": (800.0, 2100.0),
}
"""The same for most scans; a unit that puts a scan here for one kind is asked first, and then for all kinds."""
WORDS = {"mm": "millimetres", "cm": "centimetres", "m": "metres", "in": "inches"}
NAMES = {"head": "head", "hand": "hand with its forearm", "foot": "foot", "body": "whole body"}


@dataclass(frozen=True)
class Guess:
    """What a scan may show, and in which unit."""

    kind: Kind
    unit: str
    factor: float
    """From the mesh as it was read to mm."""


def words_of(kind: Kind) -> str:
    """The part in words, with its article."""
    base, _, side = kind.partition("_")
    return f"a {side} {NAMES[base]}" if side else f"a {NAMES[base]}"


def file_mm(path: Path, units: str) -> float:
    """Length of the file's unit as it is read, in mm; "" for the format's own."""
    return UNITS_MM[units] if units else 1000.0 if path.suffix.lower() in (".glb", ".gltf") else 1.0


def _factors(path: Path, units: str) -> dict[str, float]:
    """Unit to the factor that takes the mesh as it was read to mm; the unit it was read in comes first."""
    factors = {unit: length / file_mm(path, units) for unit, length in UNITS_MM.items()}
    return dict(sorted(factors.items(), key=lambda item: item[1] != 1.0))


def every_unit(path: Path, units: str, kinds: Sequence[Kind]) -> list[Guess]:
    """Every kind in every unit, or only in the one that was said: where landmarks are to tell."""
    factors = _factors(path, units)
    return [
        Guess(kind, unit, factors[unit])
        for unit in (list(factors)[:1] if units else factors)
        for kind in kinds
    ]


def guesses(size_mm: float, path: Path, units: str, kinds: Sequence[Kind]) -> list[Guess]:
    """What the scan in `path` may be: a part and a unit that suit each other, the file's own unit first.

    size_mm : largest side as the file was read.  units : what was said of them.
    Raises `InputError` when no kind is as large, with the unit that would make it so.
    """
    factors = _factors(path, units)

    def fits(kind: Kind, unit: str, ranges: Mapping[str, tuple[float, float]]) -> bool:
        low, high = ranges[kind.partition("_")[0]]
        return low <= size_mm * factors[unit] <= high

    def suiting(units: Sequence[str]) -> list[Guess]:
        usual = [unit for unit in units if any(fits(kind, unit, _USUAL_MM) for kind in kinds)]
        return [
            Guess(kind, unit, factors[unit])
            for unit in usual or units
            for kind in kinds
            if fits(kind, unit, _SIZE_MM)
        ]

    own, *others = factors
    if found := suiting([own] if units else [own, *others]):
        return found
    names = list(dict.fromkeys(kind.partition("_")[0] for kind in kinds))
    known = "; ".join(
        f"a {NAMES[name]} has {_SIZE_MM[name][0]:.0f} to {_SIZE_MM[name][1]:.0f} mm" for name in names
    )
    if other := suiting(others):
        raise InputError(
            f"{path.name} would be {size_mm:.3g} mm large, {known}: the file looks like {WORDS[other[0].unit]}",
            f"Pass --body-units {other[0].unit}.",
        )
    raise InputError(
        f"{path.name} would be {size_mm:.3g} mm large; {known}",
        "Crop the scan to that, and pass its unit with --body-units mm, cm, m or in.",
    )


def unit_note(path: Path, unit: str, size_mm: float, units: str) -> str:
    """What was taken for the unit, and why."""
    size = f"which makes it {size_mm:.0f} mm large"
    if units:
        return f"{path.name} is in {WORDS[unit]}, as was said, {size}."
    suffix = path.suffix.lower()
    if (suffix == ".3mf" and unit == "mm") or (suffix in (".glb", ".gltf") and unit == "m"):
        return f"{path.name} has the unit of its format, {size}."
    if suffix in (".3mf", ".glb", ".gltf"):
        return f"The unit of {path.name} suits nobody; it was taken as {WORDS[unit]}, {size}."
    return f"{path.name} names no unit; it was taken as {WORDS[unit]}, {size}."
