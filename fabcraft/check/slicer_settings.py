"""`slicer_ini`: a flat PrusaSlicer configuration made of a printer profile; the rest is the slicer's default."""

from fabcraft.check.gcode import FILAMENT_MM
from fabcraft.profile import PrinterProfile

INFILL_PERCENT = 15
"""Of the inside that no wall fills, where nobody asks for another."""
_PIXEL_MM = 0.2
"""Of the layer pictures for resin: they are measured, not printed, and finer ones take minutes."""


def slicer_ini(profile: PrinterProfile, supports: bool = True, infill_percent: int = INFILL_PERCENT) -> str:
    """The configuration for a filament or resin printer, one `key = value` a line."""
    values = _resin(profile, supports) if profile.process == "sla" else _filament(profile, supports)
    if profile.process != "sla":
        values["fill_density"] = f"{infill_percent}%"
        # the slicer's own pattern cannot fill completely
        values["fill_pattern"] = "rectilinear" if infill_percent >= 100 else "grid"
    return "".join(f"{key} = {value}\n" for key, value in values.items())


def _machine(profile: PrinterProfile) -> dict[str, str]:
    x, y, z = (f"{side:g}" for side in profile.build_mm)
    return {
        "bed_shape": f"0x0,{x}x0,{x}x{y},0x{y}",
        "max_print_height": z,
        "layer_height": f"{profile.layer_mm:g}",
    }


def _filament(profile: PrinterProfile, supports: bool) -> dict[str, str]:
    bead = profile.bead_mm
    return {
        "printer_technology": "FFF",
        "gcode_flavor": "marlin",
        **_machine(profile),
        "nozzle_diameter": f"{profile.nozzle_mm:g}",
        "filament_diameter": f"{FILAMENT_MM:g}",
        "filament_density": f"{profile.density_g_cm3 or 0:g}",
        "first_layer_height": f"{profile.layer_mm:g}",
        "extrusion_width": f"{bead:g}",
        "first_layer_extrusion_width": f"{bead:g}",
        "perimeters": str(max(2, round(profile.wall_mm / bead))),
        "skirts": "0",
        "temperature": "215",
        "first_layer_temperature": "215",
        "bed_temperature": "60",
        "first_layer_bed_temperature": "60",
        "support_material": str(int(supports)),
        "support_material_threshold": f"{90 - profile.max_overhang_deg:g}",
        "use_relative_e_distances": "0",
    }


def _resin(profile: PrinterProfile, supports: bool) -> dict[str, str]:
    x, y, _ = profile.build_mm
    exposure = profile.exposure_s or 0
    values = {
        "printer_technology": "SLA",
        **_machine(profile),
        "initial_layer_height": f"{profile.layer_mm:g}",
        "display_width": f"{x:g}",
        "display_height": f"{y:g}",
        "display_pixels_x": str(max(1, round(x / _PIXEL_MM))),
        "display_pixels_y": str(max(1, round(y / _PIXEL_MM))),
        "display_orientation": "landscape",
        "supports_enable": str(int(supports)),
        "pad_enable": "0",
    }
    if exposure:
        values |= {
            "exposure_time": f"{exposure:g}",
            "initial_exposure_time": f"{10 * exposure:g}",
            "max_exposure_time": f"{20 * exposure:g}",
            "max_initial_exposure_time": f"{20 * exposure:g}",
        }
    return values
