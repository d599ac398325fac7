"""Light on a picture: a small studio for deferred shading, all in NumPy.

A key light from the upper left, a fill from the right, a rim from behind, and a sky over a warm floor.
Diffuse light is wrapped, (n·l + w) / (1 + w), which gives plastic and skin their soft terminator; the
highlight is Blinn-Phong. Shadows: a shadow map of the key light with a soft disc of taps. Occlusion:
"alchemy" ambient obscurance in two radii (McGuire et al. 2011). Directions are in the camera's frame: x
right, y up, z towards the camera. Colours are linear.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32
from scipy.ndimage import uniform_filter

KEY = (-0.52, 0.62, 0.59)
_FILL = (0.80, 0.10, 0.59)
_RIM = (0.35, 0.65, -0.67)


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
    normals = surface.normals
    key, fill, rim = (_unit(direction) for direction in (KEY, _FILL, _RIM))
    sky = 0.5 + 0.5 * surface.up
    # Occluded light bounces off the surface itself and takes on its colour (Jimenez et al. 2016,
    # multi-bounce fit).
    visible = occlusion[:, None]
    bounce = visible / (1.0 - surface.colours * 0.55 * (1.0 - visible))
    ambient = bounce * (
        sky[:, None] * np.array([0.46, 0.48, 0.52], np.float32)
        + (1.0 - sky[:, None]) * np.array([0.27, 0.245, 0.225], np.float32)
    )
    light = ambient
    light += (_wrapped(normals @ key, 0.25) * shadow * (0.45 + 0.55 * occlusion))[:, None] * np.array(
        [0.80, 0.775, 0.73], np.float32
    )
    light += (_wrapped(normals @ fill, 0.4) * occlusion)[:, None] * np.array([0.150, 0.165, 0.19], np.float32)
    light *= surface.colours
    facing = np.clip(np.einsum("ij,ij->i", normals, surface.to_camera), 0.0, 1.0)
    power = 12.0 + 90.0 * surface.gloss
    strength = surface.gloss * (power + 8.0) / 60.0
    for direction, weight in ((key, shadow * 0.34), (fill, occlusion * 0.05)):
        half = surface.to_camera + direction
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        light += (strength * weight * np.clip(np.einsum("ij,ij->i", normals, half), 0.0, 1.0) ** power)[
            :, None
        ]
    # A soft edge light: grazing (Schlick's fifth power, eased) and turned towards the rim lamp.
    edge = (1.0 - facing) ** 3 * np.clip(normals @ rim + 0.35, 0.0, 1.0) * occlusion
    return light + (edge * (0.10 + 0.20 * surface.gloss))[:, None]


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
    height, width = depth.shape
    radius = max(radius_mm / pixel_mm, 2.0)
    rows, columns = np.nonzero(covered)
    here, normal = depth[rows, columns], normals[rows, columns]
    # a 4 × 4 dither of the spiral's angle trades bands for noise that the caller's filter removes
    turn = ((rows % 4) * 4 + (columns % 4)).astype(np.float32) * np.float32(2 * np.pi / 16 * 7)
    cosine, sine = np.cos(turn), np.sin(turn)
    total = np.zeros(len(rows), np.float32)
    for tap in range(taps):
        reach, angle = radius * np.sqrt((tap + 0.5) / taps), 2.399963 * tap
        x, y = reach * np.cos(angle), reach * np.sin(angle)
        column = np.clip(columns + np.rint(x * cosine - y * sine).astype(np.int32), 0, width - 1)
        row = np.clip(rows + np.rint(x * sine + y * cosine).astype(np.int32), 0, height - 1)
        vx = (column - columns) * np.float32(pixel_mm)
        vy = (rows - row) * np.float32(pixel_mm)
        vz = here - depth[row, column]  # towards the camera is positive
        square = vx * vx + vy * vy + vz * vz
        rise = vx * normal[:, 0] + vy * normal[:, 1] + vz * normal[:, 2]
        rise = np.maximum(rise - np.float32(0.02 * radius_mm), 0.0) / np.sqrt(square + 1e-6)
        total += (
            rise * np.maximum(1.0 - square / np.float32(radius_mm * radius_mm), 0.0) * covered[row, column]
        )
    result = np.zeros(depth.shape, np.float32)
    result[rows, columns] = total * (2.0 / taps)
    return result


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
    height, width = lamp_depth.shape
    cosine, sine = np.cos(turn) * np.float32(blur), np.sin(turn) * np.float32(blur)
    limit = points[:, 2] - bias
    total = np.zeros(len(points), np.float32)
    for tap in range(16):
        reach, angle = np.sqrt((tap + 0.5) / 16), 2.399963 * tap
        x, y = np.float32(reach * np.cos(angle)), np.float32(reach * np.sin(angle))
        column = np.clip((points[:, 0] + x * cosine - y * sine).astype(np.int32), 0, width - 1)
        row = np.clip((points[:, 1] + x * sine + y * cosine).astype(np.int32), 0, height - 1)
        total += lamp_depth[row, column] > limit
    return total / np.float32(16)


def tone_mapped(light: Float32[np.ndarray, "*S 3"]) -> Float32[np.ndarray, "*S 3"]:
    """Highlights rolled off above 0.75 so that nothing burns out; below, light is left as it is."""
    over = np.maximum(light - 0.75, 0.0)
    return np.minimum(light, 0.75) + 0.25 * (1.0 - np.exp(-over / 0.25))


def _wrapped(cosine: np.ndarray, wrap: float) -> np.ndarray:
    """Diffuse light that reaches a little around the corner, normalised to its energy."""
    return np.maximum((cosine + wrap) / (1.0 + wrap), 0.0) / (1.0 + wrap)


def _unit(direction: tuple[float, float, float]) -> np.ndarray:
    """The direction with length 1, float32."""
    vector = np.asarray(direction, np.float32)
    return vector / np.linalg.norm(vector)
