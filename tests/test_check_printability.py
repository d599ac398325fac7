"""Size, overhang, bed contact and islands of shapes where they are known."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from fabcraft.check.printability import inspect_printability, printability_findings
from fabcraft.mesh import Mesh, concatenate
from fabcraft.profile import load_profile

MK4 = load_profile("prusa-mk4")


def mesh_of(shape) -> Mesh:
    return Mesh(np.array(shape.vertices), np.array(shape.faces).astype(np.int32))


def box(*size: float) -> Mesh:
    return mesh_of(trimesh.creation.box(size))


def moved(mesh: Mesh, *by: float) -> Mesh:
    return mesh.with_vertices(mesh.vertices + np.array(by))


def findings(mesh: Mesh) -> dict[str, str]:
    return {one.check: one.severity for one in printability_findings(inspect_printability(mesh, MK4), MK4)}


def test_a_cube_fits_rests_and_hangs_nowhere():
    state = inspect_printability(box(10, 10, 10), MK4)
    assert state.size_mm == (10, 10, 10)
    assert state.volume_mm3 == pytest.approx(1000)
    assert state.bed_contact_mm2 == pytest.approx(100)
    assert state.overhang_mm2 == 0
    assert len(state.island_places) == 0
    assert findings(box(10, 10, 10)) == {}


def test_the_exact_build_volume_fits():
    assert inspect_printability(box(250, 210, 220), MK4).turn_deg == 0


def test_a_part_that_must_be_turned_about_z_is_noted():
    assert inspect_printability(box(10, 240, 10), MK4).turn_deg == 32
    diagonal = box(300, 5, 10)
    turn = inspect_printability(diagonal, MK4).turn_deg
    assert turn is not None and 25 < turn < 65
    assert findings(diagonal)["size"] == "note"


def test_a_part_that_is_too_tall_but_fits_lying_is_a_warning():
    assert findings(box(10, 10, 240))["size"] == "warn"


def test_a_part_that_is_too_large_fails_with_its_size():
    state = inspect_printability(box(400, 10, 10), MK4)
    assert not state.fits and not state.fits_lying
    finding = printability_findings(state, MK4)[0]
    assert (finding.check, finding.severity, finding.value) == ("size", "fail", (400, 10, 10))
    assert finding.limit == MK4.build_mm


def test_the_underside_of_a_table_hangs_over_and_its_legs_do_not():
    table = concatenate([moved(box(20, 20, 2), 0, 0, 11), moved(box(4, 4, 10), 0, 0, 5)])
    state = inspect_printability(table, MK4)
    assert state.overhang_mm2 == pytest.approx(400)
    assert state.bed_contact_mm2 == pytest.approx(16)
    assert findings(table)["overhang"] == "warn"


@pytest.mark.parametrize(("angle_deg", "hangs"), [(44.0, False), (46.0, True)])
def test_overhang_counts_from_the_vertical(angle_deg, hangs):
    lean = 20 * np.tan(np.radians(angle_deg))
    slanted = box(10, 10, 20)
    shear = np.eye(4)
    shear[0, 2] = lean / 20
    state = inspect_printability(slanted.transformed(shear), MK4)
    assert (state.overhang_mm2 > 0) == hangs


def test_what_begins_in_the_air_is_an_island_at_its_lowest_place():
    column = box(10, 10, 40)
    ball = moved(mesh_of(trimesh.creation.icosphere(2, 3)), 30, 0, 0)
    state = inspect_printability(concatenate([column, ball]), MK4)
    assert len(state.island_places) == 1
    assert state.island_places[0] == pytest.approx([30, 0, -3], abs=0.3)


def test_the_floor_of_a_hollow_is_no_island():
    hollow = Mesh(box(5, 5, 5).vertices, box(5, 5, 5).faces[:, ::-1])
    assert len(inspect_printability(concatenate([box(10, 10, 10), hollow]), MK4).island_places) == 0


def test_a_ball_touches_the_bed_too_little():
    assert findings(mesh_of(trimesh.creation.icosphere(3, 10)))["bed_contact"] == "note"


def test_powder_needs_no_supports():
    powder = replace(MK4, process="sls")
    ball = mesh_of(trimesh.creation.icosphere(3, 10))
    assert printability_findings(inspect_printability(ball, powder), powder) == []


def test_an_open_mesh_has_no_volume():
    assert inspect_printability(box(1, 1, 1), MK4, solid=False).volume_mm3 is None
