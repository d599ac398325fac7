"""The slicer is asked when it is there and forgiven when it is not."""

import os
import shutil
import stat

import numpy as np
import pytest
import trimesh

from fabcraft.check.slicer import ask_slicer, slicer_findings, slicer_ini
from fabcraft.mesh import Mesh
from fabcraft.profile import load_profile

MK4 = load_profile("prusa-mk4")
real = pytest.mark.skipif(shutil.which("prusa-slicer") is None, reason="prusa-slicer is not installed")


def box(*size: float) -> Mesh:
    shape = trimesh.creation.box(size)
    return Mesh(np.array(shape.vertices), np.array(shape.faces).astype(np.int32))


@pytest.fixture
def fake(tmp_path, monkeypatch):
    """Puts a shell script called prusa-slicer first on the path."""

    def _fake(script: str) -> None:
        program = tmp_path / "prusa-slicer"
        program.write_text("#!/bin/sh\n" + script)
        program.chmod(program.stat().st_mode | stat.S_IXUSR)
        monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")

    return _fake


def test_an_absent_slicer_is_a_note():
    answer = ask_slicer(box(10, 10, 10), MK4, program="no-such-slicer")
    assert not answer.available
    (finding,) = slicer_findings(answer, MK4)
    assert finding.severity == "note"


def test_a_slicer_that_does_not_answer_is_a_note(fake):
    fake("sleep 5\n")
    answer = ask_slicer(box(10, 10, 10), MK4, timeout_s=0.2)
    assert "no answer within 0.2 s" in answer.error
    assert [one.severity for one in slicer_findings(answer, MK4)] == ["note"]


def test_a_slicer_that_refuses_is_a_failure_in_its_own_words(fake):
    fake(
        'if [ "$1" = --info ]; then echo "manifold = yes"; exit 0; fi\n'
        'echo "Objects could not fit on the bed" >&2; exit 134\n'
    )
    answer = ask_slicer(box(10, 10, 10), MK4, slice_it=True)
    assert answer.sliced is False
    assert answer.error == "Objects could not fit on the bed"
    assert slicer_findings(answer, MK4)[0].severity == "fail"


def test_the_answer_is_read_from_the_gcode(fake):
    fake(
        'if [ "$1" = --info ]; then echo "[trace] x"; echo "volume = 12.5"; exit 0; fi\n'
        'while [ "$1" != --output ]; do shift; done\n'
        'echo "print warning: empty layer detected"\n'
        'echo "; filament used [cm3] = 7.43" > "$2"\n'
        'echo "; estimated printing time (normal mode) = 1d 2h 3m 4s" >> "$2"\n'
    )
    answer = ask_slicer(box(10, 10, 10), MK4, slice_it=True)
    assert answer.info == {"volume": "12.5"}
    assert answer.filament_cm3 == 7.43
    assert answer.seconds == 86400 + 2 * 3600 + 3 * 60 + 4
    assert answer.warnings == ("print warning: empty layer detected",)
    assert [one.severity for one in slicer_findings(answer, MK4)] == ["warn", "note"]


def test_the_ini_carries_the_profile():
    lines = dict(line.split(" = ") for line in slicer_ini(MK4).splitlines())
    assert lines["bed_shape"] == "0x0,250x0,250x210,0x210"
    assert lines["max_print_height"] == "220"
    assert lines["nozzle_diameter"] == "0.4"
    assert lines["extrusion_width"] == "0.45"
    assert lines["perimeters"] == "3"
    assert lines["support_material_threshold"] == "45"
    assert (
        dict(line.split(" = ") for line in slicer_ini(MK4, supports=False).splitlines())["support_material"]
        == "0"
    )


@real
def test_the_real_slicer_agrees_on_a_cube():
    answer = ask_slicer(box(10, 10, 10), MK4, slice_it=True)
    assert answer.info["manifold"] == "yes"
    assert float(answer.info["volume"]) == pytest.approx(1000, rel=1e-4)
    assert answer.sliced
    assert answer.filament_cm3 is not None and 0.3 < answer.filament_cm3 < 1.3
    assert answer.seconds is not None and answer.seconds > 60


@real
def test_the_real_slicer_refuses_what_does_not_fit():
    answer = ask_slicer(box(400, 10, 10), MK4, slice_it=True)
    assert answer.sliced is False
    assert "fit on the bed" in answer.error
