"""`Machine`: what a slicer's file tells of a printer, before the rest is derived.

Numbers in these files are text of any kind ("0.4,0.4", "105%", ["0.4"]); a value that is no finite number in
the range of real printers is refused by name, so that nothing odd reaches a profile.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from fabcraft.errors import InputError

MOST_MM = 10_000.0
_MOST_TEXT = 200
_RECTANGLE, _ROUND = 0.97, 0.75
"""Share of its box that a bed covers at least: a rectangle, and a circle (0.785)."""

Point = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Machine:
    """What was found; None is not told by the file."""

    title: str
    process: Literal["fdm", "sla"]
    bed: Sequence[Point]
    """Corners of the bed, mm."""
    height_mm: float
    nozzle_mm: float | None = None
    layer_mm: float | None = None
    line_width_mm: float | None = None
    max_overhang_deg: float | None = None
    """From the vertical."""
    density_g_cm3: float | None = None
    exposure_s: float | None = None
    told: dict[str, str] = field(default_factory=dict)
    """Where each value stands, by the profile's field: `mk4.ini: bed_shape`."""
    notes: tuple[str, ...] = ()

    def build_mm(self, where: str) -> tuple[tuple[float, float, float], str]:
        """Build volume, and what was made of the bed when it is no rectangle.

        Raises `InputError` for a bed that is neither a rectangle nor round.
        """
        xs, ys = zip(*self.bed, strict=True)
        width, depth = max(xs) - min(xs), max(ys) - min(ys)
        share = _area(self.bed) / (width * depth) if width * depth > 0 else 0.0
        if share >= _RECTANGLE:
            return (round(width, 4), round(depth, 4), self.height_mm), ""
        if share >= _ROUND:
            inner = math.sqrt(0.5)
            said = f"; a round bed of {width:g} x {depth:g} mm, so the largest rectangle in it"
            return (round(width * inner, 2), round(depth * inner, 2), self.height_mm), said
        raise InputError(
            f"{where}: the bed is neither a rectangle nor round: its {len(self.bed)} corners enclose "
            f"{100 * share:.0f} % of their box",
            "Write the profile by hand: copy a shipped one (fabcraft printers show prusa-mk4).",
        )


def number(value: Any, key: str, where: str, least: float = 0.0, most: float = MOST_MM) -> float | None:
    """A number in a slicer's words, None when nothing or zero is said.

    value : text or number, or a list of them (one for each extruder: the first counts).
    Raises `InputError` for what is no number in (least, most].
    """
    for _ in range(2):
        if isinstance(value, list):
            value = value[0] if value else None
    if value is None or isinstance(value, bool):
        return None
    text = str(value)[:_MOST_TEXT].split(",")[0].strip().strip('"')
    if text in ("", "nil"):
        return None
    try:
        found = float(text)
    except ValueError:
        found = math.nan
    if found == 0:
        return None
    if not least < found <= most:
        raise InputError(
            f"{where}: {key}: expected a number over {least:g} and up to {most:g}, got {text!r}",
            "Export the file anew from the slicer.",
        )
    return found


def width(value: Any, whole_mm: float | None, key: str, where: str) -> float | None:
    """A line width in mm; a percentage is one of `whole_mm`; None when nothing or zero (automatic) is said."""
    if isinstance(value, list):
        value = value[0] if value else None
    text = str(value).strip() if value is not None else ""
    if text.endswith("%"):
        share = number(text[:-1], key, where, most=1000.0)
        return None if share is None or whole_mm is None else round(share / 100 * whole_mm, 4)
    return number(value, key, where, most=20.0)


def bed(value: Any, key: str, where: str) -> list[Point]:
    """Corners of a bed: "0x0,250x0,250x210,0x210", or a list of such corners.

    Raises `InputError` for anything else.
    """
    words = value if isinstance(value, list) else str(value).split(",")
    corners: list[Point] = []
    try:
        for word in words[:1000]:
            x, y = (float(part) for part in str(word)[:_MOST_TEXT].split("x"))
            corners.append((x, y))
    except ValueError:
        corners = []
    if len(corners) < 3 or not all(abs(one) <= MOST_MM for corner in corners for one in corner):
        raise InputError(
            f"{where}: {key}: expected corners such as 0x0,250x0,250x210,0x210, got {str(value)[:60]!r}",
            "Export the file anew from the slicer.",
        )
    return corners


def words(value: Any, otherwise: str) -> str:
    """Text of a file as one line that can be shown and written."""
    if isinstance(value, list):
        value = value[0] if value else None
    text = str(value) if isinstance(value, (str, int, float)) else ""
    line = " ".join("".join(one if one.isprintable() else " " for one in text[:_MOST_TEXT]).split())
    return line.strip('"') or otherwise


def _area(corners: Sequence[Point]) -> float:
    following = [*corners[1:], corners[0]]
    return abs(sum(x * v - u * y for (x, y), (u, v) in zip(corners, following, strict=True))) / 2
