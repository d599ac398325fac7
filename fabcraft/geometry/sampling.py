"""Points on a surface: drawn evenly by area, and as weights of their face's corners.

A place on a face is (w0, w1, w2), w ≥ 0, Σ w = 1, with the point Σ w_i corner_i.
"""

import numpy as np
from jaxtyping import Float64, Int64


def area_samples(
    areas: Float64[np.ndarray, " F"], count: int, random: np.random.Generator
) -> tuple[Int64[np.ndarray, " S"], Float64[np.ndarray, "S 3"]]:
    """`count` places spread evenly by area: their faces (ascending) and corner weights.

    One draw falls in each of `count` equal slices of the area, which is evener than independent draws.
    """
    edges = np.cumsum(areas) / areas.sum()
    slices = (np.arange(count) + random.random(count)) / count
    faces = np.searchsorted(edges, slices).clip(max=len(areas) - 1).astype(np.int64)
    root, v = np.sqrt(random.random(count)), random.random(count)
    return faces, np.column_stack([1.0 - root, root * (1.0 - v), root * v])


def corner_weights(
    points: Float64[np.ndarray, "N 3"], corners: Float64[np.ndarray, "N 3 3"]
) -> Float64[np.ndarray, "N 3"]:
    """Corner weights of points that lie on their triangles; off them, of the nearest place inside, roughly.

    A triangle without area gives the weights of its longest edge's nearest place.
    """
    origin = corners[:, 0]
    u, v, w = corners[:, 1] - origin, corners[:, 2] - origin, points - origin
    uu, uv, vv = (u * u).sum(1), (u * v).sum(1), (v * v).sum(1)
    wu, wv = (w * u).sum(1), (w * v).sum(1)
    determinant = uu * vv - uv * uv
    flat = determinant <= 1e-24 * np.maximum(uu, vv) ** 2
    safe = np.where(flat, 1.0, determinant)
    longer = uu >= vv
    along = np.clip(np.where(longer, wu, wv) / np.maximum(np.where(longer, uu, vv), 1e-300), 0.0, 1.0)
    second = np.where(flat, np.where(longer, along, 0.0), (vv * wu - uv * wv) / safe)
    third = np.where(flat, np.where(longer, 0.0, along), (uu * wv - uv * wu) / safe)
    weights = np.clip(np.column_stack([1.0 - second - third, second, third]), 0.0, None)
    return weights / weights.sum(1, keepdims=True)
