"""`read_gcode`: what a slicer's G-code says of itself, and what its moves extrude.

Time and weight are read from the comments that PrusaSlicer, OrcaSlicer, Bambu Studio and Cura write; volumes
are summed from the moves: filament pushed while the nozzle travels in x or y, so that retracting and priming
do not count. Support is what lies under `;TYPE:Support...` (Bambu: `; FEATURE: Support`).
"""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

FILAMENT_MM = 1.75
"""Where the G-code does not name its filament."""

_TIMES = (
    re.compile(r"^; estimated printing time \(normal mode\) = (.+)$"),
    re.compile(r"^; .*total estimated time: (.+)$"),
)
_GRAMS = re.compile(r"^; (?:total )?filament used \[g\] *= *([\d.]+)")
_VOLUME = re.compile(r"^; (?:total )?filament used \[cm3\] *= *([\d.]+)")
_DIAMETER = re.compile(r"^; filament_diameter *[=:] *([\d.]+)")
_TYPE = re.compile(r"^;\s*(?:TYPE|FEATURE):\s*(.*)$", re.IGNORECASE)
_HEIGHT = re.compile(r"^;\s*Z(?:_HEIGHT)?:\s*([\d.]+)")
_WORD = re.compile(r"([XYZE])(-?\d*\.?\d+)")


@dataclass(frozen=True)
class Toolpath:
    """What a G-code file says; what it does not say is None."""

    seconds: float | None
    """Estimated printing time."""
    grams: float | None
    cm3: float | None
    """Filament used, supports, skirt and priming included."""
    laid_mm3: float
    """Extruded while moving, supports and skirt included."""
    support_mm3: float
    layers_mm: tuple[float, ...]
    """Heights of the layers that extrude something, the lowest first."""

    def empty_layers(self, layer_mm: float) -> tuple[float, ...]:
        """Heights that lie more than a layer and a half over the layer below, or over the bed."""
        below = (0.0, *self.layers_mm)
        return tuple(
            high for low, high in zip(below, self.layers_mm, strict=False) if high - low > 1.5 * layer_mm
        )


def read_gcode(lines: Iterable[str]) -> Toolpath:
    """Read G-code line by line: millimetres of filament, absolute or relative, one extruder."""
    seconds = grams = cm3 = None
    diameter, relative, position = FILAMENT_MM, False, 0.0
    laid = support = height = 0.0
    in_support = False
    heights: set[float] = set()
    for line in lines:
        if line.startswith(";"):
            if found := _TYPE.match(line):
                in_support = found[1].strip().lower().startswith("support")
            elif found := _HEIGHT.match(line):
                height = float(found[1])
            elif found := _GRAMS.match(line):
                grams = float(found[1])
            elif found := _VOLUME.match(line):
                cm3 = float(found[1])
            elif found := _DIAMETER.match(line):
                diameter = float(found[1]) or diameter
            elif line.startswith(";TIME:"):
                seconds = _number(line[6:])
            else:
                for pattern in _TIMES:
                    if found := pattern.match(line):
                        seconds = seconds_of(found[1])
            continue
        word = line.partition(" ")[0].rstrip()
        if word in ("M82", "M83"):
            relative = word == "M83"
        elif word in ("G1", "G0", "G2", "G3", "G92"):
            values = dict(_WORD.findall(line.partition(";")[0]))
            if "E" not in values:
                continue
            end = float(values["E"])
            pushed = end if relative else end - position
            position = end
            if word != "G92" and pushed > 0 and ("X" in values or "Y" in values):
                laid += pushed
                heights.add(height)
                if in_support:
                    support += pushed
    area = math.pi / 4 * diameter**2
    return Toolpath(seconds, grams, cm3, laid * area, support * area, tuple(sorted(heights - {0.0})))


def seconds_of(text: str) -> float | None:
    """ "1d 2h 3m 4s" as seconds; None when no such figure is in it."""
    unit = {"d": 86400, "h": 3600, "m": 60, "s": 1}
    found = re.findall(r"(\d+)([dhms])", text)
    return float(sum(int(number) * unit[letter] for number, letter in found)) if found else None


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
