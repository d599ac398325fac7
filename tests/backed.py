"""What tests of back ends share: a mesh and a picture as bytes, an empty cache, and short waits."""

import io
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image, ImageDraw

from fabcraft.backends import web

KEY = "tsk_0123456789secret"


def glb() -> bytes:
    return trimesh.creation.icosphere(2).export(file_type="glb")


def png(side: int = 96) -> bytes:
    image = Image.fromarray(np.full((side, side, 3), 255, np.uint8))
    ImageDraw.Draw(image).ellipse((12, 12, side - 12, side - 12), outline="black", width=4)
    out = io.BytesIO()
    image.save(out, "PNG")
    return out.getvalue()


@pytest.fixture
def alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of its own, no keys, no proxies, and waits that a test can afford; the cache's folder."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("platformdirs.user_cache_dir", lambda *_a, **_k: str(tmp_path / "cache" / "fabcraft"))
    for name in ("TRIPO_API_KEY", "TRIPO_BASE_URL", "OPENAI_API_KEY", "OPENAI_BASE_URL", "HF_TOKEN"):
        monkeypatch.delenv(name, raising=False)
    for name in ("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(web, "FIRST_WAIT_S", 0.01)
    monkeypatch.setattr(web, "LONGEST_WAIT_S", 0.2)
    monkeypatch.setattr("fabcraft.backends.tripo._POLL_S", (0.01, 0.02))
    return tmp_path / "cache" / "fabcraft" / "backends"
