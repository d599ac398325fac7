"""`Finding` and `PrintReport`: what the checks say, as one object for people, pipes and the 3MF.

A finding is a failure (the part would not print or not fit), a warning (look at it) or a note. A check that
could not run is a failure too: not knowing is not the same as being safe; what nobody asked to check is not
called printable either. What was not measured is absent from `metrics`, never zero. Same findings, same
bytes: keys come in a fixed order, numbers with six significant digits.
"""

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import islice
from types import MappingProxyType
from typing import Any, Literal

import fabcraft

SCHEMA = "fabcraft.report/1"

Severity = Literal["fail", "warn", "note"]
Place = tuple[float, float, float]
Value = bool | int | float | str | tuple[float, ...]

_ORDER = {"fail": 0, "warn": 1, "note": 2}
_MARKS = {"fail": "FAIL", "warn": "warn", "note": "note"}
_SHOWN_PLACES = 3


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing a check has to say."""

    check: str
    """Which check: `wall`, `open_edges`, `penetration`, ..."""
    severity: Severity
    value: Value | None = None
    """What was measured."""
    limit: Value | None = None
    """What it was held against."""
    unit: str = ""
    """Unit of `value` and `limit`."""
    where: tuple[Place, ...] = ()
    """Places on the object, mm, the worst first."""
    advice: str
    """What it means and what to do."""
    ran: bool = True
    """False: the check could not run, see `could_not_run`."""

    def to_dict(self) -> dict[str, Any]:
        """The keys of the report's JSON; those without content are left out."""
        pairs = (
            ("check", self.check),
            ("severity", self.severity),
            ("value", self.value),
            ("limit", self.limit),
            ("unit", self.unit or None),
            ("where", self.where or None),
            ("advice", self.advice),
            ("ran", None if self.ran else False),
        )
        return {key: _plain(value) for key, value in pairs if value is not None}

    def to_text(self) -> str:
        """One or two lines for a terminal."""
        numbers = " ".join(
            part
            for part in (
                "" if self.value is None else f"{_text(self.value)}{_unit(self.unit)}",
                "" if self.limit is None else f"(limit {_text(self.limit)}{_unit(self.unit)})",
            )
            if part
        )
        places = "; ".join(f"({x:.1f}, {y:.1f}, {z:.1f})" for x, y, z in self.where[:_SHOWN_PLACES])
        more = f" and {len(self.where) - _SHOWN_PLACES} more" if len(self.where) > _SHOWN_PLACES else ""
        head = " ".join(part for part in (_MARKS[self.severity], self.check, numbers) if part)
        return f"{head}: {self.advice}" + (f"\n     at {places}{more} mm" if places else "")


@dataclass(frozen=True, kw_only=True)
class PrintReport:
    """Everything that was found; `printable` and `verdict` follow from the findings."""

    findings: tuple[Finding, ...] = ()
    unchecked: str = ""
    """What of printing was not checked at all, in words; empty when all was."""
    route: tuple[str, ...] = ()
    """What became of the input, step by step."""
    metrics: Mapping[str, Value] = field(default_factory=dict)
    """What was measured, by name; the unit is in the name."""
    seconds: Mapping[str, float] = field(default_factory=dict)
    """Time of each stage."""
    peak_memory_bytes: int | None = None
    files: tuple[str, ...] = ()
    """What was written."""

    def __post_init__(self) -> None:
        ranked = sorted(
            self.findings, key=lambda finding: _ORDER[finding.severity]
        )  # stable within a severity
        object.__setattr__(self, "findings", tuple(ranked))
        object.__setattr__(self, "metrics", MappingProxyType(dict(sorted(self.metrics.items()))))
        object.__setattr__(self, "seconds", MappingProxyType(dict(self.seconds)))

    @property
    def failed(self) -> bool:
        """Some finding is a failure."""
        return any(finding.severity == "fail" for finding in self.findings)

    @property
    def printable(self) -> bool:
        """Everything was checked, and no finding is a failure."""
        return not self.failed and not self.unchecked

    @property
    def verdict(self) -> str:
        """One sentence."""
        fails = [finding for finding in self.findings if finding.severity == "fail"]
        warnings = sum(finding.severity == "warn" for finding in self.findings)
        aside = f" ({warnings} warning{'s' * (warnings > 1)})" if warnings else ""
        if not fails:
            return (
                f"Sound, but not checked: {self.unchecked}{aside}."
                if self.unchecked
                else f"Printable{aside}."
            )
        unknown = all(not finding.ran for finding in fails)
        names = ", ".join(dict.fromkeys(finding.check for finding in fails))
        return (
            f"{'Not known to be printable, could not check' if unknown else 'Not printable'}: {names}{aside}."
        )

    def to_dict(self) -> dict[str, Any]:
        """The object that `--json` prints."""
        pairs: tuple[tuple[str, Any], ...] = (
            ("schema", SCHEMA),
            ("version", fabcraft.__version__),
            ("printable", self.printable),
            ("verdict", self.verdict),
            ("findings", [finding.to_dict() for finding in self.findings]),
            ("route", list(self.route)),
            ("metrics", {key: _plain(value) for key, value in self.metrics.items()}),
            ("seconds", {key: round(value, 3) for key, value in self.seconds.items()}),
            ("peak_memory_bytes", self.peak_memory_bytes),
            ("files", list(self.files)),
        )
        return {key: value for key, value in pairs if value is not None}

    def to_json(self) -> str:
        """The JSON text, two spaces a level. Raises `ValueError` for a number that is not finite."""
        return json.dumps(self.to_dict(), indent=2, ensure_ascii=False, allow_nan=False) + "\n"

    def to_text(self) -> str:
        """The findings, worst first, then the verdict, as plain lines for a terminal."""
        return "\n".join([*(finding.to_text() for finding in self.findings), self.verdict])


def could_not_run(check: str, why: str, advice: str = "") -> Finding:
    """The failure that stands for a check that gave no answer."""
    said = f"could not run: {why.rstrip('.')}."
    return Finding(check=check, severity="fail", advice=f"{said} {advice}".strip(), ran=False)


def places(points: Iterable[Any], most: int = 8) -> tuple[Place, ...]:
    """(N, 3) points as plain tuples rounded to 0.01 mm, the first `most` of them."""
    return tuple(
        (round(float(x), 2), round(float(y), 2), round(float(z), 2)) for x, y, z in islice(points, most)
    )


def _plain(value: Any) -> Any:
    """A value for JSON: numpy scalars become Python's, floats keep six significant digits."""
    if isinstance(value, (list, tuple)):
        return [_plain(one) for one in value]
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, float) and math.isfinite(value):
        return float(f"{value:.6g}")
    return value


def _text(value: Value) -> str:
    if isinstance(value, tuple):
        return " x ".join(_text(one) for one in value)
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _unit(unit: str) -> str:
    return f" {unit}" if unit else ""
