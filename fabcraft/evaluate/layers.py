"""The layers of a sliced part as pictures: what each move of the G-code lays down, seen from above."""

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw

from fabcraft.write.sheet import INK, PAPER

KINDS = {
    "perimeter": (47, 111, 179),
    "infill": (222, 160, 60),
    "support": (170, 176, 186),
}
"""Colours by what is printed; the first fits what is neither infill nor support."""
_WORD = re.compile(r"([XYZE])(-?\d*\.?\d+)")


@dataclass(frozen=True)
class Layer:
    """One layer: height, mm, and straight moves (x, y, x, y in mm) with their kinds."""

    z_mm: float
    moves: tuple[tuple[float, float, float, float, str], ...]


def read_layers(lines: Iterable[str]) -> tuple[Layer, ...]:
    """The layers that extrude something, the lowest first; absolute positions, one extruder."""
    x = y = z = e = 0.0
    relative, kind = False, "perimeter"
    found: dict[float, list[tuple[float, float, float, float, str]]] = {}
    for line in lines:
        if line.startswith(";TYPE:"):
            said = line[6:].strip().lower()
            kind = "support" if "support" in said else "infill" if "infill" in said else "perimeter"
            kind = "skirt" if "skirt" in said or "custom" in said else kind
            continue
        word = line.partition(" ")[0].rstrip()
        if word in ("M82", "M83"):
            relative = word == "M83"
        if word not in ("G0", "G1", "G92"):
            continue
        values = {name: float(value) for name, value in _WORD.findall(line.partition(";")[0])}
        ahead = values.get("E", 0.0 if relative else e)
        pushed, e = (ahead if relative else ahead - e), (0.0 if relative else ahead)
        if word == "G92":
            continue
        to = values.get("X", x), values.get("Y", y)
        z = values.get("Z", z)
        if pushed > 0.0 and to != (x, y) and kind != "skirt":
            found.setdefault(z, []).append((x, y, *to, kind))
        x, y = to
    return tuple(Layer(height, tuple(found[height])) for height in sorted(found))


def layer_picture(
    layer: Layer, bounds: tuple[float, float, float, float], size: tuple[int, int], line_mm: float
) -> UInt8[np.ndarray, "H W 3"]:
    """A layer from above.  bounds : x, y, x, y in mm of what fills the picture.  line_mm : width of a laid line."""
    width, height = size
    scale = min(
        (width - 20) / max(bounds[2] - bounds[0], 1.0), (height - 20) / max(bounds[3] - bounds[1], 1.0)
    )
    middle = 0.5 * (bounds[0] + bounds[2]), 0.5 * (bounds[1] + bounds[3])
    fine = 2
    canvas = Image.new("RGB", (width * fine, height * fine), PAPER)
    draw = ImageDraw.Draw(canvas)

    def place(x: float, y: float) -> tuple[float, float]:
        return fine * (0.5 * width + scale * (x - middle[0])), fine * (0.5 * height - scale * (y - middle[1]))

    # a little thinner than they are laid, so that the lines can be told apart
    thick = max(1, round(0.8 * line_mm * scale * fine))
    for kind, colour in reversed(KINDS.items()):
        for ax, ay, bx, by, what in layer.moves:
            if what == kind:
                draw.line((*place(ax, ay), *place(bx, by)), fill=colour, width=thick)
    draw.text((8 * fine, 6 * fine), f"{layer.z_mm:.2f} mm", INK, font_size=13 * fine)
    return np.asarray(canvas.resize((width, height), Image.Resampling.LANCZOS))


def bounds_of(layers: Iterable[Layer]) -> tuple[float, float, float, float]:
    """x, y, x, y in mm of everything that is laid but supports; of everything where there is nothing else."""
    moves = [move for layer in layers for move in layer.moves]
    moves = [move for move in moves if move[4] != "support"] or moves
    places = np.array([move[:4] for move in moves]).reshape(-1, 2)
    (x, y), (u, v) = places.min(0).tolist(), places.max(0).tolist()
    return x, y, u, v
