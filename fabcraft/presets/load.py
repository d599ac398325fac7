"""`import_printer`: a slicer's export becomes a printer profile.  `profile_toml`: the profile as its file.

The kind of file is told by its content, not by its name. Sizes are bounded, parents are looked for beside the
file only, and what comes out is read back as any profile is before it is given away.
"""

import json
import re
from dataclasses import fields
from pathlib import Path
from typing import Any

from fabcraft.errors import InputError
from fabcraft.presets.cura import machine_of_cura
from fabcraft.presets.derive import profile_of
from fabcraft.presets.ini import machine_of_ini
from fabcraft.presets.orca import machine_of_orca
from fabcraft.profile import PrinterProfile, parse_profile

MAX_BYTES = 8_000_000
"""The largest bundle there is has 1.3 MB."""


def import_printer(path: Path | str, name: str | None = None, preset: str | None = None) -> PrinterProfile:
    """The profile of the printer in a file of PrusaSlicer, OrcaSlicer, Bambu Studio or Cura.

    name : what `--printer` shall take; made of the printer's title when left out.
    preset : which printer of a PrusaSlicer bundle.
    Raises `InputError` for a file that cannot be read, tells no printer, or lacks a parent.
    """
    path = Path(path)
    text = _text(path)
    if text.lstrip().startswith("{") or path.suffix.lower() == ".json":
        table = _object(text, path)
        if preset is not None:
            raise InputError(f"{path.name} is no bundle of PrusaSlicer", "Leave --preset out.")
        of = machine_of_cura if "overrides" in table or "settings" in table else machine_of_orca
        machine = of(table, path, _read)
    else:
        machine = machine_of_ini(text, path.name, preset)
    profile = profile_of(machine, path.name)
    chosen = profile_name(name if name is not None else profile.title)
    return parse_profile(profile_toml(profile), path.name, chosen)


def profile_name(title: str) -> str:
    """A name that `--printer` takes.  Raises `InputError` when nothing of the title can be used."""
    name = re.sub(r"[^a-z0-9.]+", "-", title.lower())[:60].strip("-.")
    if not name:
        raise InputError(
            f"{title[:60]!r} makes no name for a profile",
            "Give --name with letters or digits, for example my-printer.",
        )
    return name


def profile_toml(profile: PrinterProfile) -> str:
    """The profile as the flat TOML that `read_profile` reads."""
    lines = ["# Millimetres, degrees from the vertical. Each number's source is below."]
    for entry in fields(profile):
        value = getattr(profile, entry.name)
        if entry.name not in ("name", "sources") and value not in (None, (), ""):
            lines.append(f"{entry.name} = {_toml(value)}")
    lines += ["", "[sources]", *(f"{key} = {_toml(text)}" for key, text in profile.sources.items())]
    return "\n".join(lines) + "\n"


def _toml(value: Any) -> str:
    if isinstance(value, (tuple, list)):
        return f"[{', '.join(_toml(one) for one in value)}]"
    if isinstance(
        value, str
    ):  # JSON's strings are TOML's but for DEL and lone surrogates, which do not print
        value = "".join(one if one.isprintable() else " " for one in value)
    return json.dumps(value, ensure_ascii=False)


def _text(path: Path) -> str:
    try:
        size = path.stat().st_size
        if not path.is_file():
            raise InputError(f"{path} is no file", "Give a .ini or .json file that a slicer wrote.")
        if size > MAX_BYTES:
            raise InputError(
                f"{path} is {size:,} bytes; a printer's file has fewer than {MAX_BYTES:,}", "Check the path."
            )
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"there is no file {path}", "Check the path.") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"{str(path)!r} cannot be read: {reason}", "Check the path and its permissions."
        ) from None
    if data[:2] == b"PK":
        raise InputError(
            f"{path.name} is an archive, not a settings file",
            "Unpack it (unzip), then import the machine's .json, or Metadata/project_settings.config of a project.",
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(
            f"{path.name} is not text in UTF-8", "Give a .ini or .json file that a slicer wrote."
        ) from None


def _object(text: str, path: Path) -> dict[str, Any]:
    try:
        table = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"{path.name} is not valid JSON: {str(error)[:200]}", "Export it anew from the slicer."
        ) from None
    if not isinstance(table, dict):
        raise InputError(f"{path.name} is JSON, but no table of settings", "Give a file that a slicer wrote.")
    return table


def _read(path: Path) -> dict[str, Any]:
    return _object(_text(path), path)
