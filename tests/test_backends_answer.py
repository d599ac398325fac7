"""What came back is what it says it is, or refused with a sentence that says what it was."""

import io
import zlib

import numpy as np
import pytest
import trimesh
from backed import glb, png

from fabcraft.backends.answer import checked_mesh, checked_picture
from fabcraft.backends.backend import MESH_BYTES, Answer
from fabcraft.errors import InputError


@pytest.mark.parametrize("ending", ["glb", "ply", "stl", "obj"])
def test_a_mesh_is_known_by_its_content(ending):
    data = trimesh.creation.box().export(file_type=ending)
    data = data.encode() if isinstance(data, str) else data
    assert checked_mesh(Answer(data, f"m.{ending}"), "it") == ending
    if ending != "obj":
        assert checked_mesh(Answer(data, "m.glb"), "it") == ending, "whatever its name says"


def test_an_ascii_stl_is_a_mesh():
    data = trimesh.creation.box().export(file_type="stl_ascii").encode()
    assert checked_mesh(Answer(data), "it") == "stl"


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "nothing"),
        (b"<!DOCTYPE html><html><body>Log in</body></html>", "a web page"),
        (b"\n  <html>", "a web page"),
        (b'[{"detail": "not found"}]', "JSON"),
        (b'{"detail": "not found"}', "cannot be used"),
        (b"hello", "start with 'hello'"),
        (glb()[:1000], "cannot be used"),
        (b"glTF" + b"\xff" * 400, "cannot be used"),
        (b"PK\x03\x04" + b"\0" * 100, "cannot be used"),
        (b"ply\nformat ascii 1.0\nelement vertex 99999999999\nend_header\n", "cannot be used"),
        (trimesh.PointCloud(np.zeros((3, 3))).export(file_type="ply"), "cannot be used"),
        (png(), "start with"),
    ],
)
def test_what_is_no_mesh_is_told_for_what_it_is(data, words):
    with pytest.raises(InputError, match=words) as caught:
        checked_mesh(Answer(data, "m.glb"), "the app")
    assert caught.value.message.startswith("the app answered") and "/tmp" not in caught.value.message


def test_a_web_page_named_obj_is_no_mesh():
    with pytest.raises(InputError, match="a web page"):
        checked_mesh(Answer(b"<html>v 0 0 0", "m.obj"), "it")


def test_a_mesh_has_an_end(monkeypatch):
    monkeypatch.setattr("fabcraft.backends.answer.MESH_BYTES", 1000)
    assert MESH_BYTES <= 500_000_000
    with pytest.raises(InputError, match="at most 1,000"):
        checked_mesh(Answer(glb()), "it")


@pytest.mark.parametrize("ending", ["png", "jpeg", "webp"])
def test_a_picture_is_known_by_its_content(ending):
    from PIL import Image

    out = io.BytesIO()
    Image.open(io.BytesIO(png())).save(out, ending)
    assert checked_picture(Answer(out.getvalue()), "it") == {"jpeg": "jpg"}.get(ending, ending)


def test_a_picture_of_a_million_million_pixels_is_refused():
    def chunk(kind: bytes, data: bytes) -> bytes:
        return len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")

    size = (10**6).to_bytes(4, "big")
    bomb = (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", size + size + b"\x08\x02\0\0\0")
        + chunk(b"IDAT", zlib.compress(b"\0" * 9999))
    )
    with pytest.raises(InputError, match="pixels"):
        checked_picture(Answer(bomb), "it")


@pytest.mark.parametrize("data", [b"", b"<html>", b"GIF89a....", png()[:80], b"RIFF1234WAVE"])
def test_what_is_no_picture_is_told(data):
    with pytest.raises(InputError, match="it answered"):
        checked_picture(Answer(data), "it")
