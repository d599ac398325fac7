"""`read_archive`: what a PrusaSlicer SL1 archive says: a zip of `config.ini` and one picture a layer.

`usedMaterial` is in millilitres, supports included; `printTime` in seconds, from the exposures asked for. A
layer is empty when its picture is black.
"""

import io
import math
import re
import zipfile
from dataclasses import dataclass
from pathlib import Path

_MOST_PICTURE_BYTES = 20_000_000


@dataclass(frozen=True)
class Archive:
    """The figures of an SL1 archive."""

    seconds: float
    material_mm3: float
    layers: int
    empty_layers_mm: tuple[float, ...]
    """Tops of the layers whose picture is black."""


def read_archive(path: Path, layer_mm: float) -> Archive:
    """Read an SL1 file.  Raises `OSError`, `zipfile.BadZipFile`, `KeyError` or `ValueError` for another one."""
    from PIL import Image

    with zipfile.ZipFile(path) as entries:
        text = entries.read("config.ini").decode("utf-8", errors="replace")
        told = dict(re.findall(r"^(\w+) = (.*)$", text, re.MULTILINE))
        pictures = sorted(
            name for name in entries.namelist() if re.search(r"\d+\.png$", name) and "/" not in name
        )
        empty = []
        for index, name in enumerate(pictures):
            if entries.getinfo(name).file_size > _MOST_PICTURE_BYTES:
                raise ValueError(f"the picture {name} is too large")
            with Image.open(io.BytesIO(entries.read(name))) as picture:
                if picture.getbbox() is None:
                    empty.append(round((index + 1) * layer_mm, 6))
    seconds, millilitres = float(told["printTime"]), float(told["usedMaterial"])
    if not (math.isfinite(seconds) and math.isfinite(millilitres)):
        raise ValueError("time or material is not a finite number")
    return Archive(seconds, 1000 * millilitres, len(pictures), tuple(empty))
