"""`Drawing`: what was understood of a sketch, in pixels of the working image.

Points are (column, row) in pixel coordinates, rows downwards: the pixel in column c and row r covers [c, c+1]
x [r, r+1] and has its centre at (c + 0.5, r + 0.5), as in `geometry.plane`. A closed contour does not repeat
its first point and runs clockwise as seen on the screen (positive shoelace area with rows downwards).
"""

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float32, Float64


@dataclass(frozen=True, eq=False)
class Drawing:
    """A sketch taken apart.  Arrays are read-only."""

    width: int
    height: int
    """Size of the working image, pixels (the picture given, scaled to 600-1600 on its longer side)."""
    silhouette: Bool[np.ndarray, "H W"]
    """True inside the outline (its outer edge), openings not cut out."""
    outline: Float64[np.ndarray, "N 2"]
    """Closed contour of the silhouette, evenly spaced, freed of pixel stairs and jitter, its corners sharp.
    """
    eyes: tuple[Float64[np.ndarray, "_ 2"], ...]
    """None or two closed contours, the left one of the picture first: the centre line of the drawn loop."""
    holes: tuple[Float64[np.ndarray, "_ 2"], ...]
    """Other closed contours that are meant to be open, where whoever drew it says so (the library's drawings)."""
    regions: tuple[Float64[np.ndarray, "_ 2"], ...]
    """Closed contours of the other loops and filled spots inside (nose, cheeks, inner ears), largest first.
    """
    strokes: tuple[Float64[np.ndarray, "_ 2"], ...]
    """Open centre lines of the other ink inside the outline (mouth, brows, whiskers up to the rim), longest
    first.
    """
    stroke_width_px: float
    """Typical width of a drawn line."""
    outline_closed: bool
    """The outline was closed as drawn; False when a gap had to be bridged."""
    gap_closed_px: float
    """Longest gap that was bridged in the outline; 0 when there was none."""
    symmetry_axis_px: float
    """Column where the best mirror axis crosses the middle row of the image."""
    symmetry_tilt_deg: float
    """Angle of that axis against the columns, positive when its upper end leans to the right."""
    symmetry_iou: float
    """Overlap (intersection over union) of the silhouette with its mirror image about that axis; 1 is
    symmetric.
    """
    dropped: tuple[str, ...] = ()
    """What was seen and left out, a phrase each."""
    warnings: tuple[str, ...] = ()
    """What the user should know, a sentence each."""
    shade: Float32[np.ndarray, "H W"] | None = None
    """Of a photograph: -1 to 1, lighter or darker than the neighbourhood; None for a line drawing."""
    told_apart: str = ""
    """Of a photograph: how the object was told from its background, a phrase."""

    @property
    def lines(self) -> tuple[Float64[np.ndarray, "_ 2"], ...]:
        """The strokes, and the rims of the holes: what lies behind a motif or a mask closes them."""
        return (*self.strokes, *(np.vstack([hole, hole[:1]]) for hole in self.holes))

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                object.__setattr__(self, item.name, _frozen(value))
            elif isinstance(value, tuple):
                object.__setattr__(
                    self, item.name, tuple(_frozen(v) if isinstance(v, np.ndarray) else v for v in value)
                )


def _frozen(array: np.ndarray) -> np.ndarray:
    """A read-only copy: the caller's own array must stay writable."""
    copy = array.copy()
    copy.setflags(write=False)
    return copy
