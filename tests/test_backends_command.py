"""A program on this machine: no shell, a time limit, its output bounded, its children gone with it."""

import os
import shlex
import sys
import time
from pathlib import Path

import pytest
from backed import alone, glb, png  # noqa: F401

from fabcraft.backends.backend import Request
from fabcraft.backends.command import MeshCommand, PictureCommand
from fabcraft.errors import InputError, MissingError
from fabcraft.program import filled, run_program


def python(code: str, *places: str) -> str:
    return shlex.join([sys.executable, "-c", code]) + " " + " ".join(places)


def made(code: str, timeout_s: float = 10.0) -> bytes:
    command = MeshCommand(python(code, "{input}", "{output}"))
    return command.make(Request(png(), seed=5, timeout_s=timeout_s), lambda done, of: None).data


def test_it_reads_the_picture_and_writes_the_mesh():
    code = "import sys, pathlib as p; p.Path(sys.argv[2]).write_bytes(b'glTF' + p.Path(sys.argv[1]).read_bytes())"
    assert made(code) == b"glTF" + png()


def test_another_ending_beside_the_output_is_found():
    code = "import sys, pathlib as p; p.Path(sys.argv[2]).with_suffix('.obj').write_text('v 0 0 0')"
    assert made(code) == b"v 0 0 0"


def test_words_go_in_as_one_argument_and_no_shell_reads_them(tmp_path):
    code = "import sys, pathlib as p; p.Path(sys.argv[2]).write_text(repr(sys.argv[1:]))"
    prompt = f"a cat; touch {tmp_path / 'x'} $(touch {tmp_path / 'y'}) {{output}}"
    command = PictureCommand(python(code, "{prompt}", "{output}", "{seed}"))
    told = command.make(Request(prompt=prompt, seed=5, timeout_s=10.0), lambda done, of: None).data.decode()
    assert repr(prompt) in told and "'5'" in told
    assert not list(tmp_path.iterdir())


def test_what_is_filled_in_is_not_filled_again():
    assert filled("a{x}b{y}", {"{x}": "{y}", "{y}": "1"}) == "a{y}b1"


def test_a_program_that_fails_is_told_with_its_last_words():
    with pytest.raises(MissingError, match="code 3: no weights"):
        made("print('loading'); print('no weights'); raise SystemExit(3)")


def test_a_program_that_writes_nothing_is_told():
    with pytest.raises(InputError, match=r"wrote no output\.glb"):
        made("pass")


def test_a_link_is_no_answer(tmp_path):
    (tmp_path / "secret").write_text("x")
    with pytest.raises(InputError, match="wrote no"):
        made(f"import os, sys; os.symlink({str(tmp_path / 'secret')!r}, sys.argv[2])")


def test_a_program_that_is_not_there_is_exit_3():
    with pytest.raises(MissingError, match="not found"):
        MeshCommand("no-such-program {input} {output}").make(Request(png()), lambda done, of: None)


def test_a_program_takes_its_children_with_it_when_its_time_is_over(tmp_path):
    told = tmp_path / "pid"
    child = (
        f"import os,time,pathlib; pathlib.Path({str(told)!r}).write_text(str(os.getpid())); time.sleep(60)"
    )
    code = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {child!r}])"
    start = time.monotonic()
    with pytest.raises(MissingError, match="not done within 1 s"):
        made(code, 1.0)
    assert time.monotonic() - start < 5
    pid = int(told.read_text())
    for _ in range(50):
        state = Path(f"/proc/{pid}/stat")
        if not state.exists() or state.read_text().split()[2] == "Z":
            break
        time.sleep(0.05)
    else:
        os.kill(pid, 9)
        pytest.fail("the child lives on")


def test_a_program_that_writes_too_much_is_stopped(monkeypatch):
    monkeypatch.setattr(MeshCommand, "most_bytes", 1000)
    code = "import sys, time; open(sys.argv[2], 'wb').write(b'x' * 5000); time.sleep(30)"
    start = time.monotonic()
    with pytest.raises(InputError, match="wrote 5,000 bytes"):
        made(code)
    assert time.monotonic() - start < 5


def test_of_what_a_program_prints_only_the_end_is_kept():
    code, heard = run_program(
        [
            sys.executable,
            "-c",
            "for _ in range(200): print('x' * 50_000, end='')\nprint('end')",
        ],
        20.0,
        heard_bytes=100,
    )
    assert code == 0 and len(heard) == 100 and heard.endswith("xend\n")


@pytest.mark.parametrize(
    "argument", ["", "run", "run {input}", "run 'x {input} {output}", "{input} {output}"]
)
def test_a_command_that_cannot_work_is_told_before(argument):
    with pytest.raises(InputError, match="command"):
        MeshCommand(argument)


def test_a_command_out_of_a_recipe_needs_a_yes():
    terms = MeshCommand("rm -rf {input} {output}").terms(Request())
    assert terms.ask == "unless typed" and "rm -rf" in terms.said[0]
