import os
import struct
import time
import zlib

import numpy as np
import pytest
from PIL import Image

from fabcraft.errors import InputError
from fabcraft.read.image_file import read_image


@pytest.fixture
def picture():
    """(60, 90, 3): a red left upper corner on a grey ramp."""
    ramp = np.repeat(np.linspace(40, 220, 90, dtype=np.uint8)[None], 60, 0)
    rgb = np.stack([ramp] * 3, 2)
    rgb[:20, :20] = (250, 10, 10)
    return rgb


@pytest.mark.parametrize(("suffix", "loss"), [("png", 0), ("webp", 30), ("jpg", 30)])
def test_a_picture_comes_back_as_it_was_written(tmp_path, picture, suffix, loss):
    Image.fromarray(picture).save(tmp_path / f"a.{suffix}", quality=95)
    rgba = read_image(tmp_path / f"a.{suffix}")
    assert rgba.dtype == np.uint8
    assert rgba.shape == (60, 90, 4)
    assert (rgba[..., 3] == 255).all()
    assert np.abs(rgba[..., :3].astype(int) - picture).mean() <= loss / 10


@pytest.mark.parametrize("tag", range(1, 9))
def test_all_eight_exif_orientations_come_out_upright(tmp_path, picture, tag):
    stored = {
        1: picture, 2: picture[:, ::-1], 3: picture[::-1, ::-1], 4: picture[::-1],
        5: picture.transpose(1, 0, 2), 6: np.rot90(picture),
        7: picture[::-1, ::-1].transpose(1, 0, 2), 8: np.rot90(picture, -1),
    }[tag]  # fmt: skip
    exif = Image.Exif()
    exif[0x0112] = tag
    Image.fromarray(np.ascontiguousarray(stored)).save(tmp_path / "a.png", exif=exif)
    assert np.array_equal(read_image(tmp_path / "a.png")[..., :3], picture)


@pytest.mark.parametrize("mode", ["1", "L", "LA", "P", "RGBA", "CMYK", "I;16"])
def test_every_colour_mode_becomes_rgba(tmp_path, picture, mode):
    if mode == "I;16":
        image = Image.fromarray(picture[..., 1].astype(np.uint16) * 257)
    else:
        image = Image.fromarray(picture).convert(mode)
    name = tmp_path / ("a.jpg" if mode == "CMYK" else "a.png")
    image.save(name)
    rgba = read_image(name)
    assert rgba.shape == (60, 90, 4)
    assert rgba[40, 80, 0] > rgba[40, 30, 0] or mode == "1"
    if mode == "I;16":
        assert np.array_equal(rgba[..., 1], picture[..., 1])


def test_transparency_is_kept(tmp_path, picture):
    alpha = np.zeros((60, 90, 1), np.uint8)
    alpha[10:30] = 180
    Image.fromarray(np.dstack([picture, alpha])).save(tmp_path / "a.png")
    assert np.array_equal(read_image(tmp_path / "a.png")[..., 3:], alpha)


def test_a_large_picture_is_scaled_to_1600(tmp_path):
    Image.new("RGB", (4000, 3000), (9, 200, 30)).save(tmp_path / "a.jpg")
    Image.new("L", (900, 3200), 70).save(tmp_path / "a.png")
    assert read_image(tmp_path / "a.jpg").shape == (1200, 1600, 4)
    assert read_image(tmp_path / "a.png").shape == (1600, 450, 4)


def png_header(width, height):
    """A PNG that claims a size and holds next to nothing."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(b"\0" * 99))
        + chunk(b"IEND", b"")
    )


@pytest.mark.parametrize("side", [8100, 12_000, 40_000, 2_000_000_000])
def test_a_huge_picture_is_refused_from_its_header(tmp_path, side):
    (tmp_path / "a.png").write_bytes(png_header(side, side))
    start = time.perf_counter()
    with pytest.raises(InputError, match=r"megapixels") as error:
        read_image(tmp_path / "a.png")
    assert time.perf_counter() - start < 0.5
    assert "smaller" in error.value.next_step


def test_a_tiny_picture_is_refused(tmp_path):
    Image.new("RGB", (400, 31)).save(tmp_path / "a.png")
    with pytest.raises(InputError, match="400 x 31 pixels, expected at least 32"):
        read_image(tmp_path / "a.png")


def broken(tmp_path, kind):
    """A path with which something is wrong, and what the message says about it."""
    path = tmp_path / "a.png"
    if kind == "missing":
        return path, "there is no file"
    if kind == "folder":
        return tmp_path, "is a folder"
    if kind == "pipe":
        os.mkfifo(path)
        return path, "not a regular file"
    if kind == "null":
        return tmp_path / "a\0b.png", "cannot look at|there is no file"
    if kind == "too long":
        return tmp_path / ("a" * 5000), "cannot look at|there is no file"
    content = {
        "empty": (b"", "is empty"),
        "text": (b"this is no picture at all\n" * 9, "is not a PNG, JPEG, WebP or SVG picture"),
        "gif": (b"GIF89a" + b"\0" * 99, "is not a PNG, JPEG, WebP or SVG picture"),
        "only a header": (png_header(400, 300)[:33], "damaged|cannot read|is not a"),
        "too few rows": (png_header(400, 300), "damaged"),
    }[kind]
    path.write_bytes(content[0])
    return path, content[1]


KINDS = [
    "missing",
    "folder",
    "pipe",
    "null",
    "too long",
    "empty",
    "text",
    "gif",
    "only a header",
    "too few rows",
]


@pytest.mark.parametrize("kind", KINDS)
def test_what_cannot_be_read_is_refused_with_a_next_step(tmp_path, kind):
    path, says = broken(tmp_path, kind)
    with pytest.raises(InputError, match=says) as error:
        read_image(path)
    assert error.value.next_step.endswith(".")


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9, 0.99])
@pytest.mark.parametrize("suffix", ["png", "jpg", "webp"])
def test_a_cut_off_file_is_damaged(tmp_path, picture, suffix, share):
    path = tmp_path / f"a.{suffix}"
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (200, 200, 3)).astype(np.uint8)).save(path)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(InputError, match=r"damaged|cannot read|is not a"):
        read_image(path)
