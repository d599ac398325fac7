"""Cura's definitions (.def.json): `overrides` over the settings of what they inherit, up to `fdmprinter`.

A setting has a `default_value`, and may have a `value` that goes before it: a number, or an expression of other
settings. An expression that only names another setting is followed; any other is not computed, and what it
would say counts as not told. The nozzle is often in the definition of the first extruder, in `../extruders`.
"""

import math
import re
from pathlib import Path
from typing import Any

from fabcraft.errors import InputError
from fabcraft.presets.machine import Machine, number, words
from fabcraft.presets.parents import Reader, beside, with_parents

Settings = dict[str, dict[str, Any]]

_MOST_SETTINGS = 20_000


def machine_of_cura(table: dict[str, Any], path: Path, read: Reader) -> Machine:
    """The printer of a definition.  Raises `InputError`, also for a parent that does not lie beside the file."""
    file = path.name
    metadata = _table(table.get("metadata"))
    if "extruder" in (metadata.get("type"), table.get("inherits")) or table.get("inherits") == "fdmextruder":
        raise InputError(f"{file} is an extruder, not a machine", "Import the machine's definition.")
    settings = _resolved(table, path, read)
    nozzle_file = file
    trains = _table(metadata.get("machine_extruder_trains"))
    train = words(trains.get("0"), "")
    for folder in (path.parent, path.parent.parent / "extruders"):
        if (extruder := beside(folder, train, ".def.json")) is not None:
            own = _own(read(extruder))
            if "machine_nozzle_size" in own:
                settings = settings | {"machine_nozzle_size": own["machine_nozzle_size"]}
                nozzle_file = extruder.name
            break

    def told(key: str, most: float) -> float | None:
        return number(_value(settings, key), key, file, most=most)

    sides = [told(f"machine_{side}", 10_000.0) for side in ("width", "depth", "height")]
    if None in sides:
        raise InputError(
            f"{file} tells no machine_width, machine_depth and machine_height",
            "It is no machine's definition.",
        )
    x, y, z = (float(side or 0) for side in sides)
    rectangle = [(0.0, 0.0), (x, 0.0), (x, y), (0.0, y)]
    turns = [2 * math.pi * step / 64 for step in range(64)]
    ellipse = [(x / 2 * math.cos(turn), y / 2 * math.sin(turn)) for turn in turns]
    level = told("support_angle", 90.0)
    banned = _value(settings, "machine_disallowed_areas")
    return Machine(
        title=words(table.get("name"), path.stem),
        process="fdm",
        bed=ellipse if _value(settings, "machine_shape") == "elliptic" else rectangle,
        height_mm=z,
        nozzle_mm=told("machine_nozzle_size", 10.0),
        layer_mm=told("layer_height", 5.0),
        line_width_mm=told("line_width", 20.0),
        max_overhang_deg=level,
        density_g_cm3=None,
        told={
            "build_mm": f"{file}: machine_width, machine_depth, machine_height",
            "nozzle_mm": f"{nozzle_file}: machine_nozzle_size",
            "layer_mm": f"{file}: layer_height",
            "line_width_mm": f"{file}: line_width",
            "max_overhang_deg": f"{file}: support_angle",
        },
        notes=("A part of the bed is excluded in the slicer's file; the build volume here is the whole bed.",)
        if isinstance(banned, list) and banned
        else (),
    )


def _resolved(table: dict[str, Any], path: Path, read: Reader) -> Settings:
    chain = with_parents(
        table,
        path,
        read,
        name=path.name.removesuffix(".def.json"),
        ending=".def.json",
        missing=", or import the file where Cura keeps both: in resources/definitions of its installation "
        "(share/cura/resources/definitions).",
    )
    whole: Settings = {}
    for one in reversed(chain):
        for key, setting in _own(one).items():
            whole[key] = whole.get(key, {}) | setting
    return whole


def _own(table: dict[str, Any]) -> Settings:
    """The settings that a definition describes or overrides itself, by key, however deep they lie."""
    found: Settings = {}
    waiting = [_table(table.get("settings"))]
    while waiting and len(found) < _MOST_SETTINGS:
        for key, setting in waiting.pop().items():
            if isinstance(setting, dict):
                found[key] = {name: setting[name] for name in ("default_value", "value") if name in setting}
                waiting.append(_table(setting.get("children")))
    for key, setting in _table(table.get("overrides")).items():
        found[key] = found.get(key, {}) | _table(setting)
    return found


def _value(settings: Settings, key: str) -> Any:
    """The value of a setting; None when it is not told, or is an expression."""
    for _ in range(8):
        setting = settings.get(key, {})
        if "value" not in setting:
            return setting.get("default_value")
        value = setting["value"]
        if not isinstance(value, str):
            return value
        text = value.strip().removeprefix("=").strip()
        if re.fullmatch(r"-?\d+(\.\d+)?", text):
            return float(text)
        if quoted := re.fullmatch(r"'([^']*)'", text):
            return quoted[1]
        if not re.fullmatch(r"[a-z_]\w*", text):
            return None
        key = text
    return None


def _table(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}
