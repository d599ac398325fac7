"""Where a motif sits in its frame: its box in the middle of the plate, as large as fits, a user's wish on top."""

import numpy as np

from fabcraft.geometry.contour import counter_clockwise
from fabcraft.guidance.drawing import Drawing
from fabcraft.guidance.placement import PlacedDrawing, PlacementSettings
from fabcraft.template.template import Template


def place_motif(
    drawing: Drawing, plate: Template, settings: PlacementSettings | None = None, units_per_mm: float = 1.0
) -> PlacedDrawing:
    """The drawing on a plate, in the plate's picture units.

    Drawn eyes are kept as closed regions: a motif is looked at, not through.
    units_per_mm : picture units per mm, for a user's shift, which is in mm.
    """
    settings = settings or PlacementSettings()
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
        tuple(laid(stroke) for stroke in drawing.strokes),
        drawing.stroke_width_px * scale,
        scale,
        False,
        (),
    )
