"""`profile_of`: a printer profile from what a slicer's file tells; the rest follows by stated rules.

A slicer knows bed, nozzle, layer and line width, but no wall that holds, no clearance and no tolerance. Those
are derived: walls and strokes from the line width and nozzle, the rest as in the shipped profiles of the same
process. Every derived number says so in its source, and the profile is not `verified`.
"""

from typing import Any

from fabcraft.presets.machine import Machine
from fabcraft.profile import PrinterProfile

_SHIPPED = "as the shipped profiles of this process"
_FILAMENT = (
    ("min_hole_mm", 2.0),
    ("clearance_moving_mm", 0.5),
    ("clearance_fit_mm", 0.2),
    ("max_overhang_deg", 45.0),
    ("max_bridge_mm", 10.0),
    ("drain_hole_mm", 0.0),
    ("tolerance_mm", 0.3),
    ("tolerance_percent", 0.3),
)
_RESIN = (
    ("nozzle_mm", 0.0),
    ("min_wall_supported_mm", 0.5),
    ("min_wall_mm", 1.0),
    ("wall_mm", 1.0),
    ("min_emboss_width_mm", 0.4),
    ("min_emboss_height_mm", 0.4),
    ("min_engrave_mm", 0.4),
    ("min_hole_mm", 0.5),
    ("clearance_moving_mm", 0.5),
    ("clearance_fit_mm", 0.15),
    ("max_overhang_deg", 0.0),
    ("max_bridge_mm", 0.0),
    ("drain_hole_mm", 4.0),
    ("tolerance_mm", 0.02),
    ("tolerance_percent", 0.2),
)
_TOLD = ("nozzle_mm", "layer_mm", "line_width_mm", "max_overhang_deg", "density_g_cm3", "exposure_s")


def profile_of(machine: Machine, where: str) -> PrinterProfile:
    """The profile.  where : the file, for errors.  Raises `InputError` for a bed that cannot be used."""
    values: dict[str, Any] = {}
    sources: dict[str, str] = {}

    def derive(name: str, value: float, rule: str) -> None:
        if name not in values:
            values[name], sources[name] = round(value, 4), f"derived: {rule}"

    values["build_mm"], said = machine.build_mm(where)
    sources["build_mm"] = machine.told["build_mm"] + said
    for name in _TOLD:
        if (value := getattr(machine, name)) is not None:
            values[name], sources[name] = value, machine.told[name]
    if machine.process == "fdm":
        derive("nozzle_mm", 0.4, "the file tells none; the usual one")
        nozzle = values["nozzle_mm"]
        derive("layer_mm", nozzle / 2, "half the nozzle")
        derive("line_width_mm", 1.125 * nozzle, "1.125 nozzles, as slicers choose it")
        line = values["line_width_mm"]
        derive("min_wall_supported_mm", 2 * line, "2 x line width")
        derive("min_wall_mm", 2 * line, "2 x line width")
        derive("wall_mm", 3 * line, "3 x line width")
        derive("min_emboss_width_mm", 1.5 * nozzle, "1.5 x nozzle")
        derive("min_emboss_height_mm", 2 * values["layer_mm"], "2 x layer height")
        derive("min_engrave_mm", 1.5 * nozzle, "1.5 x nozzle")
    else:
        derive("layer_mm", 0.05, "the file tells none; the usual one of resin")
    for name, value in _FILAMENT if machine.process == "fdm" else _RESIN:
        derive(name, value, _SHIPPED)
    return PrinterProfile(
        title=machine.title,
        process=machine.process,
        verified=False,
        notes=" ".join(machine.notes),
        sources={name: sources[name] for name in values},
        **values,
    )
