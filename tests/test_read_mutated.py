"""Pictures and meshes whose bytes were changed by chance: refused or read, never anything else."""

import contextlib
import io
import time
import tracemalloc

import numpy as np
import pytest
from drawn import eyes, head, page
from mutated import bombs, meshes, mutated, mutated_zip
from PIL import Image

from fabcraft.errors import InputError
from fabcraft.read.image_file import read_image
from fabcraft.read.mesh_file import read_mesh

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


@pytest.mark.parametrize("name", sorted(meshes()))
def test_a_mesh_with_changed_bytes_is_read_or_refused(tmp_path, capfd, name):
    rng, data, path, refused = np.random.default_rng(3), meshes()[name], tmp_path / name, 0
    for index in range(40):
        path.write_bytes(mutated_zip(data, rng) if name == "a.3mf" and index % 2 else mutated(data, rng))
        try:
            assert np.isfinite(read_mesh(path).vertices).all()
        except InputError as error:
            assert error.next_step
            refused += 1
    assert refused
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.parametrize(("name", "data"), sorted(bombs().items()))
def test_a_small_file_that_announces_gigabytes_is_read_or_refused_at_once(tmp_path, name, data):
    path = tmp_path / name
    path.write_bytes(data)
    tracemalloc.start()
    try:
        with contextlib.suppress(InputError):
            read_mesh(path)
        assert tracemalloc.get_traced_memory()[1] < 300e6
    finally:
        tracemalloc.stop()
