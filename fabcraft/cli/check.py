"""`fabcraft check`: would this file print?  Measures, never changes; needs no torch, so it starts fast."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from fabcraft.cli.console import result, say, show_report
from fabcraft.cli.slicing import UNSLICED, SliceFlags
from fabcraft.cli.wearer import Units
from fabcraft.mesh import Mesh

if TYPE_CHECKING:
    from fabcraft.check.inspect import Inspection
    from fabcraft.check.report import PrintReport
    from fabcraft.profile import PrinterProfile

WRONG, THIN = (214, 40, 40), (244, 150, 40)
"""Colours of the faces in `--problems`, sRGB."""


def check(
    file: str,
    /,
    *,
    printer: str,
    units: Units | None = None,
    json: bool = False,
    html: str | None = None,
    problems: str | None = None,
    slicing: SliceFlags = UNSLICED,
) -> int:
    """Check whether a mesh file would print, and say what to do where it would not.

    Examples:

      fabcraft check part.stl --printer prusa-mk4
      fabcraft check part.3mf --printer form4 --html report.html --problems bad.ply

    Parameters
    ----------
    file
        STL, OBJ, PLY, GLB or 3MF.
    printer
        Printer profile: a name from `fabcraft printers`, or a TOML file.
    units
        Unit of the file; millimetres for STL, OBJ and PLY when left out.
    json
        Print the report as JSON, and nothing else, on stdout.
    html
        Also write a page with a 3D view and the wall's thickness in colours.
    problems
        Also write the faces that are wrong (red) or too thin (orange), as .ply, .glb or .stl.
    """
    from fabcraft.profile import load_profile
    from fabcraft.write.files import checked_extension

    places = [Path(place) for place in (html, problems) if place]
    if problems:
        checked_extension(problems)
    if places:
        from fabcraft.write.places import require_places

        require_places(places, [file, printer])
    profile = load_profile(printer)
    slicing.require(profile, map(str, places), [file, printer])
    from fabcraft.check.inspect import inspect_mesh
    from fabcraft.read.mesh_file import read_mesh

    mesh = read_mesh(file, units)
    inspection = inspect_mesh(mesh, profile, route=(f"read {Path(file).name}",))
    inspection = replace(inspection, report=slicing.told(inspection.report, mesh, profile))
    report = _written(inspection, mesh, profile, html, problems) if places else inspection.report
    if json:
        result(report.to_json().rstrip("\n"))
    else:
        show_report(report, profile.title)
    return int(not report.printable)


def _written(
    inspection: "Inspection", mesh: "Mesh", profile: "PrinterProfile", html: str | None, problems: str | None
) -> "PrintReport":
    """The report, after its page and the faces that are wrong were written."""
    import numpy as np

    from fabcraft.write.camera import VIEWS
    from fabcraft.write.files import write_mesh
    from fabcraft.write.page import write_page
    from fabcraft.write.picture import Item, png_bytes, scene_picture
    from fabcraft.write.places import write_together

    topology, thickness = inspection.topology, inspection.thickness
    wrong = np.zeros(len(mesh.faces), bool) if topology is None else topology.problem_faces.copy()
    bad = wrong.copy()
    if thickness is not None:
        bad[thickness.faces[thickness.thin]] = True
    if problems and not bad.any():
        say(f"no face is wrong or too thin: {problems} was not written")
        problems = None
    files = tuple(name for name in (html, problems) if name)
    report = replace(inspection.report, files=(*inspection.report.files, *files))
    jobs: list[tuple[Path, Callable[[], object]]] = []
    if problems:
        part, colours = mesh.submesh(bad), None
        if Path(problems).suffix.lower() != ".stl":
            # every face its own corners, so that a colour stays on its face
            part = Mesh(
                part.corners.reshape(-1, 3), np.arange(3 * len(part.faces), dtype=np.int32).reshape(-1, 3)
            )
            colours = np.where(wrong[bad, None], WRONG, THIN).astype(np.uint8).repeat(3, axis=0)
        place = Path(problems)
        jobs.append((place, lambda: write_mesh(place, part, colours=[colours])))
    if html:
        views = {"front": "Front", "three_quarter": "Three quarters", "back": "Back"}
        pictures = {
            words: png_bytes(scene_picture([Item(mesh)], VIEWS[view])) for view, words in views.items()
        }
        values = None if thickness is None else thickness.vertex_values(mesh)
        page = Path(html)
        wall = profile.wall_mm
        shown = lambda: write_page(page, report.to_dict(), mesh, None, values, None, pictures, wall_mm=wall)  # noqa: E731
        jobs.append((page, shown))
    write_together(jobs)
    return report
