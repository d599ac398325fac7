"""`fabcraft printers`: list the printer profiles, show one, or make one of a slicer's file."""

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from fabcraft.cli.catalogue import PLAIN, listed, worded
from fabcraft.cli.console import painted, result, result_json, table
from fabcraft.errors import InputError

if TYPE_CHECKING:
    from fabcraft.profile import PrinterProfile

printers = App("printers", help="List the printer profiles, show one, or import one from a slicer.")
printers.default_parameter, printers.help_epilogue, printers.sort_key = PLAIN, "", 11


@printers.default
def list_printers(*, json: bool = False) -> int:
    """List the printer profiles.

    Parameters
    ----------
    json
        Print JSON.
    """
    from fabcraft.profile import list_profiles

    found = list_profiles()
    if json:
        result_json([{"name": one.name, "title": one.title, "process": one.process} for one in found])
        return 0
    rows = [("name", "printer", "process", "build volume, mm", "wall, mm")]
    for one in found:
        rows.append(
            (
                one.name,
                one.title,
                one.process,
                " x ".join(f"{side:g}" for side in one.build_mm),
                f"{one.wall_mm:g}",
            )
        )
    result(listed(rows))
    return 0


@printers.command(name="show")
def show_printer(name: str, /, *, json: bool = False) -> int:
    """Show every number of a profile, and where it comes from.

    Parameters
    ----------
    name
        A name from `fabcraft printers`, or a TOML file.
    json
        Print JSON.
    """
    from fabcraft.profile import load_profile

    profile = load_profile(name)
    if json:
        result_json(_told(profile))
    else:
        result(_shown(profile))
    return 0


@printers.command(name="import")
def import_printer(
    file: str,
    /,
    *,
    name: str | None = None,
    preset: str | None = None,
    output: Annotated[str | None, Parameter(name=("--output", "-o"))] = None,
    json: bool = False,
) -> int:
    """Make a printer profile of a file that PrusaSlicer, OrcaSlicer, Bambu Studio or Cura wrote.

    Examples:

      fabcraft printers import config.ini --name my-printer
      fabcraft printers import PrusaResearch.ini --preset "Original Prusa MK4S 0.4 nozzle" -o mk4s.toml
      fabcraft printers import "Creality Ender-3 0.4 nozzle.json" -o ender3.toml

    What a slicer does not know (walls that hold, clearances, tolerance) follows by rules that the profile names.

    Parameters
    ----------
    file
        A .ini of PrusaSlicer (configuration or bundle), a machine's or all settings' .json of OrcaSlicer or Bambu
        Studio, or a .def.json of Cura.  Parents have to lie beside it.
    name
        What --printer shall take. [default: made of the printer's own name]
    preset
        Which printer of a PrusaSlicer bundle.
    output
        File to write, .toml. [default: NAME.toml among your own profiles, where --printer NAME finds it]
    json
        Print the profile as JSON.
    """
    from fabcraft.presets.load import import_printer as imported
    from fabcraft.presets.load import profile_name, profile_toml
    from fabcraft.write.atomic import write_atomically
    from fabcraft.write.places import require_places, write_together

    if output is not None and not output.endswith(".toml"):
        raise InputError(f"{output} is no .toml file", "Give -o NAME.toml.")
    if name is None and output is not None:
        name = Path(output).stem
    profile = imported(file, None if name is None else profile_name(name), preset)
    place = Path(output) if output is not None else _own_place(profile.name)
    require_places([place], [file])
    text = profile_toml(profile).encode("utf-8")
    write_together([(place, lambda: write_atomically(place, text))])
    if json:
        result_json(_told(profile) | {"files": [str(place)]})
        return 0
    use = profile.name if output is None else output
    lines = [_shown(profile), "", f"wrote {place}", f"Use it: fabcraft check part.stl --printer {use}"]
    result("\n".join(lines))
    return 0


def _own_place(name: str) -> Path:
    """A new file among the user's own profiles.  Raises `InputError` where a profile of that name is found already."""
    from fabcraft.profile import list_profiles, own_folder

    if name in [one.name for one in list_profiles()]:
        raise InputError(
            f"there is a printer profile {name} already",
            "Give another --name, or the file to write with -o FILE.toml.",
        )
    folder = own_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"cannot create the folder {folder}: {error.strerror}",
            "Give the file to write with -o FILE.toml.",
        ) from error
    return folder / f"{name}.toml"


def _told(profile: "PrinterProfile") -> dict[str, object]:
    """The profile's values; what it does not tell is absent."""
    values = {entry.name: getattr(profile, entry.name) for entry in fields(profile)}
    return {key: value for key, value in values.items() if value not in (None, ())}


def _shown(profile: "PrinterProfile") -> str:
    """The profile as a table with its sources, and its notes."""
    rows = []
    for key, value in _told(profile).items():
        if key not in ("name", "title", "notes", "sources"):
            text = " x ".join(f"{one:g}" for one in profile.build_mm) if key == "build_mm" else worded(value)
            rows.append((key, text, profile.sources.get(key, "")))
    lines = [painted(f"{profile.name}: {profile.title}", "bold"), "", table(rows)]
    return "\n".join(lines + (["", profile.notes] if profile.notes else []))
