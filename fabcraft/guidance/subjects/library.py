"""The library of line drawings: what people ask for on wearables, drawn for this project as curves.

Each theme is a TOML file beside this one, each subject a table in it:

    words       other words for it
    half        right half of the outline of a symmetric subject, from the middle's top to its bottom; or
    outline     the whole outline; or
    sector      a part of the outline that is repeated `fold` times about (0, 500)
    eye         the right eye of a face; the left one is its mirror image
    holes       loops that are meant to be open
    loops, lines            closed and open lines inside
    loop_pairs, line_pairs  the same, each with its mirror image

How a line is written: see `path`.  Objects, such as the heart as glasses, are named "SUBJECT TEMPLATE" in objects.toml.
"""

import tomllib
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
from jaxtyping import Float64

from fabcraft.errors import InputError
from fabcraft.geometry.contour import counter_clockwise
from fabcraft.guidance.drawing import Drawing
from fabcraft.guidance.outline import fill_contour
from fabcraft.guidance.subjects.path import Knots, closed_curve, joined, knots, open_curve
from fabcraft.guidance.symmetry import mirror_axis

THEMES = ("animals", "water", "plants", "sky", "symbols", "monsters", "sports", "treats", "things")
OBJECTS = "objects"
PEN, MARGIN = 12.0, 60.0
"""Width of a drawn line, and of the bare paper around a drawing."""
_LISTS = ("holes", "hole_pairs", "loops", "loop_pairs", "lines", "line_pairs")
Points = Float64[np.ndarray, "_ 2"]


@dataclass(frozen=True)
class Subject:
    """An entry of the library, not yet drawn."""

    name: str
    theme: str
    words: tuple[str, ...]
    """Other words for it."""
    table: dict[str, Any]
    """As the file has it."""

    @property
    def face(self) -> bool:
        """It looks at you: its eyes come over the wearer's."""
        return "eye" in self.table


def subjects() -> dict[str, Subject]:
    """Every subject by name, theme by theme."""
    return {one.name: one for theme in THEMES for one in _read(theme)}


def objects() -> dict[str, Subject]:
    """The drawings of whole objects, by "SUBJECT TEMPLATE"."""
    return {one.name: one for one in _read(OBJECTS)}


def _read(theme: str) -> list[Subject]:
    text = files(__package__).joinpath(f"{theme}.toml").read_text("utf-8")
    return [
        Subject(name, theme, tuple(table.get("words", ())), table)
        for name, table in tomllib.loads(text).items()
    ]


def drawing_of(subject: Subject) -> Drawing:
    """The subject as the sketch parser would give it, without the loss of a picture.

    Raises `InputError` for a table that is no drawing.
    """
    table = subject.table
    if bad := set(table) - {"words", "half", "outline", "sector", "fold", "eye", *_LISTS}:
        raise InputError(f"the drawing of {subject.name} has an unknown key {min(bad)}", "Mend its file.")
    outline = closed_curve(_outline(table, subject.name))
    lower, upper = outline.min(0), outline.max(0)
    width, height = np.ceil(upper - lower + 2 * MARGIN).astype(int).tolist()

    def laid(points: Points) -> Points:
        return points - lower + MARGIN

    def drawn(key: str) -> list[Points]:
        curve = closed_curve if key in ("holes", "loops") else open_curve
        found = [curve(knots(text)) for text in table.get(key, ())]
        for text in table.get(f"{key[:-1]}_pairs", ()):
            found += [curve(knots(text).mirrored()), curve(knots(text))]
        return [laid(line) for line in found]

    outline = counter_clockwise(laid(outline))
    silhouette = fill_contour(outline, (height, width))
    axis = mirror_axis(silhouette)
    eye = [knots(table["eye"])] if "eye" in table else []
    eyes = [closed_curve(one) for right in eye for one in (right.mirrored(), right)]
    return Drawing(
        width=width,
        height=height,
        silhouette=silhouette,
        outline=outline,
        eyes=tuple(counter_clockwise(laid(one)) for one in eyes),
        holes=tuple(counter_clockwise(one) for one in drawn("holes")),
        regions=tuple(counter_clockwise(one) for one in drawn("loops")),
        strokes=tuple(drawn("lines")),
        stroke_width_px=PEN,
        outline_closed=True,
        gap_closed_px=0.0,
        symmetry_axis_px=axis.column_px,
        symmetry_tilt_deg=axis.tilt_deg,
        symmetry_iou=axis.iou,
    )


def _outline(table: dict[str, Any], name: str) -> Knots:
    if "half" in table:
        right = knots(table["half"])
        return joined([right, right.mirrored()])
    if "sector" in table:
        part, fold = knots(table["sector"]), int(table["fold"])
        return joined([part.turned(360.0 * k / fold, (0.0, 500.0)) for k in range(fold)])
    if "outline" in table:
        return knots(table["outline"])
    raise InputError(f"the drawing of {name} has no outline", "Give it half, outline or sector.")
