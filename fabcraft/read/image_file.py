"""An image file becomes an (H, W, 4) array: PNG, JPEG, WebP or SVG, upright, at most 64 Mpx, its longer side at
most 1600 px.

The size is read from the header before a single pixel is decoded, so a file that claims 40,000 x 40,000 is
refused at once. Rows run downwards; colours are sRGB, 8 bits, alpha not premultiplied.
"""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8

from fabcraft.errors import InputError
from fabcraft.read.svg_file import is_svg, read_svg

if TYPE_CHECKING:
    from PIL import Image

FORMATS = ("PNG", "JPEG", "WEBP")
MAX_PIXELS = 64_000_000
MIN_SIDE = 32
MAX_SIDE = 1600
SMALLER = "Make it smaller: 1600 px on the longer side is enough."
SAVE_AGAIN = "Open it in any image program and save it as PNG or JPEG."


def read_image(path: str | Path) -> UInt8[np.ndarray, "H W 4"]:
    """(H, W, 4) uint8 RGBA of a picture, upright, downscaled so that its longer side is at most 1600 px.

    Raises `InputError` for what is missing, empty, damaged, too large, too small or no picture.
    """
    from PIL import Image, ImageOps

    path = Path(path)
    _require_file(path)
    if is_svg(_head(path)):
        return read_svg(path)
    with _open(path) as image:
        _require_size(path, *image.size)
        try:
            if image.format == "JPEG":  # let the decoder skip what would be thrown away
                image.draft(None, (MAX_SIDE, MAX_SIDE))
            upright = _rgba(ImageOps.exif_transpose(image))
            scale = MAX_SIDE / max(upright.size)
            if scale < 1:
                size = (max(1, round(upright.width * scale)), max(1, round(upright.height * scale)))
                upright = upright.resize(size, Image.Resampling.BOX)
            return np.array(upright, dtype=np.uint8)
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
            raise InputError(f"{path} is damaged: {error}", SAVE_AGAIN) from error


def _require_file(path: Path) -> None:
    """Only a regular file with something in it is opened; a pipe or a device could wait for ever."""
    look = "Check the path."
    try:
        if path.is_dir():
            raise InputError(
                f"{path} is a folder, expected a picture", "Name a PNG, JPEG, WebP or SVG file in it."
            )
        if not path.exists():
            raise InputError(f"there is no file {path}", look)
        if not path.is_file():
            raise InputError(f"{path} is not a regular file", look)
        if path.stat().st_size == 0:
            raise InputError(f"{path} is empty (0 bytes)", "Export or copy the picture again.")
    except (OSError, ValueError) as error:
        raise InputError(f"cannot look at {path}: {error}", look) from error


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(1024)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error}", "Check who may read it.") from error


def _open(path: Path) -> "Image.Image":
    """The Pillow image, its header read and nothing decoded."""
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # the limit here is lower
            return Image.open(path, formats=FORMATS)
    except UnidentifiedImageError as error:
        raise InputError(
            f"{path} is not a PNG, JPEG, WebP or SVG picture, whatever its name says", SAVE_AGAIN
        ) from error
    except Image.DecompressionBombError as error:
        raise InputError(f"{path} has far more pixels than the limit of 64 megapixels", SMALLER) from error
    except (OSError, ValueError, SyntaxError, OverflowError) as error:
        raise InputError(f"cannot read {path}: {error}", SAVE_AGAIN) from error


def _require_size(path: Path, width: int, height: int) -> None:
    if width * height > MAX_PIXELS:
        raise InputError(
            f"{path} is {width} x {height} pixels ({width * height / 1e6:.0f} megapixels), "
            "more than the limit of 64 megapixels",
            SMALLER,
        )
    if min(width, height) < MIN_SIDE:
        raise InputError(
            f"{path} is {width} x {height} pixels, expected at least {MIN_SIDE} on the shorter side",
            "Scan or export it larger: 600-1600 px on the longer side is good.",
        )


def _rgba(image: "Image.Image") -> "Image.Image":
    """RGBA of any mode Pillow reads; 16-bit and float grey, which `convert` would clip, are scaled."""
    from PIL import Image

    if image.mode.startswith("I") or image.mode == "F":
        grey = np.asarray(image, dtype=np.float64)
        top = 65535.0 if grey.max() > 255 else 255.0
        return Image.fromarray(np.clip(grey / top * 255, 0, 255).astype(np.uint8)).convert("RGBA")
    return image.convert("RGBA")
