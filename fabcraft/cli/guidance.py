"""`fabcraft guidance`: what is understood of a drawing or a mesh, before anything is made of it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from cyclopts import Parameter

from fabcraft.cli.console import painted, result, result_json
from fabcraft.cli.wearer import ANYBODY, Wearer
from fabcraft.errors import InputError
from fabcraft.template.kinds import known

if TYPE_CHECKING:
    from fabcraft.guidance.drawing import Drawing
    from fabcraft.mesh import Mesh
    from fabcraft.template.template import Template


def guidance(
    file: str = "",
    /,
    *,
    text: str | None = None,
    template: str = "mask",
    body: str = "man",
    wearer: Wearer = ANYBODY,
    reading: Annotated[Literal["object", "motif"] | None, Parameter(name="--as")] = None,
    foreground: Literal["auto", "alpha", "grabcut", "rembg"] | None = None,
    show_input: str | None = None,
    json: bool = False,
) -> int:
    """Tell what is understood of a drawing, words or a mesh, without making anything.

    Examples:

      fabcraft guidance cat.png --show-input understood.png
      fabcraft guidance --text "a cat with a star" --show-input chosen.png
      fabcraft guidance bust.stl --body woman --json
      fabcraft guidance brooch.jpg --template necklace --foreground auto

    Parameters
    ----------
    file
        A picture of a line drawing (PNG, JPEG, WebP or SVG), a photograph, or a mesh to look like.
    text
        Words instead of a file: the drawing that the library of subjects has for them.
    template
        A name from fabcraft templates.
    body
        A name from fabcraft bodies, or the file of a scan.
    reading
        What the drawing shows: the object, or a motif to be worked into it.
    foreground
        The picture is a photograph or an illustration: how its object is told from the background: auto (its transparency,
        else GrabCut), alpha, grabcut or rembg.
    show_input
        Also write a picture of what was understood of a drawing (.png).
    json
        Print JSON.
    """
    known(template)
    if bool(file) == bool(text):
        raise InputError(
            "both a file and a text were given" if file else "neither a file nor a text was given",
            'Give one: fabcraft guidance cat.png, or fabcraft guidance --text "a cat".',
        )
    if show_input is not None:
        require_png(show_input, [file, body])
    drawing: "Drawing | None" = None
    from fabcraft.fitting_room import plain
    from fabcraft.guidance.photograph import read_as
    from fabcraft.guidance.show import picture_of
    from fabcraft.read.image_file import read_image
    from fabcraft.read.mesh_file import FORMATS, read_mesh

    if text:
        from fabcraft.recipe import Recipe
        from fabcraft.road.text import text_drawing

        recipe = Recipe(template=template, text=text, via="subjects", reading=reading or "")
        drawing, route, notes = text_drawing(recipe)
        drawing, told = _of_drawing(drawing, list(route), plain(template, wearer.found(body)), reading)
        told["warnings"] = [*notes, *told["warnings"]]
    elif Path(file).suffix.lower().removeprefix(".") in FORMATS:
        mesh = read_mesh(file)
        told = _of_mesh(mesh, Path(file).name, plain(template, wearer.found(body)))
    else:
        drawing = read_as(read_image(file), foreground or "")
        kind = "photograph" if drawing.told_apart else "sketch"
        origin = [f"{kind} {Path(file).name}, {drawing.width} x {drawing.height} pixels"]
        origin += [drawing.told_apart] if drawing.told_apart else []
        drawing, told = _of_drawing(drawing, origin, plain(template, wearer.found(body)), reading)
    if show_input is not None and drawing is not None:
        told["files"] = written_png(show_input, picture_of(drawing))
    if json:
        result_json(told)
        return 0
    lines = [*told["route"], told["understood"]]
    lines += [painted("warn", "warn") + f" {text}" for text in told["warnings"]]
    lines += [painted("note", "note") + f" left out: {text}" for text in told["residual"]]
    result("\n".join([*lines, *wrote(told)]))
    return 0


def _of_drawing(
    drawing: "Drawing", origin: list[str], base: "Template", reading: str | None
) -> tuple["Drawing", dict[str, Any]]:
    """The drawing, its openings told by what the template needs, and what to say of it."""
    from fabcraft.guidance.motif import place_motif, with_openings
    from fabcraft.guidance.placement import place
    from fabcraft.road.motif import frame_of
    from fabcraft.template.motif_plate import plate

    if base.kind == "sheet":
        placed, scale, where = place(drawing, base), 1.0, ""
    else:
        frame, (across, down) = frame_of(base, "", reading or ""), np.ptp(drawing.outline, axis=0)
        sheet, space = plate(
            base, frame, None, None if frame.openings and frame.depth_mm else float(across / down)
        )
        placed, scale, where = place_motif(drawing, sheet), space.scale, f" on the {frame.name}"
        drawing = with_openings(drawing, sheet)
    width, height = np.ptp(placed.outline, axis=0) / scale
    by = ("eyes" if base.kind == "sheet" else "openings") if placed.by_eyes else "outline"
    counts = (
        f"{len(drawing.eyes)} eyes, {len(drawing.holes)} openings, {len(drawing.regions)} regions, "
        f"{len(drawing.strokes)} strokes"
    )
    return drawing, {
        "route": [
            *origin,
            f"placed by the drawn {by}: {width:.0f} x {height:.0f} mm{where}",
        ],
        "understood": f"an outline, {counts}",
        "outline_closed": drawing.outline_closed,
        "holes": len(placed.openings),
        "strokes": len(drawing.strokes),
        "residual": list(drawing.dropped),
        "warnings": [*drawing.warnings, *placed.notes],
    }


def _of_mesh(mesh: "Mesh", name: str, base: "Template") -> dict[str, Any]:
    told: dict[str, Any] = {
        "route": [f"guidance mesh {name}, {len(mesh.faces):,} faces"],
        "understood": "a mesh",
        "outline_closed": True,
        "holes": 0,
        "strokes": 0,
        "residual": [],
        "warnings": [],
    }
    if base.kind == "sheet":
        from fabcraft.guidance.placement import PlacementSettings
        from fabcraft.guidance.target import target_relief

        relief, said = target_relief(mesh, base, PlacementSettings())
        width, height = np.ptp(relief.outline, axis=0)
        told["route"].append(f"placed: {width:.0f} x {height:.0f} mm")
        return told | {
            "understood": f"an outline, {len(relief.openings)} openings",
            "holes": len(relief.openings),
            "warnings": list(said),
        }
    from fabcraft.guidance.alignment import aligned

    told["route"].append(aligned(mesh, base.mesh).words)
    return told


def require_png(place: str, inputs: list[str]) -> None:
    """Raise `InputError` for a picture that could not be written afterwards."""
    from fabcraft.write.places import require_places

    if Path(place).suffix.lower() != ".png":
        raise InputError(f"cannot write {place}: pictures are written as PNG", "End the name in .png.")
    require_places([place], inputs)


def written_png(place: str, image: np.ndarray) -> list[str]:
    """The picture in its file; returns what was written."""
    from fabcraft.write.atomic import write_atomically
    from fabcraft.write.picture import png_bytes
    from fabcraft.write.places import write_together

    write_together([(Path(place), lambda: write_atomically(place, png_bytes(image)))])
    return [place]


def wrote(told: dict[str, Any]) -> list[str]:
    """Lines that name the files of an answer."""
    return ["", *(f"wrote {file}" for file in told["files"])] if "files" in told else []
