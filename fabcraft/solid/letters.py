"""Single-stroke letters for engraving: each glyph is a few polylines, so that a stroke is as wide as the printer needs.

A glyph's strokes are points on a grid 4 wide and 6 high, its foot at y = 0, read in order: "0036" goes from (0, 0) to
(3, 6).  Drawn for this project.
"""

import itertools
from collections.abc import Sequence

import manifold3d
import numpy as np
from jaxtyping import Float64

from fabcraft.errors import InputError

GLYPHS = {
    "A": "0004264440 0242", "B": "00063645443303 3342413000", "C": "4536160501103041",
    "D": "0006264442200000", "E": "46060040 0333", "F": "460600 0333", "G": "45361605011030414323",
    "H": "0006 4046 0343", "I": "1636 2620 1030", "J": "46413010 1001", "K": "0006 4602 1340",
    "L": "060040", "M": "0006234640", "N": "00064046", "O": "1030414536160501101030",
    "P": "00063645443303", "Q": "103041453616050110 2240", "R": "00063645443303 2340",
    "S": "453616050413334241301001", "T": "0646 2620", "U": "060110304146", "V": "062046",
    "W": "0610233046", "X": "0046 0640", "Y": "062346 2320", "Z": "06460040",
    "0": "102031352616050110", "1": "152620 1030", "2": "05163645440040", "3": "06462333424130100110",
    "4": "30360141", "5": "460604334241301001", "6": "36160501103041423303", "7": "064610",
    "8": "13040516364544331302011030414233", "9": "10304145361605041343",
    ".": "2021", ",": "2110", "-": "1333", "+": "0343 2125", "/": "0046", ":": "2122 2425", "#": "1016 3036 0242 0444",
    "_": "0040", "(": "36252130", ")": "16252110", "=": "0242 0444",
    "'": "2624", "!": "2623 2021", "?": "0516364533232221 2020", " ": "",
}  # fmt: skip
WIDE, HIGH = 4.0, 6.0
ADVANCE = 6.0
"""From one letter's left edge to the next one's, grid units: at the least height two strokes keep a stroke apart."""
LONGEST = 24
"""Letters in one label."""
_SEGMENTS = 12


def checked(text: str) -> str:
    """The text in capitals.  Raises `InputError` for one that cannot be engraved."""
    capitals = " ".join(text.upper().split())
    unknown = sorted({one for one in capitals if one not in GLYPHS})
    if unknown:
        raise InputError(
            f"the label {text!r} has {' '.join(unknown)}, which cannot be engraved",
            f"Use {''.join(sorted(GLYPHS)).strip()} and spaces.",
        )
    if not capitals or len(capitals) > LONGEST:
        raise InputError(
            f"the label {text!r} has {len(capitals)} letters; 1 to {LONGEST} were expected",
            "Give a size, a side or a name.",
        )
    return capitals


def width_mm(text: str, height_mm: float) -> float:
    """Width of the middle lines of `text` whose capitals' middle lines are `height_mm` high."""
    return ((len(text) - 1) * ADVANCE + WIDE) * height_mm / HIGH


def strokes(text: str, height_mm: float) -> list[Float64[np.ndarray, "_ 2"]]:
    """Middle lines of the strokes, mm, the text centred on (0, 0)."""
    unit = height_mm / HIGH
    lines = []
    for place, letter in enumerate(text):
        for stroke in GLYPHS[letter].split():
            grid = np.array([[float(x), float(y)] for x, y in zip(stroke[::2], stroke[1::2], strict=True)])
            lines.append(grid * unit + [place * ADVANCE * unit, 0.0])
    return [line - [0.5 * width_mm(text, height_mm), 0.5 * height_mm] for line in lines]


def outline(lines: Sequence[Float64[np.ndarray, "_ 2"]], stroke_mm: float) -> manifold3d.CrossSection:
    """The strokes with their width and round ends as one flat shape, mm."""
    dot = manifold3d.CrossSection.circle(0.5 * stroke_mm, _SEGMENTS)
    pieces = [
        manifold3d.CrossSection.batch_hull([dot.translate(tuple(one)), dot.translate(tuple(other))])
        for line in lines
        for one, other in itertools.pairwise(line)
    ]
    return manifold3d.CrossSection.batch_boolean(pieces, manifold3d.OpType.Add)
