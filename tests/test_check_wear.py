"""Fit, donning and sight against spheres and boxes, where the depth is known."""

import manifold3d
import numpy as np
import pytest
import trimesh

from fabcraft.check.wear import (
    donning_findings,
    fit_findings,
    measure_donning,
    measure_fit,
    measure_sight,
    sight_findings,
    surface_samples,
)
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh, concatenate

FRONT = (0.0, -1.0, 0.0)


def mesh_of(shape) -> Mesh:
    return Mesh(np.array(shape.vertices), np.array(shape.faces).astype(np.int32))


def box(*size: float) -> Mesh:
    return mesh_of(trimesh.creation.box(size))


def moved(mesh: Mesh, *by: float) -> Mesh:
    return mesh.with_vertices(mesh.vertices + np.array(by))


@pytest.fixture(scope="module")
def block() -> SurfaceDistance:
    """A body: 100 x 100 x 100 around the origin."""
    return SurfaceDistance(box(100, 100, 100))


@pytest.fixture(scope="module")
def head() -> SurfaceDistance:
    return SurfaceDistance(mesh_of(trimesh.creation.icosphere(4, 50)))


def bowl(depth_y: float, gap: float = 1.0) -> Mesh:
    """The part of a shell around the head that lies before y = depth_y."""
    shell = manifold3d.Manifold.sphere(52 + gap, 96) - manifold3d.Manifold.sphere(50 + gap, 96)
    found = shell.trim_by_plane((0, -1, 0), -depth_y).to_mesh64()
    return Mesh(np.array(found.vert_properties)[:, :3], np.array(found.tri_verts).astype(np.int32))


def test_a_box_pushed_two_millimetres_into_the_body(block):
    fit = measure_fit(moved(box(10, 10, 10), 0, -53, 0), block)
    assert fit.pen_max_mm == pytest.approx(2.0)
    assert fit.clearance_min_mm == pytest.approx(-2.0)
    assert fit.pen_place[1] == pytest.approx(-48.0)
    # One face of six at depth 2, four sides with depth 2 x along a fifth of their height.
    share = (100 * 4 + 4 * 10 * (2**3 / 3)) / 600
    assert fit.pen_rms_mm == pytest.approx(np.sqrt(share), rel=0.02)
    # Four of the eight vertices, in units of half the body's side.
    assert fit.paper_Dp == pytest.approx(4 * (2 / 50) ** 2)
    assert fit_findings(fit)[0].check == "penetration"
    assert fit_findings(fit)[0].severity == "fail"


def test_a_box_three_millimetres_away_is_clear(block):
    fit = measure_fit(moved(box(10, 10, 10), 0, -58, 0), block, clearance_mm=3.5)
    assert (fit.pen_max_mm, fit.pen_rms_mm, fit.paper_Dp) == (0, 0, 0)
    assert fit.clearance_min_mm == pytest.approx(3.0)
    assert fit.clearance_violation_pct == pytest.approx(100 * (100 + 4 * 10 * 0.5) / 600, abs=0.3)
    assert fit.contact_rms_mm is None
    assert "contact_rms_mm" not in fit.metrics()
    assert fit_findings(fit, clearance_mm=3.5)[0].severity == "warn"
    assert fit_findings(fit, clearance_mm=3.0) == []


def test_contacts_are_held_against_their_gap(block):
    pad = moved(box(10, 10, 10), 0, -57, 0)
    contacts = np.array([[0.0, -50, 0], [2.0, -50, 1], [0.0, -50, 3]])
    fit = measure_fit(pad, block, contacts, gaps_mm=2.0)
    assert fit.contact_rms_mm == pytest.approx(0.0, abs=1e-9)
    off = measure_fit(pad, block, contacts, gaps_mm=np.array([2.0, 2.0, 5.0]))
    assert off.contact_rms_mm == pytest.approx(np.sqrt(3.0))
    assert off.contact_p95_mm == pytest.approx(np.percentile([0, 0, 3], 95))
    assert off.contact_place == (0.0, -50.0, 3.0)
    assert fit_findings(off)[-1].check == "contact"


def test_the_papers_contact_distance_is_zero_on_shared_vertices(block):
    pad = moved(box(10, 10, 10), 0, -55, 0)
    assert measure_fit(pad, block, pad.vertices).paper_Dc == 0.0
    shifted = pad.vertices + np.array([1.0, 0, 0])
    assert measure_fit(pad, block, shifted).paper_Dc == pytest.approx((1 / 50) ** 2)


def test_samples_are_even_by_area_and_repeat():
    both = concatenate([box(10, 10, 10), moved(box(20, 20, 20), 100, 0, 0)])
    samples = surface_samples(both)
    assert samples.shape == (20_000, 3)
    assert (samples[:, 0] > 50).mean() == pytest.approx(0.8, abs=0.001)
    assert np.array_equal(samples, surface_samples(both))


def test_a_shallow_bowl_comes_off_to_the_front(head):
    donning = measure_donning(bowl(-10.0), head, FRONT)
    assert donning.donnable
    assert donning.poses >= 30
    assert donning_findings(donning) == []


def test_a_bowl_deeper_than_half_the_head_sticks_by_its_undercut(head):
    """Its rim, at y = 25 and radius sqrt(51² - 25²) = 44.5, must pass the head's widest section: 50."""
    donning = measure_donning(bowl(25.0), head, FRONT, poses=60)
    assert not donning.donnable
    assert donning.pen_max_mm == pytest.approx(50 - np.sqrt(51**2 - 25**2), abs=0.5)
    assert donning.stuck_at_mm == pytest.approx(25, abs=5)
    assert abs(donning.stuck_place[1]) < 6
    finding = donning_findings(donning)[0]
    assert (finding.check, finding.severity, finding.limit) == ("donning", "fail", 0.5)


def test_flex_lets_a_small_undercut_pass(head):
    assert measure_donning(bowl(12.0), head, FRONT, allowed_mm=1.0).donnable


def test_an_eye_behind_nothing_sees_everything():
    beside = moved(box(10, 10, 10), 200, -50, 0)
    (sight,) = measure_sight(beside, np.array([[0.0, 0, 0]]))
    assert sight.open_share == 1.0
    assert sight_findings((sight,)) == []


def test_a_plate_across_the_view_lets_half_through():
    plate = moved(box(200, 2, 200), 100, -30, 0)
    (sight,) = measure_sight(plate, np.array([[0.0, 0, 0]]))
    assert sight.open_share == pytest.approx(0.5, abs=0.03)
    assert sight_findings((sight,))[0].severity == "warn"


def test_a_hole_opens_the_cone_that_passes_through_it():
    plate = manifold3d.Manifold.cube((200, 0.2, 200), True) - manifold3d.Manifold.cylinder(
        10, 5.0, circular_segments=96, center=True
    ).rotate((90, 0, 0))
    found = plate.translate((0, -30, 0)).to_mesh64()
    mesh = Mesh(np.array(found.vert_properties)[:, :3], np.array(found.tri_verts).astype(np.int32))
    open_, shut = measure_sight(mesh, np.array([[0.0, 0, 0], [60.0, 0, 0]]), half_angle_deg=15.0)
    through = (1 - np.cos(np.arctan(5 / 30))) / (1 - np.cos(np.radians(15)))
    assert open_.open_share == pytest.approx(through, abs=0.03)
    assert shut.open_share == 0.0
    assert [one.severity for one in sight_findings((open_, shut))] == ["warn", "fail"]
