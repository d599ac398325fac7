"""Gaps, bridges, sharp edges and file limits on shapes whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest
from nasty import ball, box, chain, cut, moved, rod, slotted

from fabcraft.check.bridges import bridge_findings, measure_bridges
from fabcraft.check.gap import Gaps, gap_findings, measure_gaps
from fabcraft.check.inspect import check_mesh
from fabcraft.check.printability import file_findings
from fabcraft.check.sharp import measure_sharp_edges, sharp_findings
from fabcraft.check.topology import inspect_topology
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.support import support_of
from fabcraft.mesh import Mesh, concatenate
from fabcraft.profile import load_profile

MK4, POWDER = load_profile("prusa-mk4"), load_profile("sls-pa12")


def gaps(mesh: Mesh, between: float = 0.5, within: float = 0.6) -> Gaps:
    return measure_gaps(mesh, inspect_topology(mesh).part_of_face, between, within)


@pytest.mark.parametrize("width", [0.3, 0.42])
def test_the_gap_between_two_blocks_is_as_wide_as_it_is(width):
    found = gaps(concatenate([box(10, 10, 10), moved(box(10, 10, 10), 10 + width, 0, 0)]))
    assert found.between_mm == pytest.approx(width, rel=0.03)
    assert found.within_mm is None
    assert np.abs(found.between_places[:, 0] - 5).max() < width + 0.01


def test_blocks_further_apart_than_the_limit_have_no_gap():
    found = gaps(concatenate([box(10, 10, 10), moved(box(10, 10, 10), 10.6, 0, 0)]))
    assert found.between_mm is None and found.within_mm is None


def test_a_slot_is_a_gap_within_one_part_and_a_note():
    found = gaps(slotted())
    assert found.within_mm == pytest.approx(0.3, rel=0.03) and found.between_mm is None
    assert [(one.check, one.severity) for one in gap_findings(found, MK4)] == [("detail", "note")]


def test_the_links_of_a_chain_are_as_far_apart_as_they_were_made():
    found = gaps(chain(2, 0.4), between=0.8)
    assert found.between_mm == pytest.approx(0.4, abs=0.1)
    assert gap_findings(found, MK4)[0].severity == "warn"


def test_inner_corners_of_right_angles_are_no_gaps():
    corner = cut(box(20, 20, 20), moved(box(20, 20, 20), 5, 5, 5))
    assert gaps(corner, 2.0, 2.0).within_mm is None


def test_the_report_tells_a_gap():
    report = check_mesh(concatenate([box(10, 10, 10), moved(box(10, 10, 10), 10.3, 0, 0)]), MK4)
    assert report.metrics["gap_between_mm"] == pytest.approx(0.3, rel=0.03)
    assert "gap" in {one.check for one in report.findings}


def table(span: float) -> Mesh:
    return cut(box(span + 8, 10, 20), moved(box(span, 12, 16), 0, 0, -4))


def test_a_bridge_is_as_long_as_its_opening():
    for span, noted in ((8.0, False), (16.0, True)):
        found = measure_bridges(table(span), -9.8)
        assert found.spans_mm == pytest.approx([span], abs=1.0)
        assert bool(bridge_findings(found, MK4)) == noted


def test_a_shelf_counts_twice_and_what_rests_on_nothing_is_endless():
    shelf = cut(box(20, 10, 20), moved(box(12, 12, 16), 4, 0, -4))
    assert measure_bridges(shelf, -9.8).spans_mm == pytest.approx([24], abs=1.2)
    loose = concatenate([box(10, 10, 10), moved(box(4, 4, 4), 20, 0, 5)])
    assert measure_bridges(loose, -4.8).spans_mm.tolist() == [np.inf]


def test_a_block_on_the_bed_has_no_bridge():
    assert len(measure_bridges(box(10, 10, 10), -4.8).spans_mm) == 0


def test_a_square_rim_beside_the_skin_is_sharp_and_a_round_one_is_not():
    arm = SurfaceDistance(rod(20, 100, 96))
    square = cut(rod(24, 10, 96), rod(21, 20, 96))
    found = measure_sharp_edges(square, arm)
    assert found.length_mm == pytest.approx(2 * 2 * np.pi * 21, rel=0.01)
    assert sharp_findings(found)[0].severity == "warn"
    round_one = moved(ball(5), 26, 0, 0)
    assert measure_sharp_edges(round_one, arm).length_mm == 0


def with_upright_slivers(mesh, face):
    """The mesh with two slivers along the longest edge of a face, standing square on it."""
    corners = mesh.vertices[mesh.faces[face]]
    first = int(np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=1).argmax())
    a, b = mesh.faces[face, first], mesh.faces[face, (first + 1) % 3]
    low = len(mesh.vertices)
    middle = mesh.vertices[[a, b]].mean(0)
    vertices = np.vstack([mesh.vertices, middle, middle + 0.004 * mesh.face_normals[face]])
    faces = [[a, low + 1, low], [low, low + 1, b]]
    for corner in mesh.faces:
        at = [k for k in range(3) if {corner[k], corner[(k + 1) % 3]} == {a, b}]
        if not at:
            faces.append(corner)
            continue
        one, other, third = np.roll(corner, -at[0])
        new = low if one == a else low + 1
        faces += [[one, new, third], [new, other, third]]
    return Mesh(vertices, np.array(faces, dtype=np.int32), mesh.name)


def test_a_sliver_is_no_edge_and_hides_none():
    block, plane = box(20, 20, 4), SurfaceDistance(moved(box(100, 100, 10), 0, 0, -7.5))
    alone = measure_sharp_edges(block, plane).length_mm
    assert alone == pytest.approx(80, rel=0.3)
    below = int(np.argmin(block.face_normals[:, 2]))  # their longest edge is the diagonal of the underside
    marred = with_upright_slivers(block, below)
    assert inspect_topology(marred).solid
    assert measure_sharp_edges(marred, plane).length_mm == pytest.approx(alone, abs=1e-3)


def test_inner_corners_beside_the_skin_do_not_press():
    plane = SurfaceDistance(moved(box(100, 100, 10), 0, 0, -7))
    step = cut(box(20, 20, 4), moved(box(10, 30, 2), 0, 0, 1))
    alone = measure_sharp_edges(box(20, 20, 4), plane).length_mm
    assert measure_sharp_edges(step, plane).length_mm == pytest.approx(alone, rel=0.01)


def test_a_service_refuses_what_is_too_large_for_it():
    assert file_findings(900_000, POWDER) == []
    few = replace(POWDER, max_faces=1000, max_file_mb=0.1)
    assert [(one.value, one.unit, one.severity) for one in file_findings(4000, few)] == [
        (4000, "faces", "fail"),
        (0.2, "MB", "fail"),
    ]
    assert file_findings(10**9, MK4) == []


def test_the_report_tells_the_support_that_the_part_needs():
    report = check_mesh(table(16.0), MK4)
    assert report.metrics["support_estimate_mm3"] == support_of(table(16.0), MK4).volume_mm3
    # sparse columns: more than a tenth of the room under the top, and less than half of it
    assert 0.1 < report.metrics["support_estimate_mm3"] / (16 * 10 * 14) < 0.5
    assert "support_estimate_mm3" not in check_mesh(table(16.0), POWDER).metrics
