"""The best mirror axis of a silhouette: the overlap with its own mirror image, over all columns and small
tilts.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float32


@dataclass(frozen=True)
class Axis:
    """A mirror axis in the picture."""

    column_px: float
    """Where it crosses the middle row of the image."""
    tilt_deg: float
    """Against the columns, positive when its upper end leans to the right."""
    iou: float


def mirror_axis(silhouette: Bool[np.ndarray, "H W"], most_tilt_deg: float = 15.0) -> Axis:
    """The axis about which the silhouette overlaps most with its mirror image."""
    height, width = silhouette.shape
    scale = 256 / max(height, width)
    size = (max(8, round(width * scale)), max(8, round(height * scale)))
    small = cv2.resize(silhouette.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    best = max(
        (_best_column(small, t) for t in np.arange(-most_tilt_deg, most_tilt_deg + 1, 1.5)),
        key=lambda a: a.iou,
    )
    for step in (0.5, 0.17):
        around = best.tilt_deg + step * np.arange(-2, 3)
        best = max((_best_column(small, t) for t in around), key=lambda a: a.iou)
    upright = _best_column(small, 0.0)
    best = upright if best.iou - upright.iou < 0.003 else best  # no tilt without evidence
    column = best.column_px * width / size[0]
    return Axis(column, best.tilt_deg, _mirror_iou(silhouette, column, best.tilt_deg))


def _mirror_iou(silhouette: Bool[np.ndarray, "H W"], column_px: float, tilt_deg: float) -> float:
    """Overlap of the silhouette with its mirror image x -> x - 2 n (n . (x - p)), p on the axis."""
    normal = np.array([np.cos(np.radians(tilt_deg)), np.sin(np.radians(tilt_deg))])
    middle = np.array([column_px - 0.5, silhouette.shape[0] / 2 - 0.5])  # OpenCV's pixel centres are whole
    reflect = np.eye(2) - 2 * np.outer(normal, normal)
    matrix = np.column_stack([reflect, middle - reflect @ middle])
    margin = max(silhouette.shape)  # nothing may fall off the page
    matrix[:, 2] += margin - reflect @ [margin, margin]
    padded = np.pad(silhouette, margin).astype(np.float32)
    mirrored = cv2.warpAffine(padded, matrix, padded.shape[::-1]) > 0.5
    return float((mirrored & (padded > 0)).sum() / (mirrored | (padded > 0)).sum())


def _best_column(image: Float32[np.ndarray, "h w"], tilt_deg: float) -> Axis:
    """Best axis at one tilt: the picture is turned upright, then the overlap m(x) m(2c - x) of all c at
    once by FFT.
    """
    rows, cols = image.shape
    turn = cv2.getRotationMatrix2D(((cols - 1) / 2, (rows - 1) / 2), tilt_deg, 1.0)
    turned = cv2.warpAffine(image, turn, (cols, rows)) if tilt_deg else image
    spectrum = np.fft.rfft(turned, 2 * cols, axis=1)
    overlap = np.fft.irfft(spectrum * spectrum, 2 * cols, axis=1).sum(0)
    k = int(overlap.argmax())
    a, b, c = overlap[k - 1], overlap[k], overlap[(k + 1) % len(overlap)]
    shift = 0.5 * (a - c) / (a - 2 * b + c) if a - 2 * b + c < 0 else 0.0
    column = (k + shift) / 2 + 0.5
    total = float(image.sum())
    both = float(min(overlap[k] / max(float((turned**2).sum()) / total, 1e-9), total))
    # The axis passes the middle row at the same distance from the middle, divided by the tilt's cosine.
    at = cols / 2 + (column - cols / 2) / np.cos(np.radians(tilt_deg))
    return Axis(at, float(tilt_deg), both / (2 * total - both))
