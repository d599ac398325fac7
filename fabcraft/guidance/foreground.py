"""What a photograph or an illustration shows, apart from its background: by transparency, by colour, or by a network.

By colour is GrabCut (Rother et al. 2004): Gaussian mixtures of what lies inside and outside, parted where the picture
has edges.  It answers always, right or wrong, so its answer is examined: it must hardly depend on the frame it began
with, leave the picture's border, and stand out from what is around it along most of its edge.  Else `InputError`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Bool, UInt8
from scipy import ndimage

from fabcraft.errors import InputError, MissingError

By = Literal["auto", "alpha", "grabcut", "rembg"]
SIDE = 320  # GrabCut's working size; the edge is smoothed afterwards
MARGINS = (0.03, 0.09)
"""Of the side: the two frames GrabCut is begun with."""
AGREE = 0.85  # overlap of the two answers
LEAST_SHARE, MOST_SHARE = 0.01, 0.9
MOST_BORDER = 0.4  # share of the picture's border that the object may cover
STEP = 12.0  # difference of CIELAB colours that counts as an edge
LEAST_EDGE = 0.7  # share of the outline that must have one

Mask = Bool[np.ndarray, "H W"]
Image = UInt8[np.ndarray, "H W 4"]
OTHER_WAYS = (
    "Photograph it on a plain background of another colour, erase the background (PNG with transparency), "
    "or use --foreground rembg."
)


@dataclass(frozen=True, eq=False)
class Foreground:
    """The object of a picture."""

    mask: Mask
    words: str
    """How it was found."""


def foreground(rgba: Image, by: By = "auto") -> Foreground:
    """The object in a picture, (H, W, 4) uint8 RGBA.

    `auto` takes the transparency where there is any, else GrabCut; a network is asked only by name.
    Raises `InputError` when object and background cannot be told apart, `MissingError` without rembg.
    """
    if by == "auto":
        by = "alpha" if (rgba[..., 3] < 128).mean() > 0.01 else "grabcut"
    ways: dict[str, Callable[[Image], Mask]] = {
        "alpha": _by_alpha,
        "grabcut": _by_colour,
        "rembg": _by_network,
    }
    mask = ways[by](rgba)
    pieces, count = ndimage.label(mask, np.ones((3, 3)))
    area = np.bincount(pieces.ravel(), minlength=count + 1)[1:]
    if not count or not LEAST_SHARE < area.max() / mask.size < MOST_SHARE:
        share = area.max() / mask.size if count else 0.0
        raise InputError(
            f"no object stands out in the picture: what was found covers {100 * share:.0f} % of it",
            OTHER_WAYS,
        )
    words = {"alpha": "its transparency", "grabcut": "its colours (GrabCut)", "rembg": "a network (rembg)"}
    return Foreground(pieces == area.argmax() + 1, words[by])


def _by_alpha(rgba: Image) -> Mask:
    if rgba[..., 3].min() > 127:
        raise InputError("the picture has no transparent part", "Use --foreground grabcut or rembg.")
    return rgba[..., 3] > 127


def _by_network(rgba: Image) -> Mask:
    try:
        import rembg
    except ImportError as error:
        raise MissingError(
            "rembg is not installed; it finds an object before a busy background",
            "Install it: pip install 'fabcraft[rembg]'; it fetches its weights (170 MB) on first use.",
        ) from error
    return np.asarray(rembg.remove(np.ascontiguousarray(rgba[..., :3]), only_mask=True)) > 127


def _by_colour(rgba: Image) -> Mask:
    """GrabCut from two frames, examined."""
    scale = min(1.0, SIDE / max(rgba.shape[:2]))
    size = (max(8, round(rgba.shape[1] * scale)), max(8, round(rgba.shape[0] * scale)))
    small = cv2.bilateralFilter(cv2.resize(rgba[..., :3], size, interpolation=cv2.INTER_AREA), 5, 30.0, 3.0)
    first, second = (_grabcut(small, margin) for margin in MARGINS)
    both, either = (first & second).sum(), (first | second).sum()
    if not both or both < AGREE * either:
        _undecided("the object found depends on where one begins to look")
    border = np.concatenate([first[2], first[-3], first[:, 2], first[:, -3]])
    if border.mean() > MOST_BORDER:
        _undecided(f"what was found runs along {100 * border.mean():.0f} % of the picture's border")
    if (edge := _edge_share(small, first)) < LEAST_EDGE:
        _undecided(f"only {100 * edge:.0f} % of its outline stands out from what is around it")
    soft = cv2.resize(first.astype(np.float32), rgba.shape[1::-1], interpolation=cv2.INTER_CUBIC)
    return cv2.GaussianBlur(soft, (0, 0), 0.6 / scale) > 0.5


def _undecided(why: str) -> None:
    raise InputError(f"object and background cannot be told apart: {why}", OTHER_WAYS)


def _grabcut(rgb: UInt8[np.ndarray, "h w 3"], margin: float) -> Mask:
    """The object, if anything inside the frame differs from what is outside; its holes filled, its hairs gone."""
    height, width = rgb.shape[:2]
    inset = max(2, round(margin * max(height, width)))
    frame = (inset, inset, width - 2 * inset, height - 2 * inset)
    marks, models = np.zeros((height, width), np.uint8), [np.zeros((1, 65)) for _ in range(2)]
    if rgb[inset:-inset, inset:-inset].reshape(-1, 3).std(0).max() < 2.0:
        raise InputError("the picture shows one even colour", "Give a picture with something on it.")
    cv2.setRNGSeed(0)
    cv2.grabCut(
        np.ascontiguousarray(rgb[..., ::-1]), marks, frame, models[0], models[1], 5, cv2.GC_INIT_WITH_RECT
    )
    found = np.isin(marks, (cv2.GC_FGD, cv2.GC_PR_FGD)).astype(np.uint8)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
    mask = cv2.morphologyEx(found, cv2.MORPH_OPEN, disc)
    labels, count = ndimage.label(mask)
    if not count:
        return mask > 0
    return labels == np.bincount(labels.ravel())[1:].argmax() + 1


def _edge_share(rgb: UInt8[np.ndarray, "h w 3"], mask: Mask) -> float:
    """Share of the outline where the colours four pixels inside and outside differ."""
    lab = cv2.cvtColor(rgb.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    filled = ndimage.binary_fill_holes(mask).astype(np.uint8)
    away = cv2.distanceTransform(filled, cv2.DIST_L2, 5) - cv2.distanceTransform(1 - filled, cv2.DIST_L2, 5)
    down, across = np.gradient(cv2.GaussianBlur(away, (0, 0), 2.0))
    rows, columns = np.nonzero((away > 0) & (away <= 1.5))
    inward = np.stack([down[rows, columns], across[rows, columns]], 1)
    inward /= np.linalg.norm(inward, axis=1, keepdims=True) + 1e-9
    at = np.stack([rows, columns], 1)
    limit = np.array(mask.shape) - 1
    inner, outer = (np.clip(np.round(at + d * inward).astype(int), 0, limit) for d in (4.0, -4.0))
    step = np.linalg.norm(lab[tuple(inner.T)] - lab[tuple(outer.T)], axis=1)
    return float((step > STEP).mean()) if len(step) else 0.0
