"""Colours shared by pictures, pages and files: sRGB in [0, 1], shape (..., 3).

The penetration map is the paper's: blue outside the body (positive distance), white at 0, red inside
(negative).
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Float64, UInt8

Colour = tuple[float, float, float]
"""sRGB in [0, 1]."""

BODY: Colour = (0.80, 0.70, 0.63)
"""A calm skin-like clay for the wearer."""
OBJECT: Colour = (0.25, 0.52, 0.77)
"""The printed object."""
EYES: Colour = (0.07, 0.07, 0.08)
"""The eyes of a character."""
RESTED_ON: Colour = (0.16, 0.58, 0.36)
"""Skin that the object rests on."""
KEPT_CLEAR: Colour = (0.93, 0.62, 0.16)
"""Skin that it keeps a distance from."""
GREY: Colour = (0.74, 0.75, 0.77)
"""A neutral body or a second object."""

_DIVERGING = (
    (0.55, 0.03, 0.11), (0.80, 0.18, 0.19), (0.95, 0.56, 0.46), (0.97, 0.97, 0.96),
    (0.55, 0.75, 0.89), (0.20, 0.50, 0.76), (0.05, 0.25, 0.55),
)  # fmt: skip
_THICKNESS = (
    (0.70, 0.07, 0.16), (0.93, 0.42, 0.20), (0.99, 0.80, 0.38),
    (0.62, 0.83, 0.52), (0.21, 0.62, 0.56), (0.13, 0.36, 0.55),
)  # fmt: skip


def ramp(
    values: Float[np.ndarray, " N"], stops: Sequence[Colour], low: float, high: float
) -> Float64[np.ndarray, "N 3"]:
    """Colours for `values` along evenly spaced `stops` from `low` to `high`; a value that is not a number
    is grey."""
    place = np.clip((np.asarray(values, dtype=np.float64) - low) / max(high - low, 1e-12), 0.0, 1.0)
    marks, table = np.linspace(0.0, 1.0, len(stops)), np.asarray(stops)
    known = np.nan_to_num(place)
    colours = np.stack([np.interp(known, marks, table[:, channel]) for channel in range(3)], axis=1)
    colours[np.isnan(place)] = 0.6
    return colours


def distance_colours(distance_mm: Float[np.ndarray, " N"], limit_mm: float) -> Float64[np.ndarray, "N 3"]:
    """Blue where positive (outside the body), white at 0, red where negative (inside); saturates at
    ±`limit_mm`."""
    return ramp(distance_mm, _DIVERGING, -limit_mm, limit_mm)


def thickness_colours(
    thickness_mm: Float[np.ndarray, " N"], low_mm: float, high_mm: float
) -> Float64[np.ndarray, "N 3"]:
    """Red where thin, through yellow at a third, to green and blue where thick."""
    return ramp(thickness_mm, _THICKNESS, low_mm, high_mm)


def share(values: Float[np.ndarray, " N"], percent: float) -> float:
    """Percentile of the finite values; 0 without any."""
    values = values[np.isfinite(values)]
    return float(np.percentile(values, percent)) if len(values) else 0.0


def rounded_up(value: float) -> float:
    """The next of 1, 2, 5, 10 (times a power of ten) at or over `value`, at least 0.1: the end of a scale."""
    value = max(value, 0.1)
    power = 10.0 ** np.floor(np.log10(value) + 1e-9)
    return float(next(step * power for step in (1, 2, 5, 10) if step * power >= value * (1 - 1e-9)))


def to_linear(srgb: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
    """Light from sRGB (IEC 61966-2-1)."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((np.maximum(srgb, 0.0) + 0.055) / 1.055) ** 2.4)


def to_srgb(light: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
    """sRGB from light, the inverse of `to_linear`; clipped to [0, 1]."""
    light = np.clip(light, 0.0, 1.0)
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1.0 / 2.4) - 0.055)


def to_bytes(srgb: Float[np.ndarray, "... 3"]) -> UInt8[np.ndarray, "... 3"]:
    """8-bit colours from [0, 1]."""
    return np.round(np.clip(srgb, 0.0, 1.0) * 255.0).astype(np.uint8)
