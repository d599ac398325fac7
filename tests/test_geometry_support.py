"""The support estimate: known columns, and the slicer's own word."""

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plated import box, table, tube
from scipy.stats import spearmanr

from fabcraft.check.slicer import PROGRAM, slicer_ini
from fabcraft.geometry.columns import support_columns
from fabcraft.geometry.support import support_of
from fabcraft.mesh import Mesh
from fabcraft.profile import PrinterProfile, load_profile
from fabcraft.solid.orient import oriented
from fabcraft.write.files import write_mesh

MK4 = load_profile("prusa-mk4")


def turned(mesh: Mesh, degrees: float) -> Mesh:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return mesh.with_vertices(mesh.vertices @ np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]]))


def slicer_support_mm3(mesh: Mesh, profile: PrinterProfile, folder: Path) -> float:
    """What PrusaSlicer extrudes as support, mm³."""
    write_mesh(folder / "part.stl", mesh)
    ini = slicer_ini(replace(profile, build_mm=(400.0, 400.0, 400.0)))
    ini = re.sub("fill_density = .*", "fill_density = 0%", ini)
    (folder / "a.ini").write_text(re.sub("perimeters = .*", "perimeters = 1", ini))
    command = [PROGRAM, "-g", "--load", "a.ini", "-o", "part.gcode", "part.stl"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    total, last, supporting = 0.0, 0.0, False
    for line in (folder / "part.gcode").read_text().splitlines():
        if line.startswith(";TYPE:"):
            supporting = line.startswith(";TYPE:Support")
        elif line.startswith("G92"):
            last = 0.0
        elif found := re.match(r"G1 .*E([\d.]+)", line):
            total += (float(found[1]) - last) * supporting
            last = float(found[1])
    return total * np.pi * 1.75**2 / 4.0


def test_the_columns_under_a_table_are_its_volume() -> None:
    mesh = table(40.0, 20.0)
    down = mesh.face_normals[:, 2] < -0.9
    under = down & (mesh.corners[:, :, 2].max(1) > 1.0)
    nothing = np.zeros(len(mesh.faces), dtype=bool)
    found = support_columns(mesh.vertices, mesh.faces, under, nothing, 0.5, (0.5, 0.5))
    assert found.cells * 0.125 == pytest.approx((40.0**2 - 16.0) * 18.5, rel=0.04)
    assert found.tops * 0.25 == pytest.approx(40.0**2 - 16.0, rel=0.01)
    assert found.grounded == found.tops
    assert found.feet == 0


def test_columns_stand_on_what_is_below_and_touch_what_is_to_be_kept() -> None:
    both = np.concatenate(
        [box(10.0, 10.0, 2.0, at=(0, 0, 1)).vertices, box(10.0, 10.0, 2.0, at=(0, 0, 11)).vertices]
    )
    faces = np.concatenate([box(1, 1, 1).faces, box(1, 1, 1).faces + np.int32(8)])
    mesh = Mesh(both, faces)
    kept = (mesh.face_normals[:, 2] > 0.9) & (mesh.corners[:, :, 2].max(1) < 3.0)
    found = support_of(mesh, MK4, kept)
    assert found.kept_mm2 == pytest.approx(100.0, rel=0.05)
    assert support_of(mesh, MK4).kept_mm2 == 0.0


def test_a_box_and_a_cone_of_45_degrees_need_none() -> None:
    assert support_of(box(20.0, 30.0, 10.0), MK4).volume_mm3 == 0.0
    assert support_of(turned(tube(15.0, 9.0, 10.0), 0.0), MK4).volume_mm3 == 0.0


def test_a_table_is_turned_onto_its_top() -> None:
    found = oriented(table(), MK4)
    assert found.before.volume_mm3 > 3000.0
    assert found.after.volume_mm3 < 0.01 * found.before.volume_mm3
    assert found.mesh.size_mm[2] == pytest.approx(21.5)
    assert found.mesh.volume_mm3 == pytest.approx(table().volume_mm3)
    flat = (found.mesh.face_normals[:, 2] < -0.99) & (found.mesh.corners[:, :, 2].max(1) < 1e-6)
    assert found.mesh.face_areas[flat].sum() == pytest.approx(1600.0)


def test_the_same_object_is_turned_the_same_way_again() -> None:
    first, again = oriented(tube(20.0, 16.0, 15.0), MK4), oriented(tube(20.0, 16.0, 15.0), MK4)
    np.testing.assert_array_equal(first.mesh.vertices, again.mesh.vertices)


def test_the_skin_side_is_kept_clean() -> None:
    # an arch: over its legs the inside needs support; lying on its side nothing does, and nothing touches the inside
    mesh = turned(tube(20.0, 16.0, 60.0), 90.0)
    inside = np.linalg.norm(mesh.corners.mean(1)[:, [0, 2]], axis=1) < 16.5
    found = oriented(mesh, MK4, inside)
    assert found.before.kept_mm2 > 100.0
    assert found.after.kept_mm2 == 0.0
    assert "skin side" in found.words


def test_powder_only_lies_low() -> None:
    powder = replace(MK4, process="sls")
    assert oriented(box(20.0, 30.0, 50.0), powder).mesh.size_mm[2] == pytest.approx(20.0)


@pytest.mark.skipif(shutil.which(PROGRAM) is None, reason="prusa-slicer is not installed")
def test_the_estimate_ranks_poses_as_the_slicer_does(tmp_path: Path) -> None:
    coarse = replace(MK4, layer_mm=0.3)
    poses = [turned(table(24.0, 12.0), angle) for angle in (0.0, 60.0, 90.0, 180.0)]
    poses += [turned(tube(12.0, 9.0, 10.0), angle) for angle in (90.0, 60.0)]
    own = [support_of(one, coarse).volume_mm3 for one in poses]
    told = [slicer_support_mm3(one, coarse, tmp_path) for one in poses]
    assert spearmanr(own, told)[0] >= 0.9
    assert told[int(np.argmin(own))] <= 1.1 * min(told) + 20.0
