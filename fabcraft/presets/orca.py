"""JSON of OrcaSlicer and Bambu Studio: a machine, or all settings of a project.

A *machine* file tells bed (`printable_area`), height and nozzle, and leaves the rest to its parent: `inherits`
is the parent's name, its file lies beside it as `NAME.json`. Layer and line width are in a *process* file, which
the machine names as `default_print_profile`. A *resolved* file (`--export-settings`, or
`Metadata/project_settings.config` in a project's 3MF) holds all of them and inherits nothing that matters.
"""

from pathlib import Path
from typing import Any

from fabcraft.errors import InputError
from fabcraft.presets.machine import Machine, bed, number, width, words
from fabcraft.presets.parents import Reader, beside, with_parents


def machine_of_orca(table: dict[str, Any], path: Path, read: Reader) -> Machine:
    """The printer in a machine file or in resolved settings.  Raises `InputError`."""
    file = path.name
    kind = table.get("type")
    if kind in ("process", "filament", "machine_model"):
        raise InputError(
            f"{file} is a {str(kind).replace('_', ' ')}, not a machine",
            "Import the file of type machine, which tells the bed: NAME 0.4 nozzle.json.",
        )
    whole = _resolved(table, path, read)
    for key in ("printable_area", "printable_height"):
        if not whole.get(key):
            raise InputError(f"{file} tells no {key}", "It is no machine's file; export the printer's.")
    process = _process(whole, path, read)
    nozzle = number(whole.get("nozzle_diameter"), "nozzle_diameter", file, most=10.0)
    level = number(process.get("support_threshold_angle"), "support_threshold_angle", file, most=90.0)
    excluded = whole.get("bed_exclude_area")
    height = number(whole["printable_height"], "printable_height", file)
    if height is None:
        raise InputError(f"{file}: printable_height is zero", "Export the printer anew.")
    line, key = None, ""
    for key in ("inner_wall_line_width", "line_width"):
        line = width(process.get(key), nozzle, key, file)
        if line is not None:
            break
    other = "" if process is whole else f" of the process {words(process.get('name'), 'beside it')}"
    return Machine(
        title=words(whole.get("printer_settings_id") if kind is None else whole.get("name"), path.stem),
        process="fdm",
        bed=bed(whole["printable_area"], "printable_area", file),
        height_mm=height,
        nozzle_mm=nozzle,
        layer_mm=number(process.get("layer_height"), "layer_height", file, most=5.0),
        line_width_mm=line,
        max_overhang_deg=None if level is None else 90.0 - level,
        density_g_cm3=number(whole.get("filament_density"), "filament_density", file, most=30.0),
        told={
            "build_mm": f"{file}: printable_area, printable_height",
            "nozzle_mm": f"{file}: nozzle_diameter",
            "layer_mm": f"{file}: layer_height{other}",
            "line_width_mm": f"{file}: {key}{other}",
            "max_overhang_deg": f"{file}: 90 less support_threshold_angle{other}",
            "density_g_cm3": f"{file}: filament_density",
        },
        notes=("A part of the bed is excluded in the slicer's file; the build volume here is the whole bed.",)
        if isinstance(excluded, list) and len(excluded) > 2
        else (),
    )


def _resolved(table: dict[str, Any], path: Path, read: Reader) -> dict[str, Any]:
    """The table with what it inherits.  Raises `InputError` for a parent that is missing, or a circle."""
    # the settings of a whole project are complete, whatever preset they began as
    chain = with_parents(
        table,
        path,
        read,
        name=words(table.get("name"), path.stem),
        ending=".json",
        missing=": the slicer keeps it in its configuration folder (Help > Show Configuration Folder) under "
        "system/VENDOR/machine, and in its sources under resources/profiles/VENDOR/machine. Or export all settings: "
        "orca-slicer --export-settings all.json.",
        complete=_is_whole,
    )
    whole: dict[str, Any] = {}
    for one in reversed(chain):
        whole |= one
    return whole


def _is_whole(table: dict[str, Any]) -> bool:
    return "printable_area" in table and "layer_height" in table


def _process(machine: dict[str, Any], path: Path, read: Reader) -> dict[str, Any]:
    """Where layer and line width stand: in the same table, or the machine's process, where its files are at hand."""
    if "layer_height" in machine:
        return machine
    name = words(machine.get("default_print_profile"), "")
    for folder in (path.parent, path.parent.parent / "process"):
        file = beside(folder, name, ".json")
        if file is not None:
            try:
                return _resolved(read(file), file, read)
            except InputError:
                return {}  # a parent of the process is missing: the rules hold instead, and say so
    return {}
