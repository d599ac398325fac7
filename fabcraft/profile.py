"""`PrinterProfile`: what one printer with one nozzle, layer and material can make.

One flat TOML file per printer, no inheritance, unknown keys refused. Millimetres and degrees; an overhang is
counted from the vertical (0 a wall, 90 a ceiling). Every number names its source in `[sources]`; `verified`
says whether all of them were confirmed.

Looked for in this order, the first file of a name wins: the installed package's `profiles`, the repository's
`profiles/` (an editable install has no other), `$FABCRAFT_PROFILES`, the user's configuration folder.
"""

import math
import os
import re
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from importlib.resources import files
from importlib.resources.abc import Traversable
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import msgspec

from fabcraft.errors import InputError

Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
Slope = Annotated[float, msgspec.Meta(ge=0, le=90)]

MAX_BYTES = 1_000_000

Process = Literal["fdm", "sla", "sls", "mjf"]

_KINDS = {
    "str": "text in quotes",
    "float": "a number",
    "int": "a whole number",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
    "null": "nothing",
}


@dataclass(frozen=True, kw_only=True)
class PrinterProfile:
    """The limits and habits of one printer; the file's name is its `name`."""

    name: str = ""
    """What `--printer` takes: the file's name without `.toml`; not a key of the file."""
    title: str
    """The printer, nozzle and material as people say it."""
    process: Process
    """fdm: filament; sla: resin, by laser or screen; sls, mjf: powder."""
    build_mm: tuple[Positive, Positive, Positive]
    """Build volume: x, y, z."""
    layer_mm: Positive
    """Layer height the other numbers hold for."""
    nozzle_mm: NotNegative
    """Nozzle bore; 0 without a nozzle."""
    min_wall_supported_mm: Positive
    """Thinnest wall that is joined to the rest on two or more sides."""
    min_wall_mm: Positive
    """Thinnest wall with a free border."""
    wall_mm: Positive
    """Wall to design to when nobody asks for another."""
    min_emboss_width_mm: Positive
    """Narrowest raised stroke."""
    min_emboss_height_mm: Positive
    """Lowest raised stroke."""
    min_engrave_mm: Positive
    """Narrowest and shallowest groove."""
    min_hole_mm: Positive
    """Smallest hole that stays open."""
    clearance_moving_mm: NotNegative
    """Gap between parts that must move against each other."""
    clearance_fit_mm: NotNegative
    """Gap between parts that are put together by hand."""
    max_overhang_deg: Slope
    """Steepest overhang, from the vertical, that needs no support."""
    max_bridge_mm: NotNegative
    """Longest level span that needs no support."""
    drain_hole_mm: NotNegative
    """Smallest drain or escape hole of a hollow part; 0 where nothing is trapped."""
    tolerance_mm: NotNegative
    """What a printed length may be off, plus or minus."""
    tolerance_percent: NotNegative
    """The same as a share of the length; the larger of the two holds."""
    line_width_mm: Positive | None = None
    """Width of one bead of filament; left out: 1.125 nozzles, as slicers choose it."""
    density_g_cm3: Positive | None = None
    """Density of the material as printed solid; left out: weights are not told."""
    exposure_s: Positive | None = None
    """Exposure of one layer of resin; left out: printing times are not told."""
    wall_by_size: tuple[tuple[Positive, Positive], ...] = ()
    """Where large parts need thicker walls: [x + y + z from, least wall], mm, ascending; see `for_size`."""
    max_faces: int | None = None
    """Most triangles in one file that a service takes; left out: no limit is known."""
    max_file_mb: Positive | None = None
    """Largest file that a service takes, in millions of bytes, counted as binary STL."""
    slicer_command: tuple[str, ...] = ()
    """Another slicer than PrusaSlicer for `--slice`: program and arguments, run without a shell; {input} is the part's STL
    and {output} the file to make."""
    verified: bool
    """Whether every number was confirmed at its source or on a print of this machine."""
    notes: str = ""
    """What a maker should know besides the numbers."""
    sources: dict[str, str] = field(default_factory=dict)
    """Where each number comes from, by field."""

    def for_size(self, size_mm: Iterable[float]) -> "PrinterProfile":
        """The profile with the walls that a part of that size (x, y, z; mm) needs; see `wall_by_size`."""
        total = sum(size_mm)
        least = max((wall for start, wall in self.wall_by_size if total >= start), default=0.0)
        walls = ("min_wall_supported_mm", "min_wall_mm", "wall_mm")
        return replace(self, **{name: max(getattr(self, name), least) for name in walls})

    @property
    def bead_mm(self) -> float:
        """Width of one bead of filament, mm."""
        return self.line_width_mm or 1.125 * self.nozzle_mm

    def tolerance_at(self, length_mm: float) -> float:
        """What a printed length of `length_mm` may be off, mm."""
        return max(self.tolerance_mm, self.tolerance_percent / 100 * length_mm)


def list_profiles() -> list[PrinterProfile]:
    """All profiles that can be found, by name; of two files of one name the first place wins."""
    return [read_profile(entry) for _, entry in sorted(_found().items())]


def load_profile(name: str | Path) -> PrinterProfile:
    """The profile of that name, or of that file when `name` ends in `.toml`.

    Raises `InputError` for an unknown name (with those that come close) and for a file that is not a profile.
    """
    if str(name).endswith(".toml"):
        return read_profile(Path(name))
    wanted = str(name).strip().lower().replace("_", "-")
    found = _found()
    if wanted in found:
        return read_profile(found[wanted])
    known = sorted(found)
    close = get_close_matches(wanted, known, n=3, cutoff=0.5)
    raise InputError(
        f"no printer profile is called {str(name)!r}"
        + (f"; did you mean {' or '.join(close)}?" if close else ""),
        f"Known: {', '.join(known) or 'none'}. A path to a .toml file works as well.",
    )


def read_profile(path: Path | Traversable) -> PrinterProfile:
    """The profile in one TOML file.

    Raises `InputError` naming file and key: not readable, not TOML, unknown or missing key, wrong type,
    number out of range or without a source.
    """
    where = _shown(path)
    try:
        if isinstance(path, Path) and path.stat().st_size > MAX_BYTES:
            raise InputError(
                f"{where}: is {path.stat().st_size:,} bytes; a profile has a few thousand", "Check the path."
            )
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{where}: cannot be read ({error.strerror})", "Check the path.") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{where}: is not a text file in UTF-8", "Check the path.") from error
    return parse_profile(text, where, path.name.removesuffix(".toml"))


def parse_profile(text: str, where: str, name: str) -> PrinterProfile:
    """The profile of that name in TOML text.  where : the file, for errors.  Raises `InputError` as `read_profile`."""
    try:
        table = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(f"{where}: is not valid TOML: {error}", _compare_with_shipped()) from error
    _refuse_unknown(where, table)
    try:
        profile = msgspec.convert(table, PrinterProfile)
    except msgspec.ValidationError as error:
        raise InputError(f"{where}: {_plain(str(error))}", _compare_with_shipped()) from error
    _require_sources(where, profile)
    _require_sense(where, profile)
    return replace(profile, name=name)


def own_folder() -> Path:
    """Where the user's own profiles go: `$FABCRAFT_PROFILES`, or the user's configuration folder."""
    named = os.environ.get("FABCRAFT_PROFILES")
    return Path(named) if named else _configured()


def _configured() -> Path:
    import platformdirs  # 15 ms that a path to a file need not pay

    return Path(platformdirs.user_config_dir("fabcraft", appauthor=False)) / "profiles"


def _folders() -> Iterator[Path | Traversable]:
    yield files("fabcraft") / "profiles"
    repository = Path(__file__).resolve().parents[1]
    if (repository / "pyproject.toml").is_file():  # not the neighbours of an installed package
        yield repository / "profiles"
    if named := os.environ.get("FABCRAFT_PROFILES"):
        yield Path(named)
    yield _configured()


def _found() -> dict[str, Path | Traversable]:
    """The file of every name."""
    found: dict[str, Path | Traversable] = {}
    for folder in _folders():
        if folder.is_dir():
            for entry in folder.iterdir():
                if entry.name.endswith(".toml"):
                    found.setdefault(entry.name.removesuffix(".toml"), entry)
    return found


def _shown(path: Path | Traversable) -> str:
    """A shipped profile by its folder and name, a user's file as the user wrote it."""
    if isinstance(path, Path) and not path.is_absolute():
        return path.as_posix()
    parent = Path(str(path)).parent.name
    return f"{parent}/{path.name}" if parent == "profiles" else str(path)


def _numbers(profile: PrinterProfile) -> Iterator[tuple[str, tuple[float, ...]]]:
    """Every field that holds a number, with its values."""
    for name in (entry.name for entry in fields(PrinterProfile)):
        value: Any = getattr(profile, name)
        values = value if isinstance(value, tuple) else (value,)
        if values and isinstance(values[0], tuple):
            values = tuple(chain.from_iterable(values))
        if values and all(isinstance(one, (int, float)) and not isinstance(one, bool) for one in values):
            yield name, values


def _refuse_unknown(where: str, table: dict[str, Any]) -> None:
    known = [entry.name for entry in fields(PrinterProfile) if entry.name != "name"]
    for key in table:
        if key not in known:
            close = get_close_matches(key, known, n=1)
            hint = f", did you mean {close[0]}?" if close else ""
            raise InputError(f"{where}: {key}: unknown key{hint}", f"Keys: {', '.join(known)}.")


def _require_sources(where: str, profile: PrinterProfile) -> None:
    numeric = [name for name, _ in _numbers(profile)]
    for name in numeric:
        if not profile.sources.get(name, "").strip():
            raise InputError(
                f"{where}: {name}: expected its source in [sources], found none",
                f'Add {name} = "where the number comes from" under [sources]; "judgement" is a source too.',
            )
    for key in profile.sources:
        if key not in numeric:
            raise InputError(
                f"{where}: sources: {key} is not a number of this profile", f"Numbers: {', '.join(numeric)}."
            )


def _require_sense(where: str, profile: PrinterProfile) -> None:
    for name, values in _numbers(profile):
        if not all(math.isfinite(value) for value in values):
            raise InputError(
                f"{where}: {name}: expected a finite number, got {values[0]}", _compare_with_shipped()
            )
    thinnest = max(profile.min_wall_supported_mm, profile.min_wall_mm)
    if profile.wall_mm < thinnest:
        raise InputError(
            f"{where}: wall_mm: expected at least min_wall_mm and min_wall_supported_mm ({thinnest}), "
            f"got {profile.wall_mm}",
            "The wall to design to cannot be thinner than the thinnest wall that prints.",
        )
    if profile.process == "fdm" and profile.nozzle_mm == 0:
        raise InputError(
            f"{where}: nozzle_mm: expected more than 0 for process fdm",
            "A filament printer's walls follow its nozzle.",
        )
    if profile.wall_by_size != tuple(sorted(profile.wall_by_size)):
        raise InputError(
            f"{where}: wall_by_size: expected ascending sizes", "Sort the pairs by their first number."
        )
    if profile.slicer_command and not any("{input}" in word for word in profile.slicer_command):
        raise InputError(
            f"{where}: slicer_command: expected {{input}} in one of its arguments, found none",
            'It stands for the part\'s file: slicer_command = ["my-slicer", "--output", "{output}", "{input}"].',
        )


def _plain(message: str) -> str:
    """msgspec's message in words: "Expected `float`, got `str` - at `$.layer_mm`" names the key first."""
    if missing := re.fullmatch(r"Object missing required field `(\w+)`", message):
        return f"{missing[1]}: expected a value, found none"
    parts = re.fullmatch(r"(?P<what>.*?)(?: - at `\$\.?(?P<key>.*)`)?", message, re.DOTALL)
    if parts is None:
        return message
    what = re.sub(r"`(\w+)(?: \| null)?`", lambda kind: _KINDS.get(kind[1], kind[1]), parts["what"])
    what = what.replace("Expected", "expected").replace(
        "Invalid enum value", f"expected {' or '.join(get_args(Process))}, got"
    )
    return f"{parts['key']}: {what}" if parts["key"] else what


def _compare_with_shipped() -> str:
    return "Compare with a shipped profile: fabcraft printers show prusa-mk4."
