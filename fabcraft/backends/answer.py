"""What a back end answered is looked at before it is believed: a mesh that can be read, or a picture that can be."""

import math
import tempfile
from pathlib import Path

from fabcraft.backends.backend import MESH_BYTES, PICTURE_BYTES, Answer
from fabcraft.errors import InputError
from fabcraft.read.image_file import read_image
from fabcraft.read.mesh_file import read_mesh

MESHES = ("glb", "gltf", "ply", "stl", "obj", "3mf")
PICTURES = ("png", "jpg", "webp")
_AGAIN = "Try again, or choose another one (fabcraft backends)."


def checked_mesh(answer: Answer, who: str) -> str:
    """The ending that the answered mesh has by its content.  Raises `InputError` unless it can be read as a mesh."""
    return _checked(answer, who, "mesh", MESH_BYTES, _mesh_ending(answer))


def checked_picture(answer: Answer, who: str) -> str:
    """The ending that the answered picture has by its content.  Raises `InputError` unless it can be read as one."""
    start = answer.data[:16]
    ending = next(
        (
            name
            for name, mark in (("png", b"\x89PNG"), ("jpg", b"\xff\xd8\xff"), ("webp", b"RIFF"))
            if start.startswith(mark)
        ),
        "",
    )
    return _checked(answer, who, "picture", PICTURE_BYTES, ending)


def _checked(answer: Answer, who: str, what: str, most: int, ending: str) -> str:
    if not answer.data:
        raise InputError(f"{who} answered nothing; a {what} was expected", _AGAIN)
    if len(answer.data) > most:
        raise InputError(f"{who} answered {len(answer.data):,} bytes; at most {most:,} are taken", _AGAIN)
    if not ending:
        raise InputError(f"{who} answered {_seen(answer.data)}; a {what} was expected", _AGAIN)
    with tempfile.TemporaryDirectory(prefix="fabcraft-answer-") as folder:
        path = Path(folder) / f"answer.{ending}"
        path.write_bytes(answer.data)
        try:
            _ = read_mesh(path, largest_mm=math.inf) if what == "mesh" else read_image(path)
        except InputError as error:
            why = error.message.replace(f"{folder}/", "")
            raise InputError(f"{who} answered a {what} that cannot be used: {why}", _AGAIN) from None
    return ending


def _mesh_ending(answer: Answer) -> str:
    """By its first bytes; OBJ, which has no mark, by the name that came with it."""
    data = answer.data
    head = data[:512].lstrip()
    for ending, mark in (("glb", b"glTF"), ("3mf", b"PK\x03\x04"), ("ply", b"ply"), ("gltf", b"{")):
        if head.startswith(mark):
            return ending
    if head[:6].lower() == b"solid " or (
        len(data) >= 84 and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little")
    ):
        return "stl"
    return "obj" if answer.name.lower().endswith(".obj") and not head.startswith(b"<") else ""


def _seen(data: bytes) -> str:
    head = data[:512].lstrip()
    if head[:1] == b"<":
        return "a web page"
    if head[:1] in (b"{", b"["):
        return "JSON"
    text = head[:40].decode("ascii", "replace")
    return f"{len(data):,} bytes that start with {text!r}"
