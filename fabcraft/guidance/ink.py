"""Which pixels are ink: transparency, light on dark, uneven light and paper grain settled.

Darkness d = 1 - I / B with B the light of the bare paper: first a quadratic surface through the frame of the
picture, then an average over the paper around each pixel (ink left out, so a filled shape does not become
paper). The limit is Otsu's, taken near candidate ink only, where both classes are of like size.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8
from scipy import ndimage

from fabcraft.errors import InputError
from fabcraft.guidance.paper import without_table
from fabcraft.guidance.rules import without_rules

LEAST_SIDE = 600
MOST_SIDE = 1600
FAINTEST = 0.07  # darkness of ink against paper below which a page counts as blank
BLANK = "the picture is blank: no line stands out from the paper"
DARKER = "Draw darker, or photograph it in more light."

Grey = Float32[np.ndarray, "H W"]
Mask = Bool[np.ndarray, "H W"]


def working_copy(rgba: UInt8[np.ndarray, "H W 4"]) -> UInt8[np.ndarray, "h w 4"]:
    """The picture scaled so that its longer side is 600-1600 px."""
    side = max(rgba.shape[:2])
    scale = min(max(1.0, LEAST_SIDE / side), MOST_SIDE / side)
    if scale == 1.0:
        return rgba
    size = (max(1, round(rgba.shape[1] * scale)), max(1, round(rgba.shape[0] * scale)))
    return cv2.resize(rgba, size, interpolation=cv2.INTER_CUBIC if scale > 1 else cv2.INTER_AREA)


def ink(rgba: UInt8[np.ndarray, "H W 4"]) -> Mask:
    """(H, W) True where something was drawn.  Raises `InputError` when the page is blank."""
    dark = without_rules(darkness(without_table(_opaque(rgba))), 0.6 * FAINTEST)
    side = max(dark.shape)
    near = (
        cv2.dilate(
            (dark > 0.5 * max(FAINTEST, np.percentile(dark, 99.5))).astype(np.uint8), _disc(side / 120)
        )
        > 0
    )
    top = float(np.percentile(dark[near], 90)) if near.any() else 0.0
    if top < FAINTEST or near.mean() < 2e-4:
        raise InputError(BLANK, DARKER)
    scaled = np.clip(dark / top * 255, 0, 255).astype(np.uint8)
    limit = cv2.threshold(scaled[near].reshape(-1, 1), 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)[0]
    # Hysteresis: a line may grow faint as long as it hangs together with a firm one.
    firm, faint = scaled > limit, scaled > 0.72 * limit
    labels, count = ndimage.label(faint, np.ones((3, 3)))
    kept = np.zeros(count + 1, bool)
    kept[np.unique(labels[firm])] = True
    kept[0] = False
    mask = _without_specks(kept[labels])
    if not mask.any():
        raise InputError(BLANK, DARKER)
    return mask


def darkness(rgb: Float32[np.ndarray, "H W 3"]) -> Grey:
    """(H, W) share of the paper's light that the ink takes away, 0-1, from (H, W, 3) colours 0-1."""
    side = max(rgb.shape[:2])
    grey = rgb.mean(2)
    frame = _frame_light(grey)
    share = grey / frame
    darkest, lightest = np.log(np.percentile(share, [1, 99]) + 0.02)
    if np.median(frame) < 0.75 and lightest > -darkest:  # light on dark
        rgb = 1.02 - rgb
        grey = rgb.mean(2)
        frame = _frame_light(grey)
    rgb = cv2.GaussianBlur(rgb, (0, 0), max(0.5, side / 2000))
    half = cv2.resize(grey, (grey.shape[1] // 2, grey.shape[0] // 2), interpolation=cv2.INTER_AREA)
    closed = cv2.morphologyEx(half, cv2.MORPH_CLOSE, _disc(side / 100))
    closed = cv2.resize(closed, grey.shape[::-1], interpolation=cv2.INTER_LINEAR)
    bare = ~cv2.dilate(
        ((grey < 0.86 * closed) | (grey < 0.6 * frame)).astype(np.uint8), _disc(side / 250)
    ).astype(bool)
    light = np.stack([_paper_light(rgb[..., k], bare, side / 40) for k in range(3)], 2)
    taken = 1 - rgb / np.maximum(light, 0.02)
    # A coloured pen takes one colour away more than the others; that channel is also the noisiest.
    return np.clip(np.maximum(taken.mean(2), 0.8 * taken.max(2)), 0, 1).astype(np.float32)


def stroke_width(mask: Mask, percentile: float = 50.0) -> float:
    """Median (or another percentile) of the width of the drawn lines, pixels; of a page of filled shapes,
    about 1 % of the side.
    """
    usual = max(mask.shape) / 100
    filled = ndimage.binary_fill_holes(mask)
    deep = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    if mask.sum() > 0.6 * filled.sum() and deep.max() > 5 * usual:
        return usual
    ridge = mask & (deep >= ndimage.maximum_filter(deep, 3) - 0.01) & (deep < 4 * usual)
    width = float(np.percentile(2 * deep[ridge] - 1, percentile)) if ridge.sum() > 20 else usual
    return float(np.clip(width, 2.0, 4 * usual))


def one_line(mask: Mask) -> tuple[Mask, float]:
    """The mask with bundles of searching pencil lines grown together, and the width of its lines, pixels."""
    width = stroke_width(mask)
    r = int(width) + 2
    grown = cv2.distanceTransform((~np.pad(mask, r)).astype(np.uint8), cv2.DIST_L2, 5) <= 0.7 * width
    closed = (cv2.distanceTransform(grown.astype(np.uint8), cv2.DIST_L2, 5) > 0.7 * width)[r:-r, r:-r] | mask
    if closed.sum() < 1.04 * mask.sum():  # measured: single lines gain 1-3 %, three searching lines 5-6 %
        return mask, width
    return closed, stroke_width(closed, percentile=75.0)


def _opaque(rgba: UInt8[np.ndarray, "H W 4"]) -> Float32[np.ndarray, "H W 3"]:
    """Colours 0-1 over white, or over black when everything opaque is light."""
    rgb, alpha = rgba[..., :3].astype(np.float32) / 255, rgba[..., 3:].astype(np.float32) / 255
    seen = rgba[..., 3] > 127
    if seen.all():
        return rgb
    if not seen.any():
        raise InputError("the picture is fully transparent", "Export it with the drawing visible.")
    base = 1.0 if np.percentile(rgb.mean(2)[seen], 5) < 0.6 else 0.0
    return rgb * alpha + base * (1 - alpha)


def _frame_light(grey: Grey) -> Grey:
    """Quadratic surface through the picture's frame (8 % wide), where the paper is mostly bare; robust to
    ink there.
    """
    rows, cols = grey.shape
    small = cv2.resize(grey, (64, 64), interpolation=cv2.INTER_AREA)
    y, x = np.meshgrid(np.linspace(-1, 1, 64), np.linspace(-1, 1, 64), indexing="ij")
    terms = np.stack([np.ones_like(x), x, y, x * y, x * x, y * y], 2)
    at_frame = np.maximum(abs(x), abs(y)) > 0.84
    A, b = terms[at_frame], small[at_frame].astype(float)
    weight = np.ones(len(b))
    for _ in range(8):  # iteratively reweighted: ink and shadow edges lose their say
        c = np.linalg.lstsq(A * weight[:, None], b * weight, rcond=None)[0]
        weight = 1 / np.sqrt(1 + ((A @ c - b) / 0.04) ** 2)
    surface = np.clip(terms @ c, max(0.02, 0.5 * np.median(b)), 1.5).astype(np.float32)
    return cv2.resize(surface, (cols, rows), interpolation=cv2.INTER_LINEAR)


def _paper_light(channel: Grey, bare: Mask, sigma: float) -> Grey:
    """Light of the paper at every pixel: average of the bare pixels around, wider and wider where there are
    none.
    """
    rows, cols = channel.shape
    small = (max(8, cols // 8), max(8, rows // 8))
    weight = cv2.resize(bare.astype(np.float32), small, interpolation=cv2.INTER_AREA)
    value = cv2.resize(channel * bare, small, interpolation=cv2.INTER_AREA)
    total, over = np.zeros_like(value), np.zeros_like(value)
    for k in range(5):
        s, trust = sigma / 8 * 2**k, 10.0 ** (-3 * k)
        total += trust * cv2.GaussianBlur(value, (0, 0), s)
        over += trust * cv2.GaussianBlur(weight, (0, 0), s)
    light = np.where(over > 0, total / np.maximum(over, 1e-30), float(np.median(channel))).astype(np.float32)
    return cv2.resize(light, (cols, rows), interpolation=cv2.INTER_LINEAR)


def _without_specks(mask: Mask) -> Mask:
    """Crumbs of ink and pinholes in it filled, both smaller than a line is wide."""
    width = stroke_width(mask)
    labels, count = ndimage.label(mask, np.ones((3, 3)))
    area = np.bincount(labels.ravel(), minlength=count + 1)
    mask = mask & (area > max(6.0, 1.2 * width**2))[labels]
    labels, count = ndimage.label(~mask)
    area = np.bincount(labels.ravel(), minlength=count + 1)
    return mask | ((area < max(4.0, 0.35 * width**2))[labels] & ~mask)


def _disc(radius: float) -> UInt8[np.ndarray, "D D"]:
    r = max(1, round(radius))
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * r + 1, 2 * r + 1))
