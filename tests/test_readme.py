"""Every command that the README shows is run as it stands there."""

import itertools
import json
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from fabcraft.cli import main
from fabcraft.write.threemf import read_report

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text("utf-8")
BLOCKS = re.findall(r"```sh\n(.*?)```", TEXT, re.DOTALL)
PYTHON = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
COMMANDS = [line for line in BLOCKS[2].splitlines() if line.strip()]


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with the examples, where the commands run one after another and find each other's files."""
    folder = tmp_path_factory.mktemp("readme")
    shutil.copytree(ROOT / "examples", folder / "examples", ignore=shutil.ignore_patterns("pictures"))
    return folder


def test_the_first_line_installs_and_makes_the_example():
    line = BLOCKS[0].strip()
    assert "\n" not in line and line.startswith("python3 -m venv .venv && .venv/bin/pip install")
    assert line.endswith("fabcraft make examples/cat-mask.toml")
    assert (ROOT / "examples" / "cat-mask.toml").is_file()


def test_the_second_line_installs_and_runs_the_tests():
    line = BLOCKS[1].strip()
    assert "\n" not in line and "'.[dev]'" in line and line.endswith("-m pytest")


@pytest.mark.parametrize("line", COMMANDS)
def test_a_command_of_the_readme_runs(line, place, monkeypatch, capsys):
    monkeypatch.chdir(place)
    words = shlex.split(line)
    assert words[0] == "fabcraft"
    assert main(words[1:]) == 0, capsys.readouterr().err
    for flag in ("-o", "--show-input", "--picture"):
        for word, following in itertools.pairwise(words):
            if word == flag:
                assert (place / following).stat().st_size > 1000
                if words[1] == "make" and following.endswith(".3mf"):
                    assert_as_asked(json.loads(read_report(place / following) or ""), "--text" in words)


def assert_as_asked(report, by_words):
    """A printable object in the shape that was asked for, outside of the body."""
    assert report["printable"] is True
    assert report["metrics"]["silhouette_iou"] > 0.85
    assert report["metrics"]["pen_max_mm"] == 0.0
    assert any("of the library" in line for line in report["route"]) == by_words


RECIPE = f"""template = "ring"
sketch = "{ROOT}/examples/objects/star.png"
body = "woman"
printer = "form4"
preset = "draft"
pictures = false
output = ["out/ring.3mf", "out/ring.stl"]
[measures]
ring_finger = "US7"
"""
"""What the first command says, as a recipe file."""


def test_a_recipe_file_in_another_process_gives_the_same_bytes(place, tmp_path):
    (tmp_path / "ring.toml").write_text(RECIPE)
    command = [sys.executable, "-m", "fabcraft", "make", "ring.toml"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "printable" in done.stdout.splitlines()[0]
    written = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    assert written == {name: (place / name).read_bytes() for name in ("ring.3mf", "ring.stl")}


def test_the_python_of_the_readme_runs(place, monkeypatch, capsys):
    monkeypatch.chdir(place)
    exec(compile(PYTHON[0], "README.md", "exec"), {})
    assert "Printable" in capsys.readouterr().out
    assert (place / "star.3mf").stat().st_size > 1000


def test_every_picture_of_the_readme_is_there():
    pictures = re.findall(r"!\[.*?\]\((.*?)\)", TEXT)
    assert len(pictures) >= 3 and all((ROOT / picture).is_file() for picture in pictures)


@pytest.mark.parametrize("script", sorted((ROOT / "examples").glob("*.py")), ids=lambda path: path.stem)
def test_a_script_of_the_examples_finds_what_it_imports(script, monkeypatch):
    monkeypatch.syspath_prepend(str(script.parent))
    runpy.run_path(str(script), run_name="imported")
