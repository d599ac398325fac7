"""Every command that the README shows is run as it stands there."""

import itertools
import re
import shlex
import shutil
from pathlib import Path

import pytest

from fabcraft.cli import main

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


def test_the_python_of_the_readme_runs(place, monkeypatch, capsys):
    monkeypatch.chdir(place)
    exec(compile(PYTHON[0], "README.md", "exec"), {})
    assert "Printable" in capsys.readouterr().out
    assert (place / "star.3mf").stat().st_size > 1000


def test_every_picture_of_the_readme_is_there():
    pictures = re.findall(r"!\[.*?\]\((.*?)\)", TEXT)
    assert len(pictures) >= 3 and all((ROOT / picture).is_file() for picture in pictures)
