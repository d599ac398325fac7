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
    guidance_transform: str | None = None,
    show_input: str | None = None,
    json: bool = False,
) -> int:
    """Tell what is understood of a drawing, words or a mesh, without making anything.

    Examples:

      fabcraft guidance cat.png --show-input understood.png
      fabcraft guidance --text "a cat with a star" --show-input chosen.png
      fabcraft guidance bust.stl --body woman --json
      fabcraft guidance horned.glb --template helmet --show-input lies.png
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
    guidance_transform
        Where the mesh lies: its 4 x 4 matrix to the body's space, mm, as transform in a .toml or .json file.
    show_input
        Also write a picture of what was understood of a drawing, or of how the mesh lies on the body (.png).
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
        require_png(show_input, [file, body, guidance_transform or ""])
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
        mesh = read_mesh(file, largest_mm=np.inf)
        base = plain(template, wearer.found(body))
        told, used = _of_mesh(mesh, file, base, guidance_transform or "")
        if show_input is not None:
            from fabcraft.write.bodies import beside_body

            told["files"] = written_png(show_input, beside_body(base.body, used))
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


def _of_mesh(mesh: "Mesh", file: str, base: "Template", transform: str) -> tuple[dict[str, Any], "Mesh"]:
    """What to say of a mesh, and the mesh as it is used, where it lies on the body."""
    from fabcraft.guidance.alignment import placed_by

    told: dict[str, Any] = {
        "route": [f"guidance mesh {Path(file).name}, {len(mesh.faces):,} faces"],
        "understood": "a mesh",
        "outline_closed": True,
        "holes": 0,
        "strokes": 0,
        "residual": [],
        "warnings": [],
    }
    if base.kind == "sheet":
        from fabcraft.guidance.target import target_relief

        made = target_relief(mesh, base, transform=placed_by(transform), force=True)
        width, height = np.ptp(made.relief.outline, axis=0)
        used, placed, miss, limit = made.mesh, made.placed, made.residual, made.limit
        told["route"].append(f"placed: {width:.0f} x {height:.0f} mm")
        told["understood"] = f"an outline, {len(made.relief.openings)} openings"
        told["holes"], told["warnings"] = len(made.relief.openings), list(made.notes)
    else:
        from fabcraft.geometry.distance import SurfaceDistance
        from fabcraft.guidance.alignment import WORST
        from fabcraft.guidance.target_points import TargetPoints
        from fabcraft.recipe import Recipe
        from fabcraft.road.base import as_solid
        from fabcraft.road.guided import goal_on

        recipe = Recipe(template=base.name, guidance=file, guidance_transform=transform, force=True)
        rest = as_solid(base)
        body = SurfaceDistance(base.body.mesh)
        goal, notes = goal_on(mesh, rest, recipe, base, body)
        used, placed, miss, limit = goal.mesh, goal.placed, goal.residual, WORST
        points = TargetPoints.of(used, rest)
        told["route"] += [goal.words, points.describe()]
        told["warnings"] = list(notes)
    if miss > limit and not transform:
        told["warnings"].append(
            f"It misses the template by {100.0 * miss:.0f} % of its size; more than {100.0 * limit:.0f} % "
            "is refused, unless forced."
        )
    told |= {"misses": miss, "limit": limit, "transform": placed.matrix.tolist()}
    return told, used


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
