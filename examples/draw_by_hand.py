"""How much of what people draw is understood: eight subjects of known shape, drawn by thirty hands.

    python examples/draw_by_hand.py                       the table: share understood, by hand
    python examples/draw_by_hand.py --hands gaps,marker   some of them
    python examples/draw_by_hand.py --sheet FILE.png      the contact sheet: input, understood, relief
    python examples/draw_by_hand.py --folder FOLDER       also keep every drawing, and what was understood of it

A drawing is understood when its silhouette overlaps the truth by 0.9 or more (intersection over union) and every opening
(an eye, a lens, the bore of a ring) was seen as a loop.  It may be refused with a reason instead; it must not be misread.
Seeded: the same hand draws the same picture every time.  Pixels, y down, a page of 1000 x 1000.
"""

import argparse
import itertools
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from draw_examples import curve, mirrored
from PIL import Image
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from fabcraft.errors import InputError
from fabcraft.geometry.contour import inside
from fabcraft.guidance.drawing import Drawing
from fabcraft.guidance.edges import understand
from fabcraft.guidance.outline import fill_contour
from fabcraft.guidance.show import picture_of
from fabcraft.read.image_file import read_image

PAGE = 1000
UNDERSTOOD = 0.9


# ---------------------------------------------------------------- what is drawn


@dataclass(frozen=True)
class Subject:
    """A shape as the strokes that draw it."""

    outline: list  # strokes that close on each other, in order
    openings: list  # closed loops that are meant to be open
    lines: list  # open strokes of detail
    colour: tuple[int, int, int]

    def truth(self) -> np.ndarray:
        """(N, 2) the closed centre line of the outline."""
        return np.vstack([s[:-1] for s in self.outline])


def ellipse(x, y, a, b, n=160):
    t = np.linspace(0, 2 * np.pi, n, endpoint=False)
    return np.column_stack([x + a * np.cos(t), y + b * np.sin(t)])


def ring_of(points):
    """A smooth closed outline as one stroke that ends where it began."""
    p = curve(points, closed=True)
    return [np.vstack([p, p[:1]])]


def both(points, middle=500.0):
    """A stroke from the upper middle down the right side, and its mirror image back up: a closed outline."""
    right = curve(points)
    return [right, mirrored(right, middle)[::-1]]


def corners_of(points):
    ends = [*points, points[0]]
    return [np.linspace(a, b, 80) for a, b in itertools.pairwise(np.asarray(ends, float))]


def subjects() -> dict[str, Subject]:
    """Eight shapes: faces, symbols, a beast from the side, and objects with openings."""
    cat_right = [
        curve([(500, 330), (560, 322), (620, 334)]),
        np.linspace([620, 334], [772, 130], 90),
        np.linspace([772, 130], [812, 420], 90),
        curve([(812, 420), (845, 560), (800, 720), (680, 835), (500, 872)]),
    ]
    cat = [*cat_right, *[mirrored(s, 500.0)[::-1] for s in reversed(cat_right)]]
    eyes = [ellipse(500 + s * 150, 560, 72, 46) for s in (-1, 1)]
    mouth = [curve([(500, 700), (470, 745), (420, 742)]), curve([(500, 700), (530, 745), (580, 742)])]
    bunny = both(
        [(500, 420), (540, 408), (560, 300), (590, 120), (650, 70), (700, 120), (690, 300), (650, 440), (745, 560),
         (760, 700), (690, 840), (500, 905)]
    )  # fmt: skip
    wings = both(
        [(500, 380), (560, 300), (690, 190), (850, 170), (930, 260), (910, 400), (800, 500), (860, 600), (850, 740),
         (740, 800), (620, 760), (540, 660), (500, 640)]
    )  # fmt: skip
    heart = both(
        [(500, 300), (560, 200), (680, 150), (800, 190), (868, 310), (840, 460), (720, 640), (500, 860)]
    )
    turn = np.radians(-90 + 36 * np.arange(10))
    spike = np.where(np.arange(10) % 2, 175.0, 420.0)
    star = corners_of(np.column_stack([500 + spike * np.cos(turn), 520 + spike * np.sin(turn)]))
    dinosaur = ring_of(
        [(120, 300), (170, 230), (270, 215), (330, 270), (350, 380), (430, 420), (560, 400), (680, 440), (790, 540),
         (930, 620), (900, 660), (780, 640), (700, 650), (710, 800), (640, 805), (610, 690), (460, 690), (440, 805),
         (370, 800), (360, 650), (290, 540), (250, 400), (200, 370), (130, 350)]
    )  # fmt: skip
    plates = [
        curve([(430 + 75 * k, 520 + 16 * k), (455 + 75 * k, 480 + 16 * k), (490 + 75 * k, 535 + 16 * k)])
        for k in range(3)
    ]
    ring = both(
        [
            (500, 160),
            (620, 150),
            (700, 230),
            (690, 300),
            (800, 420),
            (845, 560),
            (790, 740),
            (660, 850),
            (500, 885),
        ]
    )
    frame = both(
        [(500, 400), (560, 390), (640, 330), (780, 300), (920, 330), (965, 400), (930, 540), (840, 640), (700, 650),
         (600, 590), (545, 500), (500, 475)]
    )  # fmt: skip
    return {
        "cat": Subject(cat, eyes, mouth, (240, 170, 90)),
        "bunny": Subject(bunny, [ellipse(500 + s * 125, 640, 62, 50) for s in (-1, 1)],
                         [curve([(470, 780), (500, 805), (530, 780)])], (225, 200, 205)),
        "butterfly": Subject(wings, [ellipse(500 + s * 215, 380, 84, 62) for s in (-1, 1)],
                             [curve([(560, 560), (660, 600), (740, 690)]), curve([(440, 560), (340, 600), (260, 690)])],
                             (120, 160, 230)),
        "heart": Subject(heart, [], [curve([(640, 250), (730, 260), (780, 330)])], (230, 70, 90)),
        "star": Subject(star, [], [], (250, 205, 70)),
        "dinosaur": Subject(dinosaur, [], [*plates, curve([(150, 320), (200, 325), (240, 310)])], (120, 190, 110)),
        "ring": Subject(ring, [ellipse(500, 590, 225, 225)], [curve([(440, 250), (500, 275), (560, 250)])], (235, 200, 90)),
        "glasses": Subject(frame, [ellipse(500 + s * 245, 475, 128, 102) for s in (-1, 1)], [], (90, 90, 110)),
    }  # fmt: skip


# ---------------------------------------------------------------- how it is drawn


@dataclass(frozen=True)
class Hand:
    """The pen, the hand that holds it, and what became of the page."""

    says: str
    pen: float = 9.0
    wobble: float = 1.2
    """Pixels the line strays from the truth, slowly."""
    passes: int = 1
    gap: float = 0.0
    """Length of the holes in the outline, pixels; three of them."""
    overshoot: float = 0.0
    """Pixels that a stroke runs on past its end."""
    ink: tuple[int, int, int] = (45, 45, 52)
    paper: tuple[int, int, int] = (252, 250, 244)
    dark: float = 0.95
    """Share of the paper's light that a line takes away."""
    grain: float = 0.0
    whiskers: bool = False
    hatching: bool = False
    filled: str = ""
    """`colour`: coloured in, with lines; `flat`: coloured in, no lines; `solid`: a silhouette."""
    beside: bool = False
    """A second, smaller drawing on the page."""
    rules: str = ""
    turn_deg: float = 0.0
    size: float = 1.0
    """Of the drawing on the page."""
    shift: tuple[float, float] = (0.0, 0.0)
    page: Callable[[np.ndarray, np.random.Generator], tuple[np.ndarray, np.ndarray]] | None = None
    """The page as it was photographed or scanned, and the 3 x 3 homography from the page to it."""
    suffix: str = "png"
    quality: int = 92


@dataclass(frozen=True)
class Drawn:
    """A picture and the truth about it."""

    file: Path
    silhouette: np.ndarray
    openings: list = field(repr=False)


def strayed(points, rng, amount):
    """The stroke as a hand draws it: slow waves and a little tremor across the line."""
    n = len(points)
    step = np.median(np.linalg.norm(np.diff(points, axis=0), axis=1)) + 1e-6
    slow, fast = (
        gaussian_filter1d(rng.normal(size=(n, 2)), s, axis=0, mode="nearest")
        * np.sqrt(2 * s * np.sqrt(np.pi))
        for s in (70 / step, 9 / step)
    )
    return points + amount * (slow + 0.15 * fast)


def cover(subject: Subject, hand: Hand, rng, to_page) -> np.ndarray:
    """(H, W) 0-1 how much ink there is, drawn twice as large and averaged down."""
    canvas = np.zeros((2 * PAGE, 2 * PAGE), np.float32)
    clear = []
    if hand.gap:
        ring = to_page(subject.truth())
        clear = [ring[int(share * len(ring))] for share in (0.13, 0.46, 0.78)]
    for stroke in subject.outline:
        for _ in range(hand.passes):
            points = to_page(overshot(stroke, hand.overshoot) if hand.overshoot else stroke)
            points = strayed(points, rng, hand.wobble) + (rng.normal(size=2) * 2.2 if hand.passes > 1 else 0)
            _ink(canvas, points, hand, rng, clear)
    for loop in subject.openings:
        for _ in range(hand.passes):
            _ink(canvas, strayed(to_page(np.vstack([loop, loop[:2]])), rng, 0.6 * hand.wobble), hand, rng)
    lines = list(subject.lines)
    if hand.whiskers:
        lines += whiskers(subject)
    if hand.hatching:
        lines += hatching(subject)
    for line in lines:
        _ink(canvas, strayed(to_page(line), rng, hand.wobble), hand, rng)
    return cv2.resize(canvas, (PAGE, PAGE), interpolation=cv2.INTER_AREA)


def _ink(canvas, points, hand, rng, clear=()):
    """One stroke of changing pressure; nothing near the places in `clear`."""
    n = len(points)
    press = 1 + 0.12 * gaussian_filter1d(rng.normal(size=n), 20, mode="nearest") * 8
    layer = np.zeros(canvas.shape, np.uint8)
    for k in range(n - 1):
        if any(np.linalg.norm(points[k] - c) < hand.gap / 2 for c in clear):
            continue
        a, b = (np.round(p * 2 * 16 - 8).astype(int) for p in points[k : k + 2])
        cv2.line(
            layer,
            a.tolist(),
            b.tolist(),
            255,
            max(1, round(2 * hand.pen * min(press[k], 1.3))),
            cv2.LINE_8,
            4,
        )
    deposit = layer.astype(np.float32) / 255
    canvas[:] = 1 - (1 - canvas) * (1 - deposit * (0.6 if hand.passes > 1 else 1.0))


def overshot(stroke, by):
    """The stroke run on at both ends."""
    out = []
    for p in (stroke[::-1], stroke):
        d = p[-1] - p[-6]
        out.append(p[-1] + np.linspace(0.05, 1, 12)[:, None] * d / (np.linalg.norm(d) + 1e-9) * by)
    return np.vstack([out[0][::-1], stroke, out[1]])


def whiskers(subject):
    """Three straight lines a side from inside across the outline and well beyond it."""
    ring = subject.truth()
    low, high = ring.min(0), ring.max(0)
    out = []
    for side, k in itertools.product((-1, 1), (0, 1, 2)):
        y = low[1] + (0.62 + 0.05 * k) * (high[1] - low[1])
        level = ring[np.abs(ring[:, 1] - y) < 12]
        if not len(level):
            continue
        x = level[:, 0].max() if side > 0 else level[:, 0].min()
        out.append(np.linspace([x - side * 110, y], [x + side * 95, y + 12 * (k - 1)], 60))
    return out


def hatching(subject):
    """Slanted shading over the lower right part of the shape, kept inside the outline."""
    ring = subject.truth()
    low, high = ring.min(0), ring.max(0)
    out = []
    for offset in np.arange(0.0, 1.6 * PAGE, 24.0):
        line = np.array([offset, low[1]]) + np.linspace(0, 1, 300)[:, None] * np.array([-0.7, 1.0]) * PAGE
        keep = inside(line, [ring]) & (line[:, 0] > low[0] + 0.58 * (high[0] - low[0]))
        for loop in subject.openings:
            keep &= ~inside(line, [loop])
        edges = np.flatnonzero(np.diff(np.r_[0, keep.astype(int), 0]))
        for a, b in zip(edges[::2], edges[1::2], strict=True):
            if b - a > 24:
                out.append(line[a + 7 : b - 7])
    return out


# ---------------------------------------------------------------- what becomes of the page


def shadowed(page, rng):
    """A lamp from the left, and the soft shadow of the hand that holds the phone."""
    y, x = np.mgrid[0:PAGE, 0:PAGE] / PAGE
    light = 1.0 - 0.35 * x - 0.15 * y
    light *= 1 - 0.45 / (1 + np.exp(-(x + 0.7 * y - 1.05) / 0.025))
    return np.clip(page * light[..., None] + rng.normal(size=(PAGE, PAGE, 1)) * 3, 0, 255), np.eye(3)


def noisy(page, rng):
    return np.clip(cv2.GaussianBlur(page, (0, 0), 1.2) + rng.normal(size=page.shape) * 14, 0, 255), np.eye(3)


def blurred(page, rng):
    return np.clip(cv2.GaussianBlur(page, (0, 0), 4.0) + rng.normal(size=page.shape) * 2, 0, 255), np.eye(3)


def wooden_table(shape, rng):
    """Brown boards with a grain along x."""
    grain = gaussian_filter(rng.normal(size=shape), (3.0, 90.0))
    boards = 12 * np.sin(np.arange(shape[0])[:, None] / 46.0)
    tone = 0.55 + 0.08 * grain / grain.std() + boards / 255
    return np.clip(tone[..., None] * np.array([150, 104, 66.0]), 0, 255)


def on_table(page, rng):
    """The sheet lies askew on a table, seen at a slant, in a light that falls off."""
    size = (1300, 1200)
    sheet = np.array([[0, 0], [PAGE, 0], [PAGE, PAGE], [0, PAGE]], np.float32)
    seen = np.array([[190, 120], [1120, 85], [1175, 1090], [120, 1065]], np.float32)
    way = cv2.getPerspectiveTransform(sheet, seen)
    laid = cv2.warpPerspective(page.astype(np.float32), way, size, flags=cv2.INTER_AREA)
    there = cv2.warpPerspective(np.ones((PAGE, PAGE), np.float32), way, size)[..., None]
    y, x = np.mgrid[0 : size[1], 0 : size[0]] / 1250
    light = (1.02 - 0.22 * x - 0.12 * y)[..., None]
    photo = (laid * there + wooden_table(size[::-1], rng) * (1 - there)) * light
    return np.clip(photo + rng.normal(size=(*size[::-1], 1)) * 3, 0, 255), way


def on_white_desk(page, rng):
    """White paper on a desk hardly darker than it, its edge a thin shadow."""
    photo, way = on_table(page, rng)
    there = cv2.warpPerspective(np.ones((PAGE, PAGE), np.float32), way, photo.shape[1::-1])
    edge = cv2.GaussianBlur(there, (0, 0), 3.0)
    desk = np.array([205, 203, 200.0]) * (0.82 + 0.18 * (1 - edge))[..., None]
    return np.where(there[..., None] > 0.5, photo, desk), way


def scaled(side):
    def to_size(page, _rng):
        k = side / PAGE
        how = cv2.INTER_AREA if k < 1 else cv2.INTER_CUBIC
        size = (side, side) if side < 3000 else (4000, 3000)
        small = cv2.resize(page, (min(size), min(size)), interpolation=how)
        out = np.full((size[1], size[0], 3), page[3, 3], np.float64)
        out[:, (size[0] - min(size)) // 2 :][:, : min(size)] = small
        k = min(size) / PAGE
        return np.clip(out, 0, 255), np.array([[k, 0, (size[0] - min(size)) // 2], [0, k, 0], [0, 0, 1.0]])

    return to_size


def rules(page, kind):
    """Blue lines of an exercise book with its red margin, or 5 mm squares."""
    out = page.copy()
    every = 40
    for k in range(24, PAGE, every):
        cv2.line(out, (0, k), (PAGE, k), (150, 180, 220), 2)
        if kind == "squared":
            cv2.line(out, (k, 0), (k, PAGE), (150, 180, 220), 2)
    if kind == "ruled":
        cv2.line(out, (96, 0), (96, PAGE), (225, 140, 140), 2)
    return out


HANDS: dict[str, Hand] = {
    "clean": Hand("one firm line", wobble=0.4),
    "wobble": Hand("a trembling hand", wobble=4.5),
    "gaps": Hand("three gaps in the outline", gap=48.0),
    "double": Hand("three searching passes of pencil", pen=4.5, passes=3, wobble=3.0, dark=0.7, grain=0.5),
    "overshoot": Hand("strokes cross at their ends", overshoot=34.0),
    "whiskers": Hand("whiskers across the outline", whiskers=True, pen=8.0),
    "hatching": Hand("shaded with slanted strokes", hatching=True, pen=5.0, dark=0.75, grain=0.3),
    "marker": Hand("a thick marker", pen=30.0),
    "fineliner": Hand("a thin pen", pen=2.4),
    "light pencil": Hand("very light pencil", pen=5.0, dark=0.16, grain=0.4),
    "pink pencil": Hand("light coloured pencil", pen=7.0, ink=(240, 130, 160), dark=0.75, grain=0.5),
    "yellow pencil": Hand("yellow pencil on white", pen=8.0, ink=(245, 215, 60), dark=0.85, grain=0.4),
    "colour": Hand("coloured in, black lines", filled="colour"),
    "flat colour": Hand("coloured areas, no lines", filled="flat"),
    "silhouette": Hand("filled with black", filled="solid"),
    "white on black": Hand("white on black", ink=(245, 245, 245), paper=(18, 18, 20), grain=0.2),
    "kraft": Hand("black on kraft paper", paper=(176, 134, 92), ink=(38, 30, 28), pen=8.0, grain=0.4),
    "white on kraft": Hand(
        "white on kraft paper", paper=(168, 126, 86), ink=(250, 246, 240), pen=9.0, grain=0.3
    ),
    "ruled": Hand("ruled paper", rules="ruled"),
    "squared": Hand("squared paper, pencil", rules="squared", pen=7.0, dark=0.8, grain=0.3),
    "turned": Hand("turned by 20 degrees", turn_deg=20.0, size=0.82),
    "shadow": Hand("uneven light, a hard shadow", page=shadowed, suffix="jpg"),
    "noise": Hand("grain and compression", page=noisy, suffix="jpg", quality=35),
    "blurred": Hand("out of focus", page=blurred, suffix="jpg"),
    "table": Hand("paper on a wooden table", page=on_table, suffix="jpg", size=0.85),
    "ruled on table": Hand(
        "ruled paper on a table", page=on_table, rules="ruled", size=0.8, suffix="jpg", pen=8.0
    ),
    "white desk": Hand("white paper on a white desk", page=on_white_desk, suffix="jpg", size=0.85),
    "border": Hand("the drawing touches the border", shift=(0.0, 118.0)),
    "tiny": Hand("64 pixels", pen=22.0, page=scaled(64)),
    "huge": Hand("12 megapixels", page=scaled(3000), suffix="jpg"),
    "two": Hand("a second, smaller drawing beside it", size=0.62, shift=(-150.0, -130.0), beside=True),
    "svg": Hand("an SVG file", suffix="svg"),
}


def draw(subject: Subject, hand: Hand, seed: int, folder: Path, name: str) -> Drawn:
    """The drawing in its file, and the truth in the pixels of that file."""
    rng = np.random.default_rng(seed)
    turn = np.radians(hand.turn_deg)
    matrix = hand.size * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])

    def to_page(points):
        return (np.asarray(points) - 500) @ matrix.T + 500 + hand.shift

    truth = [to_page(subject.truth()), *map(to_page, subject.openings)]
    file = folder / f"{name}.{hand.suffix}"
    if hand.suffix == "svg":
        file.write_text(as_svg(subject, hand))
        return Drawn(file, _filled(truth[0], hand.pen, (PAGE, PAGE)), truth[1:])
    layer = cover(subject, hand, rng, to_page)
    if hand.beside:
        second = cover(subject, hand, rng, lambda p: (np.asarray(p) - 500) * 0.24 + [840, 820])
        layer = np.maximum(layer, second)
    page = np.full((PAGE, PAGE, 3), hand.paper, np.float64)
    if hand.rules:
        page = rules(page, hand.rules)
    page = np.clip(page + 2.0 * rng.normal(size=(PAGE, PAGE, 1)), 0, 255)
    shape = _filled(truth[0], 1.0, (PAGE, PAGE))
    if hand.filled:
        body = cv2.GaussianBlur(shape.astype(np.float32), (0, 0), 0.8)[..., None]
        for loop in truth[1:]:
            body *= (
                1
                - cv2.GaussianBlur(_filled(loop, 1.0, (PAGE, PAGE)).astype(np.float32), (0, 0), 0.8)[
                    ..., None
                ]
            )
        tone = hand.ink if hand.filled == "solid" else subject.colour
        page = page * (1 - body) + np.array(tone, float) * body
        if hand.filled != "colour":
            layer = np.zeros_like(layer)
    tooth = gaussian_filter(rng.normal(size=layer.shape), 1.0)
    layer = np.clip(layer * (1 + hand.grain * tooth / tooth.std() * 0.5), 0, 1) * hand.dark
    page = page * (1 - layer[..., None]) + np.array(hand.ink, float) * layer[..., None]
    way = np.eye(3)
    if hand.page:
        page, way = hand.page(page, rng)
    pen = 0.0 if hand.filled in ("flat", "solid") else hand.pen
    Image.fromarray(page.round().astype(np.uint8)).save(file, quality=hand.quality)
    whole = _filled(truth[0], pen, (PAGE, PAGE)).astype(np.float32)
    seen = cv2.warpPerspective(whole, way, page.shape[1::-1], flags=cv2.INTER_LINEAR) > 0.5
    return Drawn(file, seen, [_through(loop, way) for loop in truth[1:]])


def _filled(contour, pen, shape):
    """(H, W) True inside the contour and the outer half of its line."""
    inner = fill_contour(np.asarray(contour, float), shape)
    if pen <= 1:
        return inner
    return inner | (cv2.distanceTransform((~inner).astype(np.uint8), cv2.DIST_L2, 5) <= pen / 2)


def _through(points, way):
    return cv2.perspectiveTransform(np.asarray(points, np.float64)[None], way)[0]


def as_svg(subject: Subject, hand: Hand) -> str:
    """The subject as paths with transforms, a class and a nested group."""

    def path(points, closed):
        return "M" + " L".join(f"{x:.1f} {y:.1f}" for x, y in points) + ("Z" if closed else "")

    openings = "".join(f'<path class="line" d="{path(loop, True)}"/>' for loop in subject.openings)
    lines = "".join(f'<path class="line" d="{path(line, False)}"/>' for line in subject.lines)
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 500 500" width="120mm" height="120mm">'
        f"<style>.line{{fill:none;stroke:#222;stroke-width:{hand.pen}}}</style>"
        f'<g transform="scale(.5)"><path class="line" d="{path(subject.truth(), True)}"/>{openings}<g>{lines}</g></g></svg>'
    )


# ---------------------------------------------------------------- what was understood


@dataclass(frozen=True)
class Outcome:
    """What became of one drawing."""

    drawn: Drawn
    drawing: Drawing | None
    refused: str
    overlap: float
    openings: int
    """Openings found of those drawn."""
    seconds: float

    @property
    def understood(self) -> bool:
        return self.overlap >= UNDERSTOOD and self.openings == len(self.drawn.openings)


def outcome(drawn: Drawn) -> Outcome:
    start = time.perf_counter()
    try:
        drawing = understand(read_image(drawn.file))
    except InputError as error:
        return Outcome(drawn, None, error.message, 0.0, 0, time.perf_counter() - start)
    seconds = time.perf_counter() - start
    height, width = drawn.silhouette.shape
    scale = np.array([width / drawing.width, height / drawing.height])
    seen = fill_contour(drawing.outline * scale, (height, width))
    overlap = float((seen & drawn.silhouette).sum() / (seen | drawn.silhouette).sum())
    loops = [
        fill_contour(loop * scale, (height, width))
        for loop in (*drawing.eyes, *drawing.holes, *drawing.regions)
    ]
    found = 0
    for opening in drawn.openings:
        want = fill_contour(opening, (height, width))
        found += any((want & loop).sum() > 0.75 * (want | loop).sum() for loop in loops)
    return Outcome(drawn, drawing, "", overlap, found, seconds)


def say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def table(hands, chosen, folder, in_turn=False) -> dict[str, list[Outcome]]:
    """Draw and understand everything; print a line for each hand."""
    say(f"{'hand':16s} understood refused misread  least IoU  openings  longest s")
    told = {}
    for turn, name in enumerate(hands):
        outcomes = []
        for k, (subject, shape) in enumerate(chosen.items()):
            if in_turn and k != turn % len(chosen):
                continue
            one = outcome(draw(shape, HANDS[name], 100 + k, folder, f"{name.replace(' ', '-')}-{subject}"))
            outcomes.append(one)
            if not one.understood:
                why = (
                    one.refused
                    or f"IoU {one.overlap:.3f}, openings {one.openings} of {len(one.drawn.openings)}"
                )
                say(f"    {name} {subject}: {why}")
            if one.drawing is not None:
                Image.fromarray(picture_of(one.drawing)).save(
                    folder / f"{one.drawn.file.stem}.understood.png"
                )
        told[name] = outcomes
        good, refused = sum(o.understood for o in outcomes), sum(bool(o.refused) for o in outcomes)
        seen = [o.overlap for o in outcomes if not o.refused]
        say(
            f"{name:16s} {good:6d}/{len(outcomes)} {refused:7d} {len(outcomes) - good - refused:7d}"
            f"  {min(seen, default=0.0):9.3f}  {sum(o.openings for o in outcomes):3d}/"
            f"{sum(len(o.drawn.openings) for o in outcomes):<3d}  {max(o.seconds for o in outcomes):9.1f}",
        )
    every = [o for outcomes in told.values() for o in outcomes]
    good, refused = sum(o.understood for o in every), sum(bool(o.refused) for o in every)
    say(f"\n{good} of {len(every)} understood ({good / len(every):.1%}), {refused} refused with a reason, "
        f"{len(every) - good - refused} misread")  # fmt: skip
    return told


def relief_pictures(outcomes) -> list[np.ndarray]:
    """Each drawing as the pendant it would become, lit from the upper left; an empty field for a refusal."""
    from fabcraft.body.human import human
    from fabcraft.fitting_room import plain
    from fabcraft.guidance.inflate import inflate, solid_mask
    from fabcraft.guidance.motif import place_motif
    from fabcraft.template.motif_plate import plate

    base = plain("necklace", human("man"))
    out = []
    for one in outcomes:
        picture = np.full((CELL, CELL, 3), 248, np.uint8)
        if one.drawing is not None:
            across, down = np.ptp(one.drawing.outline, axis=0)
            sheet, _ = plate(base, base.motifs[0], None, float(across / down))
            relief = inflate(place_motif(one.drawing, sheet), sheet)
            x, z = relief.fine.centres()
            xz = np.column_stack([x.ravel(), z.ravel()])
            height = (relief.height_at(xz) + relief.detail_at(xz)).reshape(x.shape)
            down_hill, right = np.gradient(height, relief.fine.pixel_mm)
            light = (0.75 + 0.45 * right + 0.6 * down_hill) / np.sqrt(1 + right**2 + down_hill**2)
            shade = np.clip(light, 0.1, 1.1)[..., None] * np.array([205, 196, 180.0])
            shade[~solid_mask(relief.outline, relief.openings, relief.fine)] = 248
            picture = fitted(np.clip(shade, 0, 255).astype(np.uint8))
        out.append(picture)
    return out


CELL = 220


def fitted(picture) -> np.ndarray:
    """The picture in a square cell, nothing cut off."""
    k = (CELL - 8) / max(picture.shape[:2])
    size = (max(1, round(picture.shape[1] * k)), max(1, round(picture.shape[0] * k)))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    cell = np.full((CELL, CELL, 3), 248, np.uint8)
    top, left = (CELL - size[1]) // 2, (CELL - size[0]) // 2
    cell[top : top + size[1], left : left + size[0]] = small
    return cell


def sheet(told: dict[str, list[Outcome]], columns=4) -> np.ndarray:
    """Input, understood and relief of the first drawing of every hand, side by side."""
    outcomes = [outcomes[0] for outcomes in told.values()]
    cells = []
    for name, one, relief in zip(told, outcomes, relief_pictures(outcomes), strict=True):
        shown = (
            np.full((CELL, CELL, 3), 248, np.uint8)
            if one.drawing is None
            else fitted(picture_of(one.drawing))
        )
        rgba = read_image(one.drawn.file).astype(float)
        given = rgba[..., :3] * rgba[..., 3:] / 255 + 255 - rgba[..., 3:]
        strip = np.hstack([fitted(given.astype(np.uint8)), shown, relief])
        title = np.full((26, strip.shape[1], 3), 248, np.uint8)
        verdict = (
            "" if one.understood else " (refused)" if one.refused else f" (misread, IoU {one.overlap:.2f})"
        )
        cv2.putText(
            title,
            HANDS[name].says + verdict,
            (8, 19),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.5,
            (40, 40, 40),
            1,
            cv2.LINE_AA,
        )
        cells.append(np.pad(np.vstack([title, strip]), ((0, 6), (0, 14), (0, 0)), constant_values=248))
    while len(cells) % columns:
        cells.append(np.full_like(cells[0], 248))
    return np.vstack([np.hstack(cells[k : k + columns]) for k in range(0, len(cells), columns)])


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--hands", default=",".join(HANDS))
    parser.add_argument("--subjects", default="")
    parser.add_argument(
        "--sheet", help="draw one subject for each hand, in turn, and write the contact sheet"
    )
    parser.add_argument("--folder")
    given = parser.parse_args()
    hands = given.hands.split(",")
    known = subjects()
    chosen = {name: known[name] for name in given.subjects.split(",")} if given.subjects else known
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(given.folder or temporary)
        folder.mkdir(parents=True, exist_ok=True)
        told = table(hands, chosen, folder, in_turn=bool(given.sheet))
        if given.sheet:
            Image.fromarray(sheet(told)).quantize(128).save(given.sheet, optimize=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
