"""Where a drawing sits in a frame: its box in the middle of the plate, as large as fits, a user's wish on top.

An object with openings (the bore of a ring, the lenses of glasses) is placed by them.
"""

from dataclasses import replace

import numpy as np

from fabcraft.errors import InputError
from fabcraft.geometry.contour import counter_clockwise, signed_area
from fabcraft.guidance.drawing import Drawing
from fabcraft.guidance.placement import PlacedDrawing, PlacementSettings, shading_of
from fabcraft.template.mask import room_around
from fabcraft.template.motif_plate import THICKNESS
from fabcraft.template.template import Template

_RIM = 1.5 * THICKNESS
"""Width of material around an opening, picture units."""
_BORE_SHARE = 0.08
"""A drawn loop of at least this share of the silhouette is the opening of an object that has one."""


def place_motif(
    drawing: Drawing, plate: Template, settings: PlacementSettings | None = None, units_per_mm: float = 1.0
) -> PlacedDrawing:
    """The drawing on a plate, in the plate's picture units.

    Drawn eyes are kept as closed regions: a motif is looked at, not through.  Where the plate has openings the drawing is
    the object itself: placed by its own openings if it has as many, and the plate's stay open.
    units_per_mm : picture units per mm, for a user's shift, which is in mm.
    """
    settings = settings or PlacementSettings()
    if plate.openings:
        return _place_object(drawing, plate, settings, units_per_mm)
    lower, upper = drawing.outline.min(0), drawing.outline.max(0)
    wanted = np.ptp(plate.outline, axis=0)
    scale = settings.scale * float((wanted / (upper - lower)).min())
    middle = 0.5 * (plate.outline.min(0) + plate.outline.max(0))
    middle = middle + units_per_mm * np.array([settings.left_mm, settings.up_mm])
    origin = 0.5 * (lower + upper)

    def laid(points: np.ndarray) -> np.ndarray:
        return middle + (points - origin) * [scale, -scale]

    return PlacedDrawing(
        counter_clockwise(laid(drawing.outline)),
        (),
        tuple(laid(loop) for loop in (*drawing.regions, *drawing.eyes)),
        tuple(laid(line) for line in drawing.lines),
        drawing.stroke_width_px * scale,
        scale,
        False,
        (),
        shading_of(drawing, laid(np.zeros(2)), scale),
    )


def with_openings(drawing: Drawing, plate: Template) -> Drawing:
    """The drawing, those of its loops told as holes that are the openings of the object it shows (bore, lenses)."""
    drawn = _drawn_openings(drawing, len(plate.openings)) if plate.openings else ()
    used = {id(loop) for loop in drawn}

    def others(loops: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
        return tuple(loop for loop in loops if id(loop) not in used)

    return replace(
        drawing,
        eyes=others(drawing.eyes),
        regions=others(drawing.regions),
        holes=(*others(drawing.holes), *drawn),
    )


def _place_object(
    drawing: Drawing, plate: Template, settings: PlacementSettings, units_per_mm: float
) -> PlacedDrawing:
    """The drawing of an object with as many openings as the plate has.

    Raises `InputError` when no material is left around an opening.
    """
    drawn = _drawn_openings(drawing, len(plate.openings))
    centres = np.array([opening.mean(0) for opening in plate.openings])
    if len(drawn) == 2:  # lenses: as far apart as the eyes are
        own = np.array([loop.mean(0) for loop in drawn])
        scale = float(np.linalg.norm(centres[1] - centres[0]) / np.linalg.norm(own[1] - own[0]))
    elif drawn:
        own = drawn[0].mean(0)[None]
        scale = float(np.sqrt(abs(signed_area(plate.openings[0]) / signed_area(drawn[0]))))
    else:
        own = 0.5 * (drawing.outline.min(0) + drawing.outline.max(0))[None]
        scale = float((np.ptp(plate.outline, axis=0) / np.ptp(drawing.outline, axis=0)).max())
    scale *= settings.scale
    middle = centres.mean(0) + units_per_mm * np.array([settings.left_mm, settings.up_mm])

    def laid(points: np.ndarray) -> np.ndarray:
        return middle + (points - own.mean(0)) * [scale, -scale]

    outline = counter_clockwise(laid(drawing.outline))
    openings = tuple(counter_clockwise(laid(loop)) for loop in drawn) if len(drawn) == 2 else plate.openings
    if (room := room_around(outline, openings)) < _RIM:
        raise InputError(
            f"the drawing leaves {max(room, 0.0) / units_per_mm:.1f} mm beside an opening of the {plate.name}, "
            f"{_RIM / units_per_mm:.1f} at least are needed",
            "Draw it with the opening in its place, or enlarge it (--scale).",
        )
    used = {id(loop) for loop in drawn}
    regions = tuple(laid(loop) for loop in (*drawing.regions, *drawing.eyes) if id(loop) not in used)
    strokes = tuple(laid(stroke) for stroke in drawing.strokes)
    width = drawing.stroke_width_px * scale
    shading = shading_of(drawing, laid(np.zeros(2)), scale)
    return PlacedDrawing(outline, openings, regions, strokes, width, scale, bool(drawn), (), shading)


def _drawn_openings(drawing: Drawing, count: int) -> tuple[np.ndarray, ...]:
    """The drawn loops that are the openings of an object that has `count`; none where they were not drawn."""
    if count == 2:
        return drawing.eyes
    least = _BORE_SHARE * float(drawing.silhouette.sum())
    loops = [
        loop for loop in (*drawing.holes, *drawing.regions, *drawing.eyes) if abs(signed_area(loop)) > least
    ]
    return tuple(sorted(loops, key=lambda loop: -abs(signed_area(loop)))[:1])
