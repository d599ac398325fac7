"""The slicer is asked when it is there, forgiven when it is not, and believed within limits."""

import json
import os
import shutil
import stat
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from fabcraft.check.report import PrintReport
from fabcraft.check.slicer import ask_slicer, slicer_findings, with_slicing
from fabcraft.check.slicer_settings import slicer_ini
from fabcraft.cli import main
from fabcraft.errors import InputError
from fabcraft.mesh import Mesh
from fabcraft.profile import load_profile

MK4, SL1S, FORM4 = load_profile("prusa-mk4"), load_profile("prusa-sl1s"), load_profile("form4")
real = pytest.mark.skipif(shutil.which("prusa-slicer") is None, reason="prusa-slicer is not installed")


def mesh_of(shape) -> Mesh:
    return Mesh(np.array(shape.vertices, dtype=np.float64), np.array(shape.faces).astype(np.int32))


def box(*size: float) -> Mesh:
    return mesh_of(trimesh.creation.box(size))


def ring() -> Mesh:
    return mesh_of(trimesh.creation.annulus(9, 11, 4, sections=64))


def ball() -> Mesh:
    return mesh_of(trimesh.creation.icosphere(subdivisions=3, radius=5))


@pytest.fixture
def fake(tmp_path, monkeypatch):
    """Puts a shell script called prusa-slicer first on the path."""

    def _fake(script: str) -> None:
        program = tmp_path / "prusa-slicer"
        program.write_text("#!/bin/sh\n" + script)
        program.chmod(program.stat().st_mode | stat.S_IXUSR)
        monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")

    return _fake


def settings(*arguments, **named) -> dict[str, str]:
    return dict(line.split(" = ") for line in slicer_ini(*arguments, **named).splitlines())


def test_an_absent_slicer_is_a_note():
    answer = ask_slicer(box(10, 10, 10), MK4, program="no-such-slicer")
    assert not answer.available
    (finding,) = slicer_findings(answer, MK4)
    assert finding.severity == "note" and "no-such-slicer is not installed" in finding.advice


def test_powder_is_not_sliced():
    (finding,) = slicer_findings(ask_slicer(box(10, 10, 10), load_profile("sls-pa12")), MK4)
    assert finding.severity == "note"


def test_a_slicer_that_does_not_answer_is_a_check_that_could_not_run(fake, tmp_path):
    fake(f"(sleep 30; touch {tmp_path}/late) &\nsleep 30\n")
    start = time.perf_counter()
    answer = ask_slicer(box(10, 10, 10), MK4, timeout_s=0.3)
    assert time.perf_counter() - start < 5  # its children are ended with it
    assert "no answer within 0.3 s" in answer.error
    (finding,) = slicer_findings(answer, MK4)
    assert finding.severity == "fail" and not finding.ran
    assert "Not known to be printable" in PrintReport(findings=(finding,)).verdict


def test_a_slicer_that_refuses_is_a_failure_in_its_own_words(fake):
    fake('echo "  what():  Objects could not fit on the bed" >&2; exit 134\n')
    answer = ask_slicer(box(10, 10, 10), MK4)
    assert answer.sliced is False
    assert answer.error == "Objects could not fit on the bed"
    (finding,) = slicer_findings(answer, MK4)
    assert finding.severity == "fail" and finding.ran


def test_a_slicer_that_makes_nothing_refuses(fake):
    fake("exit 0\n")
    assert ask_slicer(box(10, 10, 10), MK4).error == "it made no file"


@pytest.mark.parametrize(("name", "content"), [("MK4", ""), ("SL1S", "no zip")])
def test_an_unreadable_product_is_no_answer_or_a_refusal(fake, name, content):
    fake(f'while [ "$1" != --output ]; do shift; done; printf "{content}" > "$2"\n')
    answer = ask_slicer(box(10, 10, 10), {"MK4": MK4, "SL1S": SL1S}[name])
    assert slicer_findings(answer, MK4)[0].severity == "fail"


GCODE = """M82
G92 E0
;LAYER_CHANGE
;Z:0.2
;TYPE:External perimeter
G1 X1 Y1 E1.0 F1200
G1 E-1 F2100
G1 X5 Y5
G1 E1.0
;TYPE:Support material
G1 X9 E1.5 ; a comment with E9
G92 E0
;LAYER_CHANGE
;Z:0.8
G1 X1 Y1 E2
; filament used [cm3] = 7.43
; estimated printing time (normal mode) = 1d 2h 3m 4s
; filament_diameter = 1.75
"""


def test_the_answer_is_read_from_the_gcode(fake, tmp_path):
    (tmp_path / "told").write_text(GCODE)
    fake(
        f'while [ "$1" != --output ]; do shift; done; cp {tmp_path}/told "$2"\n'
        'echo "[2026-11-28 14:27:31.5] [0x00007f] [trace]   Initializing"; echo " 10% => Slicing"\n'
        'echo "print warning: Empty layer between 0.2 and 0.8."\n'
    )
    answer = ask_slicer(box(10, 10, 10), MK4)
    area = np.pi / 4 * 1.75**2
    assert answer.seconds == 86400 + 2 * 3600 + 3 * 60 + 4
    assert answer.material_mm3 == pytest.approx(7430)
    assert answer.material_g == pytest.approx(7.43 * 1.24)
    assert answer.laid_mm3 == pytest.approx(
        (1.0 + 0.5 + 2.0) * area
    )  # retracting and priming count for nothing
    assert answer.support_mm3 == pytest.approx((0.5 + 2.0) * area)
    assert answer.layers == 2
    assert answer.empty_layers_mm == (0.8,)
    assert answer.warnings == ("Empty layer between 0.2 and 0.8.",)
    assert [one.severity for one in slicer_findings(answer, MK4)] == ["fail", "warn", "note"]


def test_the_settings_carry_the_filament_printer():
    told = settings(MK4)
    assert told["bed_shape"] == "0x0,250x0,250x210,0x210"
    assert told["max_print_height"] == "220"
    assert told["nozzle_diameter"] == "0.4"
    assert told["extrusion_width"] == "0.45"
    assert told["perimeters"] == "3"
    assert told["support_material_threshold"] == "45"
    assert told["filament_density"] == "1.24"
    assert settings(MK4, supports=False)["support_material"] == "0"
    assert settings(replace(MK4, line_width_mm=0.6))["extrusion_width"] == "0.6"


def test_the_settings_carry_the_resin_printer():
    told = settings(SL1S)
    assert told["printer_technology"] == "SLA"
    assert (told["display_width"], told["display_height"]) == ("128", "81")
    assert (told["layer_height"], told["exposure_time"]) == ("0.05", "2")
    assert "exposure_time" not in settings(FORM4)


@real
@pytest.mark.parametrize("shape", [ring, ball])
def test_at_full_infill_the_filament_is_the_volume_within_five_percent(shape):
    mesh = shape()
    answer = ask_slicer(mesh, MK4, supports=False, infill_percent=100)
    assert answer.sliced and answer.empty_layers_mm == () and answer.warnings == ()
    assert answer.laid_mm3 == pytest.approx(mesh.volume_mm3, rel=0.05)
    assert answer.layers == round(mesh.size_mm[2] / 0.2)


@real
def test_resin_without_supports_is_the_volume_within_five_percent_and_no_layer_is_empty():
    mesh = ring()
    answer = ask_slicer(mesh, SL1S, supports=False)
    assert answer.sliced and answer.empty_layers_mm == ()
    assert answer.material_mm3 == pytest.approx(mesh.volume_mm3, rel=0.05)
    assert answer.seconds is not None and answer.seconds > 80 * 2
    assert answer.layers == 80


@real
def test_what_hangs_is_supported_and_the_support_is_measured():
    assert (ask_slicer(ball(), MK4).support_mm3 or 0) > 20
    assert ask_slicer(ring(), MK4).support_mm3 == 0


@real
def test_a_part_that_begins_in_the_air_has_empty_layers():
    lower, upper = trimesh.creation.box((8, 8, 2)), trimesh.creation.box((8, 8, 2))
    upper.apply_translation((0, 0, 6))
    answer = ask_slicer(mesh_of(trimesh.util.concatenate([lower, upper])), MK4, supports=False)
    assert answer.empty_layers_mm == pytest.approx((6.2,))
    assert "empty_layers" in [one.check for one in slicer_findings(answer, MK4)]


@real
def test_what_does_not_fit_is_refused_and_what_fits_when_turned_is_turned():
    assert "fit on the bed" in ask_slicer(box(400, 10, 4), MK4).error
    assert ask_slicer(box(280, 4, 1), MK4).sliced  # across the bed


@real
def test_nothing_is_left_of_the_work(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    kept = tmp_path / "out" / "kept.gcode"
    report = with_slicing(PrintReport(), ring(), MK4, kept)
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert "G28" in kept.read_text()
    assert report.files == (str(kept),)
    assert {"slicer_print_seconds", "slicer_material_mm3", "slicer_material_g", "slicer_support_mm3"} <= set(
        report.metrics
    )
    with pytest.raises(InputError, match="cannot write"):
        ask_slicer(ring(), MK4, keep=tmp_path / "no" / "such" / "folder.gcode")


def other(tmp_path: Path, script: str, *arguments: str):
    """A profile whose slicer is a Python script."""
    (tmp_path / "slice.py").write_text(script)
    return replace(MK4, slicer_command=(sys.executable, str(tmp_path / "slice.py"), *arguments))


def test_another_slicer_runs_by_its_command_without_a_shell(tmp_path):
    script = (
        "import sys, pathlib\n"
        "assert sys.argv[1] == '$(touch x); --size=80', sys.argv\n"
        "assert pathlib.Path(sys.argv[2]).stat().st_size == 84 + 12 * 50\n"
        "pathlib.Path(sys.argv[3], 'plate_1.gcode').write_text(';TIME:600\\nM83\\n;TYPE:SUPPORT\\nG1 X1 E10\\n')\n"
    )
    answer = ask_slicer(box(5, 5, 5), other(tmp_path, script, "$(touch x); --size=80", "{input}", "{folder}"))
    assert answer.error == "" and answer.seconds == 600
    assert answer.material_mm3 == answer.support_mm3 == pytest.approx(10 * np.pi / 4 * 1.75**2)


def test_gcode_inside_a_3mf_is_found(tmp_path):
    script = (
        "import sys, zipfile\n"
        "with zipfile.ZipFile(sys.argv[1] + '/all.gcode.3mf', 'w') as entries:\n"
        "    text = '; model printing time: 4m 1s; total estimated time: 5m 2s\\nM83\\nG1 X1 E5\\n'\n"
        "    entries.writestr('Metadata/plate_1.gcode', text)\n"
    )
    assert ask_slicer(box(5, 5, 5), other(tmp_path, script, "{folder}", "{input}")).seconds == 302


def test_another_slicer_that_is_absent_is_a_note_and_one_that_fails_a_failure(tmp_path):
    absent = replace(MK4, slicer_command=("no-such-slicer", "{input}"))
    assert slicer_findings(ask_slicer(box(5, 5, 5), absent), absent)[0].severity == "note"
    answer = ask_slicer(box(5, 5, 5), other(tmp_path, "raise SystemExit('bad mesh')", "{input}"))
    assert answer.sliced is False and answer.error == "bad mesh"


def test_a_product_without_figures_is_sliced_and_says_so(tmp_path):
    script = "import sys, pathlib\npathlib.Path(sys.argv[1]).write_bytes(bytes(range(256)) * 40)\n"
    profile = other(tmp_path, script, "{output}", "{input}")
    answer = ask_slicer(box(5, 5, 5), profile)
    assert answer.sliced and answer.material_mm3 is None and answer.support_mm3 is None
    (finding,) = slicer_findings(answer, profile)
    assert finding.severity == "note" and "tells no time or material" in finding.advice


@real
def test_the_command_tells_it_and_keeps_the_gcode(tmp_path, capsys, monkeypatch):
    made = SimpleNamespace(
        mesh=box(8, 8, 3), notes=()
    )  # making it solid is tested elsewhere, and takes its time
    monkeypatch.setattr("fabcraft.solid.thicken.solidify", lambda *_: made)
    trimesh.creation.box((8, 8, 3)).export(tmp_path / "ring.stl")
    kept = tmp_path / "ring.gcode"
    words = [
        "solid",
        str(tmp_path / "ring.stl"),
        "-o",
        str(tmp_path / "out.stl"),
        "--printer",
        "prusa-mk4",
        "--json",
    ]
    assert main([*words, "--slice", "--gcode", str(kept)]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["metrics"]["slicer_print_seconds"] > 60
    assert told["files"] == [str(tmp_path / "out.stl"), str(kept)] and kept.is_file()


@pytest.mark.parametrize(
    "words",
    [
        ["check", "a.stl", "--printer", "prusa-mk4", "--gcode", "x.gcode"],
        ["check", "a.stl", "--printer", "form4", "--slice", "--gcode", "x.gcode"],
        ["check", "a.stl", "--printer", "prusa-mk4", "--slice", "--gcode", "no/such/x.gcode"],
        ["check", "a.stl", "--printer", "prusa-mk4", "--slice", "--gcode", "a.stl"],
        ["solid", "a.stl", "--wall", "1", "-o", "b.stl", "--slice"],
        ["make", "ring", "-o", "b.stl", "--gcode", "x.gcode"],
    ],
)
def test_what_cannot_be_sliced_is_said_before_the_work(tmp_path, monkeypatch, capsys, words):
    monkeypatch.chdir(tmp_path)
    trimesh.creation.box((9, 9, 9)).export("a.stl")
    before = Path("a.stl").read_bytes()
    assert main(words) == 2
    told = capsys.readouterr()
    assert told.out == "" and "defect" not in told.err
    assert Path("a.stl").read_bytes() == before and not Path("b.stl").exists()
