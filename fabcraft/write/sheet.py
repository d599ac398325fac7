"""Pictures side by side, with words: labels, contact sheets and colour bars (Pillow; its own font, no file
needed)."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64, UInt8
from PIL import Image, ImageDraw, ImageFont

INK = (38, 42, 48)
PAPER = (250, 250, 251)


def labelled(
    image: UInt8[np.ndarray, "H W 3"], label: str, *, height: int = 0
) -> UInt8[np.ndarray, "H2 W 3"]:
    """The picture with `label` in a strip of `height` pixels below (0: a sixteenth of the width)."""
    height = height or max(20, image.shape[1] // 16)
    strip = Image.new("RGB", (image.shape[1], height), PAPER)
    font = _font_that_fits(label, image.shape[1] - 8, round(height * 0.6))
    ImageDraw.Draw(strip).text((image.shape[1] / 2, height / 2), label, INK, font, anchor="mm")
    return np.concatenate([image, np.asarray(strip)])


def contact_sheet(
    images: Sequence[UInt8[np.ndarray, "_ _ 3"]],
    labels: Sequence[str] = (),
    *,
    columns: int = 0,
    gap: int = 6,
) -> UInt8[np.ndarray, "H W 3"]:
    """Pictures in a grid of equal cells, centred, each with its label; `columns` 0: as square as it goes."""
    if not images:
        return np.full((1, 1, 3), PAPER, np.uint8)
    width = max(image.shape[1] for image in images)
    height = max(image.shape[0] for image in images)
    cells = [_centred(image, height, width) for image in images]
    if labels:
        cells = [labelled(cell, label) for cell, label in zip(cells, labels, strict=True)]
    columns = columns or int(np.ceil(np.sqrt(len(cells))))
    rows = -(-len(cells) // columns)
    height = cells[0].shape[0]
    sheet = np.full((rows * (height + gap) + gap, columns * (width + gap) + gap, 3), PAPER, np.uint8)
    for index, cell in enumerate(cells):
        top = gap + index // columns * (height + gap)
        left = gap + index % columns * (width + gap)
        sheet[top : top + height, left : left + width] = cell
    return sheet


def with_colour_bar(
    image: UInt8[np.ndarray, "H W 3"],
    bar: Float64[np.ndarray, "N 3"],
    ticks: Sequence[tuple[float, str]],
    title: str,
) -> UInt8[np.ndarray, "H W2 3"]:
    """The picture with a vertical bar of sRGB colours (lowest value first) and `ticks` (place in [0, 1],
    text)."""
    height = image.shape[0]
    size = max(11, height // 40)
    font, strip_width = ImageFont.load_default(size), size * 7
    top, bottom = round(height * 0.15), round(height * 0.85)
    bar_left, bar_right = size, size + round(size * 1.4)
    strip = np.full((height, strip_width, 3), PAPER, np.uint8)
    rows = np.round(np.linspace(len(bar) - 1, 0, bottom - top)).astype(int)
    strip[top:bottom, bar_left:bar_right] = np.round(bar[rows] * 255)[:, None, :].astype(np.uint8)
    canvas = Image.fromarray(strip)
    draw = ImageDraw.Draw(canvas)
    draw.rectangle((bar_left - 1, top - 1, bar_right, bottom), outline=(170, 174, 180))
    heading = _font_that_fits(title, strip_width - size, size)
    draw.text((bar_left, top - size * 0.8), title, INK, heading, anchor="ls")
    for place, text in ticks:
        y = bottom - 1 - place * (bottom - 1 - top)
        draw.line((bar_right, y, bar_right + size * 0.4, y), fill=INK)
        draw.text((bar_right + size * 0.6, y), text, INK, font, anchor="lm")
    return np.concatenate([image, np.asarray(canvas)], axis=1)


def _centred(image: np.ndarray, height: int, width: int) -> np.ndarray:
    """The picture in the middle of a cell."""
    cell = np.full((height, width, 3), PAPER, np.uint8)
    top, left = (height - image.shape[0]) // 2, (width - image.shape[1]) // 2
    cell[top : top + image.shape[0], left : left + image.shape[1]] = image
    return cell


def _font_that_fits(text: str, width: int, size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Pillow's font, smaller where `text` would be wider than `width` pixels, but never under 8."""
    while size > 8 and ImageFont.load_default(size).getlength(text) > width:
        size -= 1
    return ImageFont.load_default(size)
