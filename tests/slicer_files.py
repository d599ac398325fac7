"""Short files with the keys and structure of those that slicers export."""

import json
from pathlib import Path

BUNDLE = """# Print profiles for some printers.

[vendor]
repo_id = some-fff
name = Some Maker
config_version = 1.1.0

[printer_model:SWING]
name = Some Swing
variants = 0.4; 0.6
technology = FFF

[print:*common*]
layer_height = 0.15
extrusion_width = 0.45
perimeter_extrusion_width = 0
support_material_threshold = 50
fill_density = 15%

[print:*0.24mm*]
inherits = *common*
layer_height = 0.24

[print:0.24mm DRAFT @SWING]
inherits = *common*; *0.24mm*
compatible_printers_condition = printer_model=="SWING"

[sla_print:0.05 Normal]
layer_height = 0.05

[filament:*PLA*]
filament_density = 1.24
filament_diameter = 1.75

[filament:Generic PLA @SWING]
inherits = *PLA*

[sla_material:Grey @0.05]
exposure_time = 2.5

[printer:*common*]
printer_technology = FFF
bed_shape = 0x0,200x0,200x180,0x180
max_print_height = 190
start_gcode = G28 ; home = yes\\nG1 Z5

[printer:*SWING*]
inherits = *common*
bed_shape = 5x5,305x5,305x225,5x225
max_print_height = 300
default_print_profile = 0.24mm DRAFT @SWING
default_filament_profile = "Generic PLA @SWING"

[printer:*0.6nozzle*]
nozzle_diameter = 0.6

[printer:Some Swing (0.6 mm nozzle)]
inherits = *SWING*; *0.6nozzle*

[printer:Some Swing (0.4 mm nozzle)]
inherits = *SWING*
nozzle_diameter = 0.4

[printer:Some Screen]
printer_technology = SLA
bed_shape = 0x0,143.43x0,143.43x89.6,0x89.6
display_width = 143.43
max_print_height = 175
default_sla_print_profile = 0.05 Normal
default_sla_material_profile = Grey @0.05
"""
"""A vendor's bundle for PrusaSlicer."""

ORCA_MACHINE = {
    "type": "machine",
    "name": "Some Swing 0.4 nozzle",
    "from": "system",
    "instantiation": "true",
    "inherits": "fdm_some_common",
    "printer_model": "Some Swing",
    "default_print_profile": "0.20mm Standard @Some",
    "nozzle_diameter": ["0.4"],
    "printable_area": ["0x0", "220x0", "220x210", "0x210"],
    "bed_exclude_area": ["0x0", "18x0", "18x28", "0x28"],
    "machine_max_speed_x": ["500", "500"],
}
ORCA_COMMON = {
    "type": "machine",
    "name": "fdm_some_common",
    "inherits": "fdm_machine_common",
    "printable_height": "250",
    "nozzle_diameter": ["0.6"],
}
ORCA_ROOT = {
    "type": "machine",
    "name": "fdm_machine_common",
    "printable_height": "100",
    "gcode_flavor": "marlin",
}
ORCA_PROCESS = {
    "type": "process",
    "name": "0.20mm Standard @Some",
    "inherits": "fdm_process_common",
    "layer_height": "0.2",
}
ORCA_PROCESS_ROOT = {
    "type": "process",
    "name": "fdm_process_common",
    "line_width": "0.45",
    "inner_wall_line_width": "105%",
    "support_threshold_angle": "40",
}
ORCA_RESOLVED = {
    "from": "project",
    "inherits": "a preset that went into it",
    "printer_settings_id": "Some Box 0.4 nozzle",
    "printable_area": ["0x0", "256x0", "256x256", "0x256"],
    "printable_height": "250",
    "nozzle_diameter": ["0.4"],
    "layer_height": "0.16",
    "line_width": "0.42",
    "filament_density": ["1.27"],
}

CURA = {
    "version": 2,
    "name": "Some Swing",
    "inherits": "some_base",
    "metadata": {"visible": True, "machine_extruder_trains": {"0": "some_extruder_0"}},
    "overrides": {
        "machine_width": {"default_value": 230},
        "line_width": {"value": "machine_nozzle_size"},
        "wall_line_width_x": {"value": "line_width - 0.05"},
        "machine_start_gcode": {"default_value": "G28 ;Home\nG1 Z2.0"},
    },
}
CURA_BASE = {
    "version": 2,
    "name": "Some base",
    "inherits": "fdmprinter",
    "overrides": {
        "machine_width": {"default_value": 200},
        "machine_depth": {"default_value": 220},
        "machine_height": {"default_value": 260},
        "layer_height": {"value": "0.2"},
    },
}
CURA_ROOT = {
    "name": "FDM Printer Base Description",
    "version": 2,
    "metadata": {"type": "machine"},
    "settings": {
        "machine_settings": {
            "type": "category",
            "children": {
                "machine_width": {"default_value": 100, "type": "float"},
                "machine_shape": {"default_value": "rectangular"},
                "machine_nozzle_size": {"default_value": 0.4},
            },
        },
        "resolution": {
            "children": {
                "layer_height": {"default_value": 0.1},
                "line_width": {
                    "default_value": 0.4,
                    "value": "machine_nozzle_size",
                    "children": {"wall_line_width": {"default_value": 0.4, "value": "line_width"}},
                },
            }
        },
        "support": {"children": {"support_angle": {"default_value": 50}}},
    },
}
CURA_EXTRUDER = {
    "version": 2,
    "name": "Extruder 1",
    "inherits": "fdmextruder",
    "overrides": {"machine_nozzle_size": {"default_value": 0.5}},
}


def put(folder: Path, files: dict[str, object]) -> Path:
    """Write files, text or JSON, into a folder; the path of the first."""
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return folder / next(iter(files))


def orca(folder: Path) -> Path:
    """A machine with its parents and its process where the slicer keeps them."""
    return put(
        folder,
        {
            "machine/Some Swing 0.4 nozzle.json": ORCA_MACHINE,
            "machine/fdm_some_common.json": ORCA_COMMON,
            "machine/fdm_machine_common.json": ORCA_ROOT,
            "process/0.20mm Standard @Some.json": ORCA_PROCESS,
            "process/fdm_process_common.json": ORCA_PROCESS_ROOT,
        },
    )


def cura(folder: Path) -> Path:
    """A definition with its parents and its extruder."""
    return put(
        folder,
        {
            "definitions/some_swing.def.json": CURA,
            "definitions/some_base.def.json": CURA_BASE,
            "definitions/fdmprinter.def.json": CURA_ROOT,
            "extruders/some_extruder_0.def.json": CURA_EXTRUDER,
        },
    )
