"""The library's drawings as pictures: clean lines on paper, and a contact sheet of many."""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import UInt8

from fabcraft.geometry.contour import signed_area
from fabcraft.guidance.drawing import Drawing
from fabcraft.guidance.subjects.library import OBJECTS

PAPER, INK, HEADING = (253, 250, 244), (46, 50, 62), (120, 118, 112)
TINTS = {
    "animals": (250, 226, 196), "water": (204, 229, 240), "plants": (213, 232, 206), "sky": (252, 238, 190),
    "symbols": (246, 214, 216), "monsters": (224, 216, 240), "sports": (214, 226, 246), "treats": (248, 220, 232),
    "things": (232, 226, 214), "objects": (228, 228, 224),
}  # fmt: skip
TILE, LABEL, COLUMNS, OVER = 220, 26, 12, 3
SPOT = 4200.0
"""A loop of a smaller area is inked, as eyes and nostrils are."""
_FONT = cv2.FONT_HERSHEY_DUPLEX


def portrait(drawing: Drawing, theme: str, side: int = 900) -> UInt8[np.ndarray, "S S 3"]:
    """(side, side, 3) uint8 RGB: the drawing in the middle, its inside in the theme's tint, eyes dark and holes bare."""
    tint = TINTS[theme]
    large = side * OVER
    page = np.full((large, large, 3), PAPER, np.uint8)
    scale = 0.86 * large / max(np.ptp(drawing.outline, axis=0))
    middle = 0.5 * (drawing.outline.min(0) + drawing.outline.max(0))

    def fixed(points: np.ndarray) -> np.ndarray:
        return np.round(((points - middle) * scale + large / 2) * 16).astype(np.int32)

    pen = max(2, round(drawing.stroke_width_px * scale * 1.1))
    cv2.fillPoly(page, [fixed(drawing.outline)], tint, cv2.LINE_AA, 4)
    deep = tuple(round(0.86 * channel) for channel in tint)
    for loop in drawing.regions:
        small = abs(signed_area(loop)) < SPOT
        cv2.fillPoly(page, [fixed(loop)], INK if small else deep, cv2.LINE_AA, 4)
    lenses = drawing.eyes if theme == OBJECTS else ()
    for hole in (*drawing.holes, *lenses):
        cv2.fillPoly(page, [fixed(hole)], PAPER, cv2.LINE_AA, 4)
    for eye in () if lenses else drawing.eyes:
        cv2.fillPoly(page, [fixed(eye)], INK, cv2.LINE_AA, 4)
        centre, radius = eye.mean(0), 0.16 * float(np.ptp(eye, axis=0).min())
        cv2.circle(page, fixed(centre + [radius, -radius]).tolist(), round(radius * scale * 16), PAPER, -1,
                   cv2.LINE_AA, 4)  # fmt: skip
    for line in (*drawing.regions, *drawing.holes, *drawing.eyes):
        cv2.polylines(page, [fixed(line)], True, INK, pen, cv2.LINE_AA, 4)
    for line in drawing.strokes:
        cv2.polylines(page, [fixed(line)], False, INK, pen, cv2.LINE_AA, 4)
    cv2.polylines(page, [fixed(drawing.outline)], True, INK, round(1.25 * pen), cv2.LINE_AA, 4)
    return cv2.resize(page, (side, side), interpolation=cv2.INTER_AREA)


def gallery(named: Sequence[tuple[str, str, Drawing]], columns: int = COLUMNS) -> UInt8[np.ndarray, "H W 3"]:
    """(H, W, 3) uint8 RGB: (name, theme, drawing) each in a tile with its name below."""
    rows = []
    for start in range(0, len(named), columns):
        tiles = [_tile(*one) for one in named[start : start + columns]]
        tiles += [np.full_like(tiles[0], PAPER)] * (min(columns, len(named)) - len(tiles))
        rows.append(np.hstack(tiles))
    return np.vstack(rows)


def _tile(name: str, theme: str, drawing: Drawing) -> UInt8[np.ndarray, "H W 3"]:
    tile = np.full((TILE + LABEL, TILE, 3), PAPER, np.uint8)
    tile[:TILE] = portrait(drawing, theme, TILE)
    (width, _), _ = cv2.getTextSize(name, _FONT, 0.5, 1)
    cv2.putText(tile, name, ((TILE - width) // 2, TILE + 12), _FONT, 0.5, HEADING, 1, cv2.LINE_AA)
    return tile
