"""A photograph or an illustration becomes a `Drawing`: the object's outline, the edges inside it, and its shading.

The object is told from its background (`foreground`); the outline is that of a drawn shape.  Edges are Canny's (1986), of
the lightness freed of texture by a bilateral filter; closed ones become regions or eyes, long ones strokes.  Shading is the
lightness between two blurs: what is lighter than its neighbourhood stands out, as if lit from the front.  That is a
draughtsman's reading of light and shade, not a measurement; `InflateSettings.shade_height_mm` says how much it counts.
"""

from typing import Literal

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8
from scipy import ndimage

from fabcraft.errors import InputError
from fabcraft.guidance.drawing import Drawing
from fabcraft.guidance.edges import understand
from fabcraft.guidance.eyes import find_eyes
from fabcraft.guidance.foreground import By
from fabcraft.guidance.foreground import foreground as foreground_of
from fabcraft.guidance.ink import working_copy
from fabcraft.guidance.outline import fill_contour, outline_of, trim
from fabcraft.guidance.parts import parts_of
from fabcraft.guidance.symmetry import mirror_axis

LINE = 0.007  # of the longer side: how thick an edge is drawn
SHORTEST = 0.06  # of the object's longer side: a shorter edge is texture
MOST_EDGES = 40
FINE, COARSE = 0.008, 0.06  # of the object's longer side: the two blurs between which shading lies

Mask = Bool[np.ndarray, "H W"]
Grey = Float32[np.ndarray, "H W"]


def read_as(picture: UInt8[np.ndarray, "H W 4"], foreground: By | Literal[""] = "") -> Drawing:
    """A picture as a line drawing, or as a photograph when a way to tell its object apart is named."""
    return understand_photograph(picture, foreground) if foreground else understand(picture)


def understand_photograph(rgba: UInt8[np.ndarray, "H W 4"], by: By = "auto") -> Drawing:
    """The `Drawing` of the object in a picture, (H, W, 4) uint8 RGBA of any size.

    Raises `InputError` when no object can be told from its background, `MissingError` when `by` needs rembg.
    """
    rgba = working_copy(rgba)
    found = foreground_of(rgba, by)
    width = max(3.0, LINE * max(rgba.shape[:2]))
    margin = int(4 * width) + 4
    shape = trim(ndimage.binary_fill_holes(np.pad(found.mask, margin)), width)
    if not shape.mask.any():
        raise InputError("the object in the picture is thinner than a line", "Give a larger picture of it.")
    outline = outline_of(shape, width)
    around = fill_contour(outline, shape.mask.shape)
    light = np.pad(_lightness(rgba), margin, mode="edge")
    seen = np.pad(found.mask, margin)
    side = float(max(np.ptp(outline, axis=0)))
    rim = around & ~_within(around, width)
    parts = parts_of(rim | _edges(light, around, seen, width, side), around, width)
    loops = tuple(loop.moved(-float(margin)) for loop in parts.loops)
    silhouette = around[margin:-margin, margin:-margin]
    axis = mirror_axis(silhouette)
    eyes = find_eyes(loops, silhouette, axis)
    rest = [loop.contour for loop in loops if not any(loop is eye for eye in eyes)]
    border = np.concatenate([silhouette[0], silhouette[-1], silhouette[:, 0], silhouette[:, -1]])
    cut = ("The object reaches the border of the picture; what lies beyond is missing.",)
    return Drawing(
        width=rgba.shape[1],
        height=rgba.shape[0],
        silhouette=silhouette,
        outline=outline - margin,
        eyes=tuple(eye.contour for eye in eyes),
        holes=(),
        regions=tuple(rest),
        strokes=tuple(stroke - margin for stroke in parts.strokes),
        stroke_width_px=width,
        outline_closed=True,
        gap_closed_px=0.0,
        symmetry_axis_px=axis.column_px,
        symmetry_tilt_deg=axis.tilt_deg,
        symmetry_iou=axis.iou,
        warnings=cut if border.any() else (),
        shade=_shade(light, around, side)[margin:-margin, margin:-margin],
        told_apart=f"the object was found by {found.words}",
    )


def _lightness(rgba: UInt8[np.ndarray, "H W 4"]) -> Grey:
    """CIELAB lightness 0-1, texture smoothed and edges kept; what is transparent has its neighbours' lightness."""
    rgb, clear = rgba[..., :3], rgba[..., 3] < 128
    if clear.any():
        nearest = ndimage.distance_transform_edt(clear, return_distances=False, return_indices=True)
        rgb = rgb[tuple(nearest)]
    smooth = cv2.bilateralFilter(np.ascontiguousarray(rgb), 9, 30.0, 5.0)
    return cv2.cvtColor(smooth.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)[..., 0] / 100


def _within(mask: Mask, depth: float) -> Mask:
    return cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5) > depth


def _edges(light: Grey, around: Mask, seen: Mask, width: float, side: float) -> Mask:
    """Edges and see-through holes inside the object as lines of `width`, without what lies along its rim."""
    inner = _within(around, 2.5 * width)
    grey = (255 * light.clip(0, 1)).astype(np.uint8)
    slope = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))[inner]
    high = float(np.clip(np.percentile(slope, 96) if slope.size else 0.0, 70.0, 250.0))
    edge = (cv2.Canny(grey, 0.4 * high, high, L2gradient=True) > 0) & inner
    edge |= ndimage.binary_dilation(~seen & inner) & seen
    labels, count = ndimage.label(edge, np.ones((3, 3)))
    size = np.bincount(labels.ravel(), minlength=count + 1)[1:]
    kept = [k for k in np.argsort(-size)[:MOST_EDGES] if size[k] > SHORTEST * side]
    lines = np.isin(labels, np.array(kept, int) + 1)
    return cv2.distanceTransform((~lines).astype(np.uint8), cv2.DIST_L2, 5) <= width / 2


def _shade(light: Grey, around: Mask, side: float) -> Grey:
    """-1 to 1: lighter or darker than the neighbourhood inside the object, fading to 0 at its rim."""
    inside = around.astype(np.float32)

    def blurred(sigma: float) -> Grey:
        total = cv2.GaussianBlur(light * inside, (0, 0), sigma)
        return total / np.maximum(cv2.GaussianBlur(inside, (0, 0), sigma), 1e-3)

    band = (blurred(FINE * side) - blurred(COARSE * side)) * around
    usual = float(np.percentile(np.abs(band[around]), 95))
    fade = np.clip(cv2.distanceTransform(around.astype(np.uint8), cv2.DIST_L2, 5) / (0.03 * side), 0, 1)
    return (np.clip(band / max(usual, 0.04), -1, 1) * fade).astype(np.float32)
