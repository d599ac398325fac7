"""All checks together, as the command line and the pipeline ask for them."""

import json
import subprocess
import sys

import numpy as np
import pytest
import trimesh

from fabcraft.check import topology as topology_module
from fabcraft.check.inspect import Worn, check_mesh, inspect_mesh
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh
from fabcraft.profile import load_profile

MK4 = load_profile("prusa-mk4")


def mesh_of(shape) -> Mesh:
    return Mesh(np.array(shape.vertices), np.array(shape.faces).astype(np.int32))


def box(*size: float) -> Mesh:
    return mesh_of(trimesh.creation.box(size))


def test_a_sound_box_is_printable_and_fully_measured():
    report = check_mesh(box(20, 20, 20), MK4, route=("mesh",), files=("a.3mf",))
    assert report.printable
    assert report.verdict == "Printable."
    assert report.metrics["volume_mm3"] == pytest.approx(8000)
    assert report.metrics["size_mm"] == (20, 20, 20)
    assert report.metrics["genus"] == 0
    assert report.metrics["self_intersections"] == 0
    assert report.metrics["wall_ok_share"] == 1.0
    assert set(report.seconds) == {"topology", "printability", "wall", "gap"}
    assert report.peak_memory_bytes is not None and report.peak_memory_bytes > 1e6
    assert "pen_max_mm" not in report.metrics
    assert json.loads(report.to_json())["route"] == ["mesh"]


def test_a_thin_plate_fails_with_wall_limit_and_place():
    report = check_mesh(box(20, 20, 0.5), MK4)
    (finding,) = [one for one in report.findings if one.check == "wall"]
    assert finding.severity == "fail"
    assert finding.value == pytest.approx(0.5, rel=0.02)
    assert finding.limit == 0.9
    assert len(finding.where) == 1
    assert not report.printable


def test_a_wall_just_under_the_minimum_is_a_warning():
    report = check_mesh(box(20, 20, 0.87), MK4)
    assert [one.severity for one in report.findings if one.check == "wall"] == ["warn"]
    assert report.printable


def test_a_wall_exactly_at_the_minimum_passes():
    assert "wall" not in [one.check for one in check_mesh(box(20, 20, 0.9), MK4).findings]


def test_an_open_surface_fails_and_its_wall_is_not_invented():
    report = check_mesh(box(20, 20, 20).submesh(np.arange(1, 12)), MK4)
    assert {one.check for one in report.findings if one.severity == "fail"} == {"open_edges", "wall"}
    assert "wall_min_mm" not in report.metrics
    assert "volume_mm3" not in report.metrics
    assert "genus" not in report.metrics


def test_an_empty_mesh_fails_without_an_exception():
    report = check_mesh(Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32)), MK4)
    assert not report.printable
    json.loads(report.to_json())


def test_a_check_that_raises_becomes_a_failure(monkeypatch):
    def _broken(_mesh):
        raise RuntimeError("the library fell over")

    monkeypatch.setattr(topology_module, "inspect_topology", _broken)
    report = check_mesh(box(20, 20, 20), MK4)
    assert not report.printable
    assert report.findings[0].check == "topology"
    assert "the library fell over" in report.findings[0].advice


@pytest.mark.parametrize(
    ("place", "check"),
    [
        ("topology.inspect_topology", "topology"),
        ("printability.inspect_printability", "printability"),
        ("thickness.measure_thickness", "wall"),
    ],
)
def test_no_check_that_breaks_leaves_a_sound_box_printable(monkeypatch, place, check):
    def broken(*_arguments: object) -> None:
        raise MemoryError("no room")

    monkeypatch.setattr(f"fabcraft.check.{place}", broken)
    report = check_mesh(box(20, 20, 20), MK4)
    assert not report.printable
    assert check in [finding.check for finding in report.findings if not finding.ran]


def test_a_large_part_is_held_to_the_walls_of_its_size():
    plate = box(120, 100, 1.5)
    assert "wall" in [one.check for one in check_mesh(plate, load_profile("resin-service")).findings]
    assert "wall" not in [one.check for one in check_mesh(plate, load_profile("form4")).findings]


def test_a_worn_object_is_checked_on_its_body():
    body = SurfaceDistance(box(100, 100, 100))
    pad = box(20, 20, 20)
    seated = pad.with_vertices(pad.vertices + np.array([0.0, -61, 0]))
    worn = Worn(
        body,
        clearance_mm=1.0,
        contacts=np.array([[0.0, -50, 0]]),
        gaps_mm=1.0,
        donning=(0.0, -1.0, 0.0),
        eyes=np.array([[0.0, -40, 0]]),
    )
    report = check_mesh(seated, MK4, worn=worn)
    assert report.metrics["donnable"] is True
    assert report.metrics["clearance_min_mm"] == pytest.approx(1.0)
    assert report.metrics["contact_rms_mm"] == pytest.approx(0.0, abs=1e-9)
    assert report.metrics["sight_open_share"] == 0.0
    assert [one.check for one in report.findings if one.severity == "fail"] == ["sight"]
    pressed = check_mesh(pad.with_vertices(pad.vertices + np.array([0.0, -59, 0])), MK4, worn=Worn(body))
    assert [one.check for one in pressed.findings if one.severity == "fail"] == ["penetration"]


def test_the_maps_behind_the_report_are_kept():
    found = inspect_mesh(box(20, 20, 0.5), MK4)
    assert found.topology is not None and not found.topology.problem_faces.any()
    assert found.thickness is not None
    assert found.thickness.face_values(box(20, 20, 0.5)).shape == (12,)


def test_the_same_mesh_gives_the_same_report_but_for_time_and_memory():
    shape = mesh_of(trimesh.creation.torus(20, 3, major_sections=48, minor_sections=24))
    one, other = (check_mesh(shape, MK4).to_dict() for _ in range(2))
    for report in (one, other):
        del report["seconds"], report["peak_memory_bytes"]
    assert one == other


def test_checking_needs_no_torch():
    code = (
        "import sys, numpy as np\n"
        "from fabcraft.check.inspect import check_mesh\n"
        "from fabcraft.profile import load_profile\n"
        "from fabcraft.mesh import Mesh\n"
        "v = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9.0]])\n"
        "f = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], np.int32)\n"
        "check_mesh(Mesh(v, f), load_profile('prusa-mk4'))\n"
        "print(sorted({'torch', 'trimesh', 'open_clip'} & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
