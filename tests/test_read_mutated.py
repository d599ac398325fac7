"""Pictures whose bytes were changed by chance: refused or read, never anything else."""

import io
import time

import numpy as np
import pytest
from drawn import eyes, head, page
from PIL import Image

from fabcraft.errors import InputError
from fabcraft.read.image_file import read_image

SVG = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 90 60"><defs><g id="a"><circle r="9" cx="9" cy="9"/></g></defs>'
    '<style>.l{fill:none;stroke:#000}</style><use href="#a" x="4"/><path class="l" transform="rotate(3)" '
    'd="M5 5 C9 9 20 4 30 30 A5 6 0 1 0 44 44Z"/><polygon points="1,1 9,2 4,8" stroke-dasharray="2 1"/></svg>'
)


def originals() -> dict[str, bytes]:
    image = Image.fromarray(page([head(), *eyes()], size=900)).resize((120, 120))
    out = {"svg": SVG.encode()}
    for name in ("png", "jpeg", "webp"):
        buffer = io.BytesIO()
        image.convert("RGB").save(buffer, name)
        out[name] = buffer.getvalue()
    return out


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """A few bytes changed, sometimes a piece cut out, doubled or cut off."""
    out = bytearray(data)
    for _ in range(rng.integers(1, 9)):
        out[rng.integers(len(out))] = rng.integers(256)
    at, length = rng.integers(len(out)), rng.integers(1, 60)
    kind = rng.integers(5)
    if kind == 0:
        del out[at:]
    elif kind == 1:
        del out[at : at + length]
    elif kind == 2:
        out[at:at] = out[at : at + length]
    return bytes(out)


def outcomes(kind: str, count: int, path, seed: int = 0) -> tuple[int, float]:
    """How many of `count` were read, and the longest time; anything but a picture or an `InputError` escapes."""
    rng, data, read, longest = np.random.default_rng(seed), originals()[kind], 0, 0.0
    for _ in range(count):
        path.write_bytes(mutated(data, rng))
        start = time.perf_counter()
        try:
            rgba = read_image(path)
            assert rgba.ndim == 3
            assert max(rgba.shape) <= 1600
            read += 1
        except InputError as error:
            assert error.next_step
        longest = max(longest, time.perf_counter() - start)
    return read, longest


@pytest.mark.parametrize("kind", ["png", "jpeg", "webp", "svg"])
def test_a_picture_with_changed_bytes_is_read_or_refused(tmp_path, kind):
    read, longest = outcomes(kind, 40, tmp_path / f"a.{kind}")
    assert read < 40
    assert longest < 10.0
