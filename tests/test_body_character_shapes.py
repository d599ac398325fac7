"""The shapes that characters are modelled from, against known answers; and the mesh of a shape."""

import numpy as np
import pytest
import trimesh

from fabcraft.body.characters.nets import _patches, symmetric_mesh
from fabcraft.body.characters.shapes import (
    ball,
    both_sides,
    box,
    carved,
    crease,
    drum,
    ellipsoid,
    joined,
    limb,
    standing,
    thorn,
)

BOUNDS = np.array([[-40.0, -40.0, -40.0], [40.0, 40.0, 40.0]])


def at(shape, *points):
    return shape.distance(np.array(points, dtype=np.float64))


def closed(mesh):
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    return (
        solid.is_watertight
        and solid.is_winding_consistent
        and solid.body_count == 1
        and solid.euler_number == 2
    )


def test_a_ball_has_the_distance_to_its_centre_less_its_radius():
    assert at(ball((1, 2, 3), 5), (1, 2, 3), (1, 2, 13)) == pytest.approx([-5.0, 5.0])


def test_a_box_is_as_far_as_its_faces_edges_and_corners():
    shape = box((0, 0, 0), (3, 4, 5), 1)
    assert at(shape, (5, 0, 0), (0, 0, 0)) == pytest.approx([2.0, -3.0])
    assert at(shape, (6, 7, 0)) == pytest.approx(np.hypot(4.0, 4.0) - 1.0)


def test_a_narrowing_box_is_narrower_at_its_top():
    shape = box((0, 0, 0), (10, 4, 10), 1, 0.5)
    assert at(shape, (4.5, 0, 9)) < 0 < at(shape, (6.5, 0, 9))
    assert at(shape, (9, 0, -9)) < 0


def test_a_drum_is_as_far_as_its_side_and_its_lid():
    assert at(drum((0, 0, 0), 10, 4, 1), (15, 0, 0), (0, 0, 7), (0, 0, 0)) == pytest.approx([5.0, 3.0, -4.0])


def test_an_ellipsoid_is_zero_on_its_surface_and_turns():
    shape = ellipsoid((0, 0, 0), (10, 4, 4), (0, 0, 90))
    assert at(shape, (0, 10, 0), (4, 0, 0), (0, 0, 4)) == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert at(shape, (0, 0, 0)) == pytest.approx([-4.0])


def test_a_straight_limb_is_the_hull_of_its_two_balls():
    shape = limb([(0, 0, 0), (10, 0, 0)], (3, 1))
    assert at(shape, (-5, 0, 0), (13, 0, 0), (0, 0, 0)) == pytest.approx([2.0, 2.0, -3.0], abs=1e-9)
    slope = np.arcsin(0.2)  # the normal of the slanted side leans forward by asin((r1 - r2) / length)
    normal = np.array([np.sin(slope), 0.0, np.cos(slope)])
    assert at(shape, 3.0 * normal, 3.0 * normal + 2.0 * normal) == pytest.approx([0.0, 2.0], abs=1e-9)


def test_a_curved_limb_passes_through_its_points_with_its_radii():
    points, radii = [(0, 0, 0), (10, 0, 5), (20, 0, 0)], (4, 3, 2)
    assert at(limb(points, radii), *points) == pytest.approx([-4.0, -3.0, -2.0], abs=0.3)


def test_the_least_distance_is_a_lower_bound():
    rng = np.random.default_rng(0)
    points = rng.uniform(-30, 30, (500, 3))
    for shape in (ball((3, 2, 1), 6), box((1, 2, 3), (5, 6, 4), 1), limb([(0, 0, 0), (8, 8, 8)], (4, 2))):
        assert (shape.least(points) <= shape.distance(points) + 1e-9).all()


def test_joining_asks_a_shape_only_where_it_matters_and_changes_nothing_by_that():
    rng = np.random.default_rng(1)
    points = rng.uniform(-40, 40, (2000, 3))
    parts = [ball((0, 0, 0), 12), ball((14, 0, 0), 8), box((-15, 3, 2), (6, 5, 4), 1)]
    whole = joined(5, *parts).distance(points)
    total = parts[0].distance(points)
    for part in parts[1:]:
        other = part.distance(points)
        share = np.maximum(5.0 - np.abs(total - other), 0.0) / 5.0
        total = np.minimum(total, other) - 1.25 * share**2
    assert whole == pytest.approx(total, abs=1e-12)


def test_a_union_is_at_most_a_quarter_of_the_blend_nearer():
    one, other = ball((-5, 0, 0), 6), ball((5, 0, 0), 6)
    assert at(joined(4, one, other), (0, 0, 10)) == pytest.approx(at(one, (0, 0, 10)) - 1.0)


def test_carving_takes_the_cutter_away():
    shape = carved(0, ball((0, 0, 0), 10), ball((10, 0, 0), 4))
    assert at(shape, (9, 0, 0), (0, 0, 0)) == pytest.approx([3.0, -6.0])


def test_a_crease_is_a_groove_in_the_surface_as_deep_as_its_radius():
    whole = ball((0, 0, 0), 20)
    grooved = carved(0, whole, crease(whole, [(-9, -22, 0), (0, -25, 0), (9, -22, 0)], 2))
    assert at(grooved, (0, -19, 0)) == pytest.approx([1.0], abs=0.05)
    assert at(grooved, (0, -17, 0))[0] < -0.9


def test_a_thorn_stands_square_on_the_surface():
    tip = thorn(ball((0, 0, 0), 20), (0, 0, 30), 5, 9)
    assert at(tip, (0, 0, 29), (0, 0, 27)) == pytest.approx(
        [0.0, -2.0], abs=1e-6
    )  # its end is a ball of 2 mm


def test_what_stands_ends_at_the_ground():
    assert at(standing(ball((0, 0, 5), 10), 0), (0, 0, -1), (0, 0, 5)) == pytest.approx([1.0, -5.0])


def test_the_mesh_of_a_ball_is_even_closed_and_round():
    mesh = symmetric_mesh(ball((0, 0, 0), 20), BOUNDS, 2.0)
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert closed(mesh)
    assert solid.volume == pytest.approx(4.0 / 3.0 * np.pi * 20.0**3, rel=0.01)
    assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - 20.0).max() < 1e-3
    assert np.degrees(solid.face_angles.min()) > 25.0


@pytest.mark.parametrize("cell_mm", [1.5, 2.3])
def test_the_mesh_is_its_own_mirror_image_to_the_last_bit(cell_mm):
    mesh = symmetric_mesh(both_sides(ball((12, 3, 0), 15), 6), BOUNDS, cell_mm)
    assert closed(mesh)
    there = {tuple(point) for point in (mesh.vertices + 0.0).tolist()}
    assert there == {(-x + 0.0, y, z) for x, y, z in there}


def test_corners_that_do_not_touch_get_sheets_of_their_own():
    sheets = _patches().max(1) + 1
    assert sheets[0b00000001] == 1  # one corner inside
    assert sheets[0b10000001] == 2  # two at the ends of a diagonal of the cell
    assert sheets[0b00001001] == 2  # two across a side
    assert sheets[0b11110110] == 1  # two outside across a side: what is inside parts them
    assert sheets[0b10010110] == 4  # every other corner


def test_a_narrow_slot_leaves_the_mesh_closed():
    slotted = carved(0, box((0, 0, 0), (15, 10, 10), 1), box((0, -10, 0.9), (12, 8, 1.1), 0.4))
    for cell_mm in (1.5, 2.0, 2.5):
        mesh = symmetric_mesh(slotted, BOUNDS, cell_mm)
        assert closed(mesh)
        assert np.abs(slotted.distance(mesh.vertices)).max() < 0.01
