"""`fabcraft solid`: any surface becomes a closed object of a given wall, clear of a body if there is one."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from fabcraft.cli.console import Progress, result, show_report
from fabcraft.cli.plate import AS_IT_IS, PlateFlags
from fabcraft.cli.slicing import UNSLICED, SliceFlags
from fabcraft.cli.wearer import Units
from fabcraft.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fabcraft.check.report import PrintReport
    from fabcraft.geometry.distance import SurfaceDistance
    from fabcraft.mesh import Mesh
    from fabcraft.plate import Prepared
    from fabcraft.profile import PrinterProfile
    from fabcraft.solid.plate_settings import PlateSettings
    from fabcraft.solid.thicken import SolidSettings


def solid(
    file: str,
    /,
    *,
    output: Annotated[str | None, Parameter(name=("--output", "-o"))] = None,
    printer: str | None = None,
    wall: float | None = None,
    body: str | None = None,
    body_units: Units | None = None,
    clearance: float | None = None,
    units: Units | None = None,
    slicing: SliceFlags = UNSLICED,
    plate: PlateFlags = AS_IT_IS,
    json: bool = False,
    quiet: bool = False,
) -> int:
    """Make a printable solid of a surface: close it, repair it, give it a wall.

    Examples:

      fabcraft solid surface.obj --wall 1.6 -o part.3mf
      fabcraft solid shell.stl --printer form4 --body head.ply -o part.3mf
      fabcraft solid helmet.stl --printer prusa-mini --orient --split -o parts.3mf

    Parameters
    ----------
    file
        STL, OBJ, PLY, GLB or 3MF.
    output
        File to write: .3mf, .stl, .glb or .ply.
    printer
        Printer profile; the result is checked for it, and its wall is the default.
    wall
        Thickness in mm of sheets, and least thickness of solids.
    body
        man, woman, teenager, child, toddler, or a mesh file, in the surface's own coordinates: what comes
        nearer to it than the clearance is cut away.
    body_units
        Unit of the body's file.
    clearance
        Distance kept from the body, mm. [default: 0.5]
    units
        Unit of the file; millimetres for STL, OBJ and PLY when left out.
    json
        Print the report as JSON, and nothing else, on stdout.
    quiet
        No progress on stderr.
    """
    settings, profile, place = _asked(file, output, printer, wall, body, clearance)
    slicing.require(profile, [output or ""], [file, body or "", printer or ""])
    how = plate.settings()
    if how.asked and profile is None:
        raise InputError(
            "no printer was named to prepare the object for", "Give --printer NAME (see fabcraft printers)."
        )
    from fabcraft.geometry.distance import SurfaceDistance
    from fabcraft.read.mesh_file import read_mesh
    from fabcraft.solid.thicken import solidify

    with Progress(quiet) as progress:
        progress.tell("read", 0, 1)
        surface = read_mesh(file, units)
        if profile is not None and wall is None:  # large parts may need more
            settings = replace(settings, wall_mm=profile.for_size(surface.size_mm).wall_mm)
        distance = None if body is None else SurfaceDistance(_skin(body, body_units))
        progress.tell("solid", 0, 1)
        made = solidify(surface, settings, distance)
        progress.tell("check", 0, 1)
        ready = None if profile is None or not how.asked else _prepared(made.mesh, profile, how, distance)
        report = _report(made.mesh, made.notes, profile, distance, settings.clearance_mm, ready)
        steps = ("made solid", *(ready.route if ready else ()))
        report = replace(report, route=(f"read {Path(file).name}", *steps), files=(str(place),))
        if profile is not None and slicing.slice:
            progress.tell("slice", 0, 1)
            report = slicing.told(report, ready.whole if ready else made.mesh, profile)
        _write(place, ready.pieces if ready else (made.mesh,), report)
    if json:
        result(report.to_json().rstrip("\n"))
    else:
        show_report(report, profile.title if profile else "")
    return int(report.failed)


def _asked(
    file: str,
    output: str | None,
    printer: str | None,
    wall: float | None,
    body: str | None,
    clearance: float | None,
) -> "tuple[SolidSettings, PrinterProfile | None, Path]":
    """The settings, the profile and the place that the flags mean.  Raises `InputError`."""
    if output is None:
        raise InputError("no output was named", "Give -o OUT.3mf, for example -o part.3mf.")
    if printer is None and wall is None:
        raise InputError(
            "neither a printer nor a wall was given", "Give --wall MM, or --printer NAME for its own wall."
        )
    if clearance is not None and body is None:
        raise InputError("a clearance was given, but no body to keep it from", "Give --body as well.")
    from fabcraft.profile import load_profile
    from fabcraft.solid.thicken import SolidSettings
    from fabcraft.write.files import checked_extension
    from fabcraft.write.places import require_places

    checked_extension(output)
    require_places([output], [file, body or "", printer or ""])
    profile = None if printer is None else load_profile(printer)
    thickness = wall if profile is None or wall is not None else profile.wall_mm
    assert thickness is not None
    settings = SolidSettings(wall_mm=thickness, clearance_mm=0.5 if clearance is None else clearance)
    return settings, profile, Path(output)


def _skin(body: str, units: str | None) -> "Mesh":
    """The surface of a built-in person, or the one in a file.  Raises `InputError` for neither."""
    from fabcraft.body.human import PRESETS, human
    from fabcraft.read.mesh_file import read_mesh

    path = Path(body)
    if body not in PRESETS and (path.suffix or path.exists()):
        return read_mesh(path, units)
    return human(body).mesh


def _report(
    mesh: "Mesh",
    notes: tuple[str, ...],
    profile: "PrinterProfile | None",
    distance: "SurfaceDistance | None",
    clearance_mm: float,
    ready: "Prepared | None",
) -> "PrintReport":
    """Checked for the printer, as it lies there; without one, only whether it is a sound solid."""
    from fabcraft.check.inspect import Worn, inspect_mesh
    from fabcraft.check.report import Finding, PrintReport
    from fabcraft.check.topology import inspect_topology, topology_findings

    said = tuple(
        Finding(check="solid", severity="note", advice=f"{text[:1].upper()}{text[1:].rstrip('.')}.")
        for text in notes
    )
    if profile is not None:
        worn = None if distance is None else Worn(body=distance, object=mesh, clearance_mm=clearance_mm)
        if ready is None:
            report = inspect_mesh(mesh, profile, worn=worn).report
            return replace(report, findings=(*report.findings, *said))
        report = inspect_mesh(ready.whole, profile, worn=worn, pieces=ready.pieces).report
        findings = (*report.findings, *ready.findings, *said)
        return replace(report, findings=findings, metrics={**report.metrics, **ready.numbers})
    topology = inspect_topology(mesh)
    counted = ("faces", "open_edges", "facets_reversed", "parts", "genus", "self_intersections")
    metrics = {name: getattr(topology, name) for name in counted if getattr(topology, name) is not None}
    metrics |= {"size_mm": tuple(mesh.size_mm.tolist()), "volume_mm3": mesh.volume_mm3}
    advice = "No printer was named, so walls, overhangs and size were not checked; give --printer for that."
    aside = Finding(check="printer", severity="note", advice=advice)
    return PrintReport(
        findings=(*topology_findings(topology), *said, aside),
        unchecked="walls, overhangs and size, as no printer was named",
        metrics=metrics,
    )


def _prepared(
    mesh: "Mesh", profile: "PrinterProfile", how: "PlateSettings", distance: "SurfaceDistance | None"
) -> "Prepared":
    """The solid as it is asked on the plate; its skin side is what looks at the body."""
    from fabcraft.plate import on_skin, prepare

    return prepare(mesh, profile, how, None if distance is None else on_skin(mesh, distance))


def _write(place: Path, meshes: "Sequence[Mesh]", report: "PrintReport") -> None:
    import json

    from fabcraft.outputs import NOT_IN_3MF
    from fabcraft.write.files import write_mesh
    from fabcraft.write.places import write_together

    carried = {key: value for key, value in report.to_dict().items() if key not in NOT_IN_3MF}
    text = json.dumps(carried, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    write_together([(place, lambda: write_mesh(place, meshes, report_json=text))])
