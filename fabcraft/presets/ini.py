"""PrusaSlicer's .ini: a whole configuration, or a bundle of presets that inherit from each other.

A *configuration* (File > Export > Export Config, or `prusa-slicer --save`) is flat. A *bundle* has sections
`[printer:NAME]`, `[print:NAME]`, `[filament:NAME]` (resin: `sla_print`, `sla_material`); `inherits = A; B`
takes A, then B over it, then the section's own keys. Names in asterisks are bases, not printers. A preset of
the user's own is exported whole and names a system preset as its parent all the same: that parent may be
missing.
"""

from dataclasses import replace
from difflib import get_close_matches

from fabcraft.errors import InputError
from fabcraft.presets.machine import Machine, bed, number, width, words

Section = dict[str, str]
Sections = dict[tuple[str, str], Section]
"""By kind and name; a flat configuration is ("", "")."""

_DEEPEST = 40
_LISTED = 12


def parse_ini(text: str) -> Sections:
    """Sections of `key = value` lines; # and ; begin a comment; a later key wins."""
    sections: Sections = {}
    current = sections.setdefault(("", ""), {})
    for line in text.splitlines():
        line = line.strip()
        if not line or line[0] in "#;":
            continue
        if line[0] == "[" and line[-1] == "]":
            kind, _, name = line[1:-1].partition(":")
            current = sections.setdefault((kind.strip(), name.strip()), {})
        elif "=" in line:
            key, _, value = line.partition("=")
            current[key.strip()] = value.strip()
    return sections


def machine_of_ini(text: str, file: str, preset: str | None) -> Machine:
    """The printer in a configuration or a bundle.

    preset : which one of a bundle; may be left out when there is one, or one is selected in the bundle.
    Raises `InputError`.
    """
    sections = parse_ini(text)
    names = [name for kind, name in sections if kind == "printer" and name and not _is_base(name)]
    if not names:
        if preset is not None:
            raise InputError(
                f"{file} holds no bundle, so there is no {preset!r} to choose", "Leave --preset out."
            )
        flat = sections["", ""]
        return _machine(
            flat, flat, flat, file, words(flat.get("printer_settings_id"), file.removesuffix(".ini"))
        )
    selected = sections.get(("presets", ""), {})
    name = _chosen(names, preset or _only(names) or selected.get("printer"), file, preset is not None)
    printer = _resolved(sections, "printer", name, file)
    resin = printer.get("printer_technology") == "SLA"
    kinds = ("sla_print", "sla_material") if resin else ("print", "filament")
    found = []
    for kind in kinds:
        by_default = printer.get(f"default_{kind}_profile", "").split(";")[0].strip().strip('"')
        wanted = selected.get(kind, by_default) if selected.get("printer") == name else by_default
        found.append(_resolved(sections, kind, wanted, file) if (kind, wanted) in sections else {})
    return _machine(printer, found[0], found[1], file, name)


def _is_base(name: str) -> bool:
    return name.startswith("*") and name.endswith("*")


def _only(names: list[str]) -> str | None:
    return names[0] if len(names) == 1 else None


def _chosen(names: list[str], wanted: str | None, file: str, asked: bool) -> str:
    if wanted in names:
        return wanted
    shown = ", ".join(names[:_LISTED]) + (f" and {len(names) - _LISTED} more" if len(names) > _LISTED else "")
    if asked:
        close = get_close_matches(str(wanted), names, n=3, cutoff=0.4)
        hint = f"; did you mean {' or '.join(close)}?" if close else ""
        raise InputError(f"{file} has no printer {str(wanted)[:80]!r}{hint}", f"It has: {shown}.")
    raise InputError(
        f"{file} is a bundle of {len(names)} printers", f"Choose one with --preset NAME: {shown}."
    )


def _resolved(sections: Sections, kind: str, name: str, file: str) -> Section:
    """The section with all that it inherits.  Raises `InputError` for a circle, and for a parent that is missed."""
    done: dict[str, Section] = {}

    def visit(name: str, above: tuple[str, ...]) -> Section:
        if name in done:
            return done[name]
        if name in above or len(above) > _DEEPEST:
            raise InputError(
                f"{file}: [{kind}:{name[:80]}] inherits from itself, or through more than {_DEEPEST} presets",
                "Export the bundle anew from PrusaSlicer.",
            )
        own = sections[kind, name]
        whole: Section = {}
        parents = [one.strip().strip('"') for one in own.get("inherits", "").split(";") if one.strip()]
        missing = [one for one in parents if (kind, one) not in sections]
        for parent in parents:
            if parent not in missing:
                whole |= visit(parent, (*above, name))
        # a preset of the user's own is exported whole, and the rules stand in for print settings
        if missing and kind == "printer" and "bed_shape" not in own:
            raise InputError(
                f"{file}: [{kind}:{name[:80]}] inherits from {missing[0][:80]!r}, which is not in the file",
                "Export the whole bundle (File > Export > Export Config Bundle With Physical Printers), or the active "
                "configuration (File > Export > Export Config), which is flat.",
            )
        done[name] = whole | own
        return done[name]

    return visit(name, ())


def _machine(printer: Section, prints: Section, material: Section, file: str, name: str) -> Machine:
    """The values of a printer, its print settings and its filament or resin."""
    if "bed_shape" not in printer:
        raise InputError(
            f"{file} tells no bed (bed_shape)",
            "It is no printer's file. In PrusaSlicer: File > Export > Export Config.",
        )
    resin = printer.get("printer_technology") == "SLA"
    height = number(printer.get("max_print_height"), "max_print_height", file)
    if height is None:
        raise InputError(f"{file} tells no height (max_print_height)", "Export it anew from PrusaSlicer.")
    layer = number(prints.get("layer_height"), "layer_height", file, most=5.0)
    machine = Machine(
        title=words(name, file),
        process="sla" if resin else "fdm",
        bed=bed(printer["bed_shape"], "bed_shape", file),
        height_mm=height,
        layer_mm=layer,
        told={"build_mm": f"{file}: bed_shape, max_print_height", "layer_mm": f"{file}: layer_height"},
    )
    if resin:
        exposure = number(material.get("exposure_time"), "exposure_time", file)
        return replace(
            machine, exposure_s=exposure, told=machine.told | {"exposure_s": f"{file}: exposure_time"}
        )
    line, key = None, ""
    for key in ("perimeter_extrusion_width", "extrusion_width"):
        # a share is one of the layer height here, unlike in other slicers
        line = width(prints.get(key), layer, key, file)
        if line is not None:
            break
    level = number(prints.get("support_material_threshold"), "support_material_threshold", file, most=90.0)
    return replace(
        machine,
        nozzle_mm=number(printer.get("nozzle_diameter"), "nozzle_diameter", file, most=10.0),
        line_width_mm=line,
        max_overhang_deg=None if level is None else 90.0 - level,
        density_g_cm3=number(material.get("filament_density"), "filament_density", file, most=30.0),
        told=machine.told
        | {
            "nozzle_mm": f"{file}: nozzle_diameter",
            "line_width_mm": f"{file}: {key}",
            "max_overhang_deg": f"{file}: 90 less support_material_threshold",
            "density_g_cm3": f"{file}: filament_density",
        },
    )
