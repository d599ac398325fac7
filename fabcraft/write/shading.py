"""Light on a picture: a small studio for deferred shading, compiled sample by sample.

A key light from the upper left, a fill from the right, a rim from behind, and a sky over a warm floor.
Diffuse light is wrapped, (n·l + w) / (1 + w), which gives plastic and skin their soft terminator; the
highlight is Blinn-Phong. Shadows: a shadow map of the key light with a soft disc of taps. Occlusion:
"alchemy" ambient obscurance in two radii (McGuire et al. 2011). Directions are in the camera's frame: x
right, y up, z towards the camera. Colours are linear.
"""

import typing
from dataclasses import dataclass

import numba as nb
import numpy as np
from jaxtyping import Bool, Float32
from scipy.ndimage import uniform_filter

KEY = (-0.52, 0.62, 0.59)
_FILL = (0.80, 0.10, 0.59)
_RIM = (0.35, 0.65, -0.67)
_SKY, _FLOOR = (0.46, 0.48, 0.52), (0.27, 0.245, 0.225)
_KEY_COLOUR, _FILL_COLOUR = (0.80, 0.775, 0.73), (0.150, 0.165, 0.19)


@dataclass(frozen=True)
class Surface:
    """What the camera sees, one row per covered sample."""

    normals: Float32[np.ndarray, "P 3"]
    """Unit, in the camera's frame, towards the camera."""
    to_camera: Float32[np.ndarray, "P 3"]
    """Unit direction to the camera, in its frame."""
    up: Float32[np.ndarray, " P"]
    """World z of the normal, for sky and floor."""
    colours: Float32[np.ndarray, "P 3"]
    """Linear light reflected."""
    gloss: Float32[np.ndarray, " P"]
    """0 chalk, 1 polished."""


def lit(
    surface: Surface, shadow: Float32[np.ndarray, " P"], occlusion: Float32[np.ndarray, " P"]
) -> Float32[np.ndarray, "P 3"]:
    """Linear light towards the camera; `shadow`: share of the key light that arrives; `occlusion`: share of
    the sky."""
    light = np.empty(surface.colours.shape, np.float32)
    _light(
        surface.normals,
        np.ascontiguousarray(surface.to_camera),
        surface.up,
        surface.colours,
        surface.gloss,
        shadow,
        occlusion,
        np.stack([_unit(direction) for direction in (KEY, _FILL, _RIM)]),
        light,
    )
    return light


@nb.njit(cache=True, nogil=True, error_model="numpy")
@typing.no_type_check
def _light(normals, to_camera, up, colours, gloss, shadow, occlusion, lamps, light):
    """Fill light (P, 3); lamps (3, 3): unit directions of key, fill and rim."""
    for sample in range(len(normals)):
        normal, eye = normals[sample], to_camera[sample]
        key = normal[0] * lamps[0, 0] + normal[1] * lamps[0, 1] + normal[2] * lamps[0, 2]
        fill = normal[0] * lamps[1, 0] + normal[1] * lamps[1, 1] + normal[2] * lamps[1, 2]
        rim = normal[0] * lamps[2, 0] + normal[1] * lamps[2, 1] + normal[2] * lamps[2, 2]
        open_, reached, shine = occlusion[sample], shadow[sample], gloss[sample]
        sky = 0.5 + 0.5 * up[sample]
        by_key = max((key + 0.25) / 1.25, 0.0) / 1.25 * reached * (0.45 + 0.55 * open_)
        by_fill = max((fill + 0.4) / 1.4, 0.0) / 1.4 * open_
        power = 12.0 + 90.0 * shine
        strength = shine * (power + 8.0) / 60.0
        glint = 0.0
        for lamp in range(2):
            x, y, z = eye[0] + lamps[lamp, 0], eye[1] + lamps[lamp, 1], eye[2] + lamps[lamp, 2]
            half = (normal[0] * x + normal[1] * y + normal[2] * z) / np.sqrt(x * x + y * y + z * z)
            weight = reached * 0.34 if lamp == 0 else open_ * 0.05
            if half > 0.0:
                glint += strength * weight * min(half, 1.0) ** power
        facing = min(max(normal[0] * eye[0] + normal[1] * eye[1] + normal[2] * eye[2], 0.0), 1.0)
        # A soft edge light: grazing (Schlick's fifth power, eased) and turned towards the rim lamp.
        edge = (1.0 - facing) ** 3 * min(max(rim + 0.35, 0.0), 1.0) * open_ * (0.10 + 0.20 * shine)
        for channel in range(3):
            colour = colours[sample, channel]
            # Occluded light bounces off the surface itself and takes on its colour (Jimenez et al. 2016,
            # multi-bounce fit).
            bounce = open_ / (1.0 - colour * 0.55 * (1.0 - open_))
            ambient = bounce * (sky * _SKY[channel] + (1.0 - sky) * _FLOOR[channel])
            given = ambient + by_key * _KEY_COLOUR[channel] + by_fill * _FILL_COLOUR[channel]
            light[sample, channel] = given * colour + glint + edge


def occlusion_map(
    depth: Float32[np.ndarray, "H W"],
    normals: Float32[np.ndarray, "H W 3"],
    covered: Bool[np.ndarray, "H W"],
    pixel_mm: float,
    radius_mm: float,
) -> Float32[np.ndarray, "H W"]:
    """Share of the sky that each pixel sees; `depth` mm away from the camera, `pixel_mm` the size of a
    pixel there."""
    total = np.zeros(depth.shape, np.float32)
    for share, strength, taps in ((0.22, 1.0, 10), (1.0, 1.25, 16)):
        total += strength * _obscurance(depth, normals, covered, pixel_mm, radius_mm * share, taps)
    # The dither of the taps repeats every four pixels, so a window of four removes it; the background stays
    # outside.
    weight = uniform_filter(covered.astype(np.float32), 4)
    smooth = uniform_filter(np.where(covered, total, 0.0).astype(np.float32), 4) / np.maximum(weight, 1e-3)
    return np.clip(1.0 - smooth, 0.0, 1.0).astype(np.float32)


def _obscurance(
    depth: np.ndarray, normals: np.ndarray, covered: np.ndarray, pixel_mm: float, radius_mm: float, taps: int
) -> np.ndarray:
    """Alchemy obscurance: mean over a spiral of taps of max(0, v·n - bias) / (v·v + ε), faded at the
    radius."""
    radius = max(radius_mm / pixel_mm, 2.0)
    # a 4 × 4 dither of the spiral's angle trades bands for noise that the caller's filter removes
    turn = np.arange(16)[:, None] * (2 * np.pi / 16 * 7)
    reach = radius * np.sqrt((np.arange(taps) + 0.5) / taps)
    angle = 2.399963 * np.arange(taps) + turn
    steps = np.rint(np.stack([reach * np.cos(angle), reach * np.sin(angle)], -1)).astype(np.int64)
    result = np.zeros(depth.shape, np.float32)
    _obscured(depth, normals, covered, pixel_mm, radius_mm, steps, result)
    return result


@nb.njit(cache=True, nogil=True, error_model="numpy")
@typing.no_type_check
def _obscured(depth, normals, covered, pixel_mm, radius_mm, steps, result):
    """Fill result (H, W) where it is covered; steps (16, taps, 2): right and down, by the dither."""
    height, width = depth.shape
    taps, bias = steps.shape[1], 0.02 * radius_mm
    for row in range(height):
        for column in range(width):
            if not covered[row, column]:
                continue
            normal, total = normals[row, column], 0.0
            for tap in range(taps):
                step = steps[(row % 4) * 4 + column % 4, tap]
                there_column = min(max(column + step[0], 0), width - 1)
                there_row = min(max(row + step[1], 0), height - 1)
                if not covered[there_row, there_column]:
                    continue
                x, y = (there_column - column) * pixel_mm, (row - there_row) * pixel_mm
                z = depth[row, column] - depth[there_row, there_column]  # towards the camera is positive
                square = x * x + y * y + z * z
                rise = x * normal[0] + y * normal[1] + z * normal[2] - bias
                if rise > 0.0 and square < radius_mm * radius_mm:
                    total += rise / np.sqrt(square + 1e-6) * (1.0 - square / (radius_mm * radius_mm))
            result[row, column] = total * (2.0 / taps)


def shadow_share(
    points: Float32[np.ndarray, "P 3"],
    lamp_depth: Float32[np.ndarray, "H W"],
    bias: Float32[np.ndarray, " P"],
    blur: float,
    turn: Float32[np.ndarray, " P"],
) -> Float32[np.ndarray, " P"]:
    """Share of the key light at `points` = (column, row, depth from the lamp), by a disc of 16 taps of
    `blur` pixels.

    `lamp_depth` is infinite where the lamp sees nothing; `turn` turns the disc, so that the edge is soft,
    not stepped.
    """
    reach = np.sqrt((np.arange(16) + 0.5) / 16) * blur
    angle = 2.399963 * np.arange(16)
    share = np.empty(len(points), np.float32)
    _lit_share(points, lamp_depth, bias, turn, reach * np.cos(angle), reach * np.sin(angle), share)
    return share


@nb.njit(cache=True, nogil=True, error_model="numpy")
@typing.no_type_check
def _lit_share(points, lamp_depth, bias, turn, right, down, share):
    """Fill share (P,); right, down (taps,): the disc, pixels."""
    height, width = lamp_depth.shape
    for sample in range(len(points)):
        cosine, sine = np.cos(turn[sample]), np.sin(turn[sample])
        limit, count = points[sample, 2] - bias[sample], 0
        for tap in range(len(right)):
            x = points[sample, 0] + right[tap] * cosine - down[tap] * sine
            y = points[sample, 1] + right[tap] * sine + down[tap] * cosine
            column, row = min(max(int(x), 0), width - 1), min(max(int(y), 0), height - 1)
            count += lamp_depth[row, column] > limit
        share[sample] = count / len(right)


def tone_mapped(light: Float32[np.ndarray, "*S 3"]) -> Float32[np.ndarray, "*S 3"]:
    """Highlights rolled off above 0.75 so that nothing burns out; below, light is left as it is."""
    over = np.maximum(light - 0.75, 0.0)
    return np.minimum(light, 0.75) + 0.25 * (1.0 - np.exp(-over / 0.25))


def _unit(direction: tuple[float, float, float]) -> np.ndarray:
    """The direction with length 1, float32."""
    vector = np.asarray(direction, np.float32)
    return vector / np.linalg.norm(vector)
