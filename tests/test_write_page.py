"""The page: complete in itself, nothing a user wrote becomes markup, the 3D view gets the right numbers."""

import base64
import hashlib
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from fabcraft.check.report import Finding, PrintReport
from fabcraft.errors import InputError
from fabcraft.mesh import Mesh
from fabcraft.write.page import write_page
from fabcraft.write.picture import png_bytes
from fabcraft.write.viewer import scene_data

EVIL = (
    "</script><script>document.title='owned'</script><img src=x onerror=\"document.title='owned'\">'{{scene}}"
)


def ball(radius: float = 10.0, level: int = 3) -> Mesh:
    shape = trimesh.creation.icosphere(level, radius)
    return Mesh(np.array(shape.vertices), np.array(shape.faces, dtype=np.int32), "ball")


def report(text: str = "fine") -> dict:
    return {
        "printable": False,
        "verdict": text,
        "findings": [
            {
                "check": "overhang",
                "severity": "warn",
                "value": 3,
                "limit": None,
                "unit": "mm",
                "where": [1.0, 2.5],
            },
            {"check": text, "severity": text, "value": text, "limit": text, "unit": text, "where": text},
            {"check": "wall", "severity": "fail", "value": 0.41, "limit": 0.8, "unit": "mm", "advice": text},
        ],
        "metrics": {"wall_min_mm": 0.41, "wall_ok_share": 0.5, "size_mm": [1.0, 2.0, 3.0], text: text},
        "route": {"input": text},
        "seconds": {"fit": 1.5},
        "files": [text],
    }


class Tags(HTMLParser):
    """Every element with its attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list) -> None:
        self.found.append((tag, dict(attributes)))


def page(folder: Path, **changes: object) -> str:
    settings = {"report": report(), "object": ball(), "title": "A mask", "recipe": "a = 1"} | changes
    return write_page(folder / "page.html", **settings).read_text("utf-8")


def test_the_page_says_verdict_findings_metrics_and_recipe(tmp_path: Path) -> None:
    text = page(tmp_path)
    for words in (
        "A mask",
        "Not printable",
        "0.41 mm",
        "0.8 mm",
        "50 %",
        "1 × 2 × 3 mm",
        "1, 2.5",
        "a = 1",
        "1.5 s",
    ):
        assert words in text
    assert text.index(">wall<") < text.index(">overhang<")


def test_a_print_report_is_shown_with_its_places(tmp_path: Path) -> None:
    places = tuple((float(index), -2.0, 650.04) for index in range(5))
    made = PrintReport(
        findings=(
            Finding(
                check="wall", severity="fail", value=0.4, limit=0.8, unit="mm", where=places, advice="Do."
            ),
        ),
        route=("cat.png", "read as a drawing"),
        metrics={"parts": 1, "donnable": True, "volume_mm3": 48210.4},
        seconds={"fit": 8.25},
        peak_memory_bytes=812_345_678,
    )
    text = page(tmp_path, report=made.to_dict())
    for words in (
        "(0.0, -2.0, 650.0); (1.0, -2.0, 650.0); (2.0, -2.0, 650.0) and 2 more",
        "48,210 mm³",
        "812 MB",
    ):
        assert words in text
    for words in ("Not printable: wall.", "read as a drawing", "8.25 s", ">yes<"):
        assert words in text


def test_nothing_that_a_user_wrote_becomes_markup(tmp_path: Path) -> None:
    plain = page(tmp_path, report=report("x"), title="x", recipe="x", pictures={"x": b""})
    mesh = Mesh(ball().vertices, ball().faces, EVIL)
    evil = page(tmp_path, report=report(EVIL), object=mesh, title=EVIL, recipe=EVIL, pictures={EVIL: b""})

    def shape(text: str) -> list:
        return [(tag, sorted(attributes)) for tag, attributes in Tags(text).found]

    assert shape(evil) == shape(plain)
    assert evil.count("</script>") == plain.count("</script>") == 2


def test_the_page_needs_no_network(tmp_path: Path) -> None:
    text = page(tmp_path, body=ball(9.0), pictures={"front": png_bytes(np.zeros((4, 4, 3), np.uint8))})
    assert "//" not in re.sub(r"//.*", "", re.sub(r'"[A-Za-z0-9+/=]*"|base64,[A-Za-z0-9+/=]*', "", text))
    assert re.search(r"https?:|@import|url\(", text) is None
    for tag, attributes in Tags(text).found:
        assert tag not in ("link", "iframe", "object", "embed", "base")
        assert attributes.get("src", "data:").startswith("data:")
        assert not any(name.startswith("on") for name in attributes)


def test_only_the_pages_own_script_may_run(tmp_path: Path) -> None:
    text = page(tmp_path)
    policy = next(attributes["content"] for tag, attributes in Tags(text).found if "http-equiv" in attributes)
    script = re.search(r"<script>(.*?)</script>", text, re.DOTALL)[1]
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert "default-src 'none'" in policy
    assert f"script-src 'sha256-{digest}'" in policy


def test_equal_input_gives_an_equal_page(tmp_path: Path) -> None:
    assert page(tmp_path, body=ball(9.0)) == page(tmp_path, body=ball(9.0))


def test_positions_normals_and_values_survive_the_packing() -> None:
    mesh = ball()
    clearance = mesh.vertices[:, 2].copy()
    clearance[0] = np.nan
    scene = scene_data(mesh, None, np.full(len(mesh.vertices), 1.2), clearance, wall_mm=1.2)
    packed = scene["meshes"][0]

    def read(name: str, kind: str) -> np.ndarray:
        return np.frombuffer(base64.b64decode(name), kind)

    positions = (
        read(packed["positions"], "<u2").reshape(-1, 4)[:, :3] / 65535 * packed["span"] + packed["low"]
    )
    normals = read(packed["normals"], "i1").reshape(-1, 4)[:, :3] / 127
    faces = read(packed["faces"], "<u4").reshape(-1, 3)
    back = Mesh(positions, faces.astype(np.int32))
    assert len(faces) * 3 == packed["count"]
    assert back.volume_mm3 == pytest.approx(mesh.volume_mm3, rel=1e-3)
    assert np.allclose(normals, positions / 10.0, atol=0.02)
    assert (read(packed["values"]["wall"], "u1") == 127).all()
    fit = read(packed["values"]["fit"], "u1")
    assert (fit == 255).sum() == 1
    limit = 10.0
    known = fit != 255
    assert np.allclose(fit[known] / 254 * 2 * limit - limit, positions[known, 2], atol=0.05)


def test_both_sides_of_a_thin_wall_keep_their_own_values() -> None:
    outer, inner = ball(10.0, 6), ball(9.8, 6)
    shell = Mesh(
        np.concatenate([outer.vertices, inner.vertices]),
        np.concatenate([outer.faces, inner.faces[:, ::-1] + len(outer.vertices)]),
    )
    clearance = np.repeat([1.0, 0.0], len(outer.vertices))
    packed = scene_data(shell, None, None, clearance)["meshes"][0]
    positions = np.frombuffer(base64.b64decode(packed["positions"]), "<u2").reshape(-1, 4)[:, :3]
    radius = np.linalg.norm(positions / 65535 * packed["span"] + packed["low"], axis=1)
    values = np.frombuffer(base64.b64decode(packed["values"]["fit"]), "u1")
    assert packed["count"] <= 3 * 60_100
    assert ((values > 200) == (radius > 9.9)).mean() > 0.999


def test_a_large_mask_and_head_make_a_page_under_six_megabytes(tmp_path: Path) -> None:
    mask, head = ball(10.0, 6), ball(9.0, 5)
    values = np.ones(len(mask.vertices))
    page(tmp_path, object=mask, body=head, thickness=values, clearance=values)
    assert (tmp_path / "page.html").stat().st_size < 4_000_000


def test_arrays_of_another_length_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="thickness has 3 values"):
        page(tmp_path, thickness=np.ones(3))
    assert not (tmp_path / "page.html").exists()


def test_an_empty_report_makes_a_page_too(tmp_path: Path) -> None:
    text = page(tmp_path, report={}, recipe=None)
    assert "Not checked" in text
    assert "<table" not in text


@pytest.mark.skipif(shutil.which("chromium") is None, reason="needs chromium")
def test_a_browser_draws_the_object_and_runs_nothing_else(tmp_path: Path) -> None:
    page(tmp_path, report=report(EVIL), title="quiet " + EVIL, thickness=np.ones(len(ball().vertices)))
    flags = ["--headless", "--no-sandbox", "--disable-gpu"]
    flags += ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    command = ["chromium", *flags, f"--user-data-dir={tmp_path / 'profile'}", "--virtual-time-budget=3000"]
    address = (tmp_path / "page.html").as_uri()
    shot = tmp_path / "shot.png"
    screenshot = [*command, f"--screenshot={shot}", "--window-size=900,700", address]
    subprocess.run(screenshot, check=True, timeout=60, capture_output=True)
    image = np.asarray(Image.open(shot).convert("RGB")).astype(int)
    blue = (image[150:550, :, 2] - image[150:550, :, 0]) > 50
    assert blue.sum() > 10_000
    text = subprocess.run(
        [*command, "--dump-dom", address], check=True, timeout=60, capture_output=True, text=True
    )
    assert "<title>quiet " in text.stdout
    assert json.loads(re.search(r'id="scene">(.*?)</script>', text.stdout, re.DOTALL)[1])["meshes"]
