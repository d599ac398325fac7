"""A sheet of paper photographed on something darker: the table is taken away, so its edge is no drawing.

The sheet is the bright part of the picture (Otsu) when it is large, nearly a rectangle, and has ink on it; a
light shape that fills its own box less well is a drawing on a dark page and stays.
"""

import cv2
import numpy as np
from jaxtyping import Float32
from scipy import ndimage

LEAST_SHARE = 0.2
LEAST_BOX_FILL = 0.9


def without_table(rgb: Float32[np.ndarray, "H W 3"]) -> Float32[np.ndarray, "H W 3"]:
    """(H, W, 3) colours 0-1 with everything around the sheet painted in the sheet's colour."""
    grey = (255 * rgb.mean(2).clip(0, 1)).astype(np.uint8)
    edge = np.concatenate([grey[:3].ravel(), grey[-3:].ravel(), grey[:, :3].ravel(), grey[:, -3:].ravel()])
    limit, bright = cv2.threshold(
        cv2.GaussianBlur(grey, (0, 0), 2.0), 0, 1, cv2.THRESH_BINARY | cv2.THRESH_OTSU
    )
    if np.mean(edge > limit) > 0.4:  # the paper reaches the border on most sides
        return rgb
    labels, count = ndimage.label(bright)
    if not count:
        return rgb
    sheet = labels == np.bincount(labels.ravel())[1:].argmax() + 1
    whole = ndimage.binary_fill_holes(sheet)
    box = cv2.minAreaRect(np.argwhere(whole)[:, ::-1].astype(np.float32))
    drawn_on = (whole & ~sheet).sum() > 0.002 * whole.sum()
    if whole.mean() < LEAST_SHARE or whole.sum() < LEAST_BOX_FILL * box[1][0] * box[1][1] or not drawn_on:
        return rgb
    inset = max(3, round(0.012 * max(grey.shape)))
    depth = cv2.distanceTransform(np.pad(whole, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    # The sheet's own light, carried outwards from just inside its edge, so that no new edge appears.
    nearest = ndimage.distance_transform_edt(depth <= inset, return_distances=False, return_indices=True)
    light = cv2.medianBlur((255 * rgb.clip(0, 1)).astype(np.uint8), 2 * inset + 1).astype(np.float32) / 255
    return np.where((depth > inset)[..., None], rgb, light[nearest[0], nearest[1]])
