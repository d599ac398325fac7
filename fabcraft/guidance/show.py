"""A picture of what was understood of a drawing: outline green, eyes red, regions blue, strokes orange,
axis grey.
"""

import cv2
import numpy as np
from jaxtyping import UInt8

from fabcraft.guidance.drawing import Drawing

OUTLINE, EYES, HOLES, REGIONS, STROKES, AXIS = (
    (28, 128, 64), (208, 40, 44), (208, 40, 44), (40, 96, 200), (236, 130, 20), (150, 150, 150),
)  # fmt: skip
PAPER, BODY = (255, 255, 255), (236, 245, 238)


def picture_of(drawing: Drawing) -> UInt8[np.ndarray, "H W 3"]:
    """(H, W, 3) uint8 RGB of the working image's size."""
    canvas = np.full((drawing.height, drawing.width, 3), PAPER, np.uint8)
    canvas[drawing.silhouette] = BODY
    thick = max(2, round(max(canvas.shape) / 320))
    _axis(canvas, drawing, max(1, thick // 2))
    for contour in drawing.regions:
        _tint(canvas, contour, REGIONS)
    for contour in (*drawing.eyes, *drawing.holes):
        cv2.fillPoly(canvas, [_fixed(contour)], PAPER, cv2.LINE_AA, 4)
    drawn = [
        (drawing.strokes, STROKES, False),
        (drawing.regions, REGIONS, True),
        (drawing.holes, HOLES, True),
    ]
    for lines, colour, closed in [*drawn, (drawing.eyes, EYES, True), ((drawing.outline,), OUTLINE, True)]:
        for line in lines:
            cv2.polylines(canvas, [_fixed(line)], closed, colour, thick, cv2.LINE_AA, 4)
    return canvas


def _fixed(points: np.ndarray) -> np.ndarray:
    """Points for OpenCV, whose pixel centres are whole numbers, in sixteenths."""
    return np.round((points - 0.5) * 16).astype(np.int32)


def _tint(canvas: np.ndarray, contour: np.ndarray, colour: tuple[int, int, int]) -> None:
    inside = np.zeros(canvas.shape[:2], np.uint8)
    cv2.fillPoly(inside, [_fixed(contour)], 1, cv2.LINE_8, 4)
    at = inside > 0
    canvas[at] = (0.8 * canvas[at] + 0.2 * np.array(colour)).astype(np.uint8)


def _axis(canvas: np.ndarray, drawing: Drawing, thick: int) -> None:
    lean = np.tan(np.radians(drawing.symmetry_tilt_deg)) * drawing.height / 2
    top, bottom = np.array(
        [[drawing.symmetry_axis_px + lean, 0.0], [drawing.symmetry_axis_px - lean, drawing.height]]
    )
    dashes = np.linspace(0, 1, 81)
    for a, b in zip(dashes[::2], dashes[1::2], strict=False):
        ends = _fixed(np.stack([top + a * (bottom - top), top + b * (bottom - top)]))
        cv2.line(canvas, ends[0].tolist(), ends[1].tolist(), AXIS, thick, cv2.LINE_AA, 4)
