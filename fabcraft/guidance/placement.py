"""Where a drawing sits on the face, and how large it is.

With drawn eyes: they come over the real ones, at a size between the one that matches the eye distance exactly and one a
little larger, whichever brings the drawn face (ears aside) nearer the size of the template. Without: the drawn face is
made as large as the template's, its mirror axis comes over the middle of the face, and it is shifted by the least that
keeps the template's eye openings well inside. A user's own scale and shift are added on top.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Float32, Float64

from fabcraft.errors import InputError
from fabcraft.geometry.contour import counter_clockwise
from fabcraft.geometry.plane import Plane
from fabcraft.guidance.drawing import Drawing
from fabcraft.template.mask import ROOM_WALLS, room_around
from fabcraft.template.template import Template


@dataclass(frozen=True)
class PlacementSettings:
    """A user's say in where a drawing sits."""

    scale: float = 1.0
    """Size of the drawing over the size that fabcraft would choose (0.5-2)."""
    up_mm: float = 0.0
    """Shift upwards, mm."""
    left_mm: float = 0.0
    """Shift towards the wearer's left, mm."""

    def __post_init__(self) -> None:
        if not 0.5 <= self.scale <= 2.0:
            raise InputError(f"a placement scale of {self.scale} was asked", "Choose between 0.5 and 2.")
        if max(abs(self.up_mm), abs(self.left_mm)) > 100.0:
            raise InputError(
                f"a shift of {self.up_mm} mm up and {self.left_mm} mm left was asked", "Stay within 100 mm."
            )


@dataclass(frozen=True, eq=False)
class Shading:
    """Light and shade of a photograph in the front view."""

    plane: Plane
    value: Float32[np.ndarray, "H W"]
    """-1 to 1, 0 at the rim and outside."""

    def moved(self, up_mm: float) -> "Shading":
        return replace(self, plane=replace(self.plane, top_mm=self.plane.top_mm + up_mm))


def shading_of(drawing: Drawing, corner_mm: Float64[np.ndarray, "2"], pixel_mm: float) -> Shading | None:
    """The shading of a drawing whose upper left corner lies there; None when it has none."""
    if drawing.shade is None:
        return None
    plane = Plane(float(corner_mm[0]), float(corner_mm[1]), float(pixel_mm), drawing.width, drawing.height)
    return Shading(plane, drawing.shade)


@dataclass(frozen=True, eq=False)
class PlacedDrawing:
    """A drawing in the front view of a template: contours and lines in (x, z), mm."""

    outline: Float64[np.ndarray, "N 2"]
    """Counter-clockwise."""
    openings: tuple[Float64[np.ndarray, "_ 2"], ...]
    """Eye openings to be cut, the wearer's right eye first; the template's own where the drawing has none."""
    regions: tuple[Float64[np.ndarray, "_ 2"], ...]
    strokes: tuple[Float64[np.ndarray, "_ 2"], ...]
    stroke_width_mm: float
    pixel_mm: float
    """Size of a pixel of the working image."""
    by_eyes: bool
    """The drawn eyes were used."""
    notes: tuple[str, ...]
    shading: Shading | None = None


def place(
    drawing: Drawing, template: Template, settings: PlacementSettings | None = None, at: Plane | None = None
) -> PlacedDrawing:
    """The drawing on the template.

    at : where the drawing lies already; found when None.
    Raises `InputError` when no size and place leaves room for the eye openings.
    """
    settings = settings or PlacementSettings()
    if template.body.kind != "human" and "eye_left" not in template.body.landmarks:
        raise InputError(f"body {template.body.name} has no eyes to place a mask by", "Use a head.")
    if at is not None:
        origin = drawing.outline.mean(0)
        centre, pixel_mm = at.to_mm(origin[None])[0], at.pixel_mm
    elif len(drawing.eyes) == 2:
        origin, centre, pixel_mm = _by_eyes(drawing, template)
    else:
        origin, centre, pixel_mm = _by_outline(drawing, template)
    pixel_mm *= settings.scale
    centre = centre + [settings.left_mm, settings.up_mm]
    notes: list[str] = []

    def laid(points: np.ndarray) -> np.ndarray:
        return centre + (points - origin) * [pixel_mm, -pixel_mm]

    outline = counter_clockwise(laid(drawing.outline))
    openings = template.openings
    if len(drawing.eyes) == 2:
        openings = tuple(_wide_enough(laid(eye), template, notes) for eye in drawing.eyes)
    placed = PlacedDrawing(
        outline,
        openings,
        tuple(laid(region) for region in drawing.regions),
        tuple(laid(line) for line in drawing.lines),
        drawing.stroke_width_px * pixel_mm,
        pixel_mm,
        len(drawing.eyes) == 2,
        tuple(notes),
        shading_of(drawing, laid(np.zeros(2)), pixel_mm),
    )
    return _with_room(placed, template, settings)


def _face(template: Template) -> tuple[np.ndarray, np.ndarray]:
    lower, upper = template.outline.min(0), template.outline.max(0)
    return 0.5 * (lower + upper), upper - lower


def _drawn_face(drawing: Drawing) -> tuple[np.ndarray, np.ndarray]:
    """Centre and size, pixels, of the silhouette without ears and other limbs: its opening by a disc."""
    small = 256.0 / max(drawing.height, drawing.width)
    shape = (max(8, round(drawing.width * small)), max(8, round(drawing.height * small)))
    silhouette = cv2.resize(drawing.silhouette.astype(np.uint8), shape, interpolation=cv2.INTER_AREA)
    silhouette = np.pad(silhouette, 1)
    depth = cv2.distanceTransform(silhouette, cv2.DIST_L2, 5)
    radius = 0.6 * float(depth.max())
    heart = (depth >= radius).astype(np.uint8)
    grown = cv2.distanceTransform(1 - heart, cv2.DIST_L2, 5) <= radius
    rows, columns = np.nonzero(grown)
    lower, upper = np.array([columns.min(), rows.min()]) - 1.0, np.array([columns.max(), rows.max()]) + 0.0
    return 0.5 * (lower + upper) / small, (upper - lower) / small


def _size_by_face(drawing: Drawing, template: Template) -> float:
    """mm per pixel that gives the drawn face the template's size, between matching its width and its height."""
    _, drawn = _drawn_face(drawing)
    _, wanted = _face(template)
    return float(np.sqrt(1.12 * wanted[0] / drawn[0] * wanted[1] / drawn[1]))


def _by_eyes(drawing: Drawing, template: Template) -> tuple[np.ndarray, np.ndarray, float]:
    eyes = np.array([eye.mean(0) for eye in drawing.eyes])
    landmarks = template.body.landmarks
    real = np.array([landmarks[name][[0, 2]] for name in ("eye_right", "eye_left")])
    exact = np.linalg.norm(real[1] - real[0]) / np.linalg.norm(eyes[1] - eyes[0])
    pixel_mm = float(np.clip(_size_by_face(drawing, template), 0.98 * exact, 1.12 * exact))
    return eyes.mean(0), real.mean(0), pixel_mm


def _by_outline(drawing: Drawing, template: Template) -> tuple[np.ndarray, np.ndarray, float]:
    drawn_centre, drawn_size = _drawn_face(drawing)
    centre, size = _face(template)
    pixel_mm = _size_by_face(drawing, template)
    if (
        drawn_size[1] < 0.75 * drawn_size[0]
    ):  # a half mask: its lower third is at the eyes, and it reaches the temples
        pixel_mm = max(pixel_mm, 1.12 * size[0] / drawn_size[0])
        eyes = np.mean([template.body.landmarks[name][2] for name in ("eye_left", "eye_right")])
        centre = np.array([centre[0], eyes + 0.15 * drawn_size[1] * pixel_mm])
    return np.array([drawing.symmetry_axis_px, drawn_centre[1]]), centre, pixel_mm


def _wide_enough(eye: np.ndarray, template: Template, notes: list[str]) -> np.ndarray:
    """A drawn eye made large enough to look through: at least `opening_share` of the template's opening each way."""
    least = template.opening_share * np.ptp(template.openings[0], axis=0)
    factor = np.maximum(least / np.ptp(eye, axis=0), 1.0)
    if factor.max() > 1.02 and not notes:
        notes.append(f"The eyes were enlarged up to {factor.max():.1f} times, to be looked through.")
    middle = 0.5 * (eye.min(0) + eye.max(0))
    return counter_clockwise(middle + (eye - middle) * factor)


def _with_room(placed: PlacedDrawing, template: Template, settings: PlacementSettings) -> PlacedDrawing:
    """The drawing shifted (if it has no eyes of its own) until the openings have a margin inside the outline."""
    margin = ROOM_WALLS * template.wall_mm
    settled = placed.by_eyes or settings.up_mm or settings.left_mm
    shifts = [0.0] if settled else sorted(template.scale * np.arange(-45.0, 46.0, 1.5), key=abs)
    for shift in shifts:
        outline = placed.outline + [0.0, shift]
        if room_around(outline, placed.openings) >= margin:
            if shift == 0.0:
                return placed
            return replace(
                placed,
                outline=outline,
                regions=tuple(region + [0.0, shift] for region in placed.regions),
                strokes=tuple(stroke + [0.0, shift] for stroke in placed.strokes),
                shading=placed.shading and placed.shading.moved(shift),
                notes=(*placed.notes, f"It was moved {shift:+.0f} mm up to leave room for the eyes."),
            )
    raise InputError(
        f"the eye openings come within {room_around(placed.outline, placed.openings):.1f} mm of the outline; "
        f"at least {margin:.1f} mm of material are needed around them",
        "Move the eyes further from the outline, or try --scale, --up or --left.",
    )
