"""Fields of spheres and boxes, whose distances are known."""

import numpy as np
import pytest
import trimesh

from fabcraft.errors import SolidError
from fabcraft.geometry.implicit import (
    Convex,
    blurred,
    met,
    settled,
    sheet,
    slope,
    smooth_common,
    smooth_union,
)

BOX = np.array([[-20.0, -20.0, -20.0], [20.0, 20.0, 20.0]])


def ball(points):
    return np.linalg.norm(points, axis=1) - 12.0


def test_the_hull_of_a_box_is_the_distance_to_its_faces():
    corners = trimesh.creation.box((10.0, 20.0, 30.0)).vertices
    for mirrored in (False, True):
        hull = Convex.around(np.array(corners), mirrored)
        places = np.array([[0.0, 0.0, 0.0], [7.0, 0.0, 0.0], [-7.0, 3.0, 1.0], [0.0, 0.0, 14.0]])
        assert hull(places) == pytest.approx([-5.0, 2.0, 2.0, -1.0])


@pytest.mark.parametrize("mirrored", [False, True])
def test_blurring_a_plane_changes_nothing(mirrored):
    field = blurred(lambda p: p[:, 2] - 1.0, BOX, 4.0, 2.0, mirrored)
    places = np.array([[0.0, 0.0, 0.0], [5.0, 3.0, 7.5], [-5.0, 3.0, -6.0]])
    assert field(places) == pytest.approx(places[:, 2] - 1.0, abs=1e-6)


def test_a_blurred_distance_never_changes_faster_than_the_way():
    field = blurred(lambda p: np.abs(p).max(1) - 10.0, BOX, 3.0, 1.5)
    places = np.random.default_rng(0).uniform(-15.0, 15.0, (500, 3))
    assert np.linalg.norm(slope(field, places, 0.1), axis=1).max() < 1.02


@pytest.mark.parametrize("mix", [smooth_union, smooth_common])
def test_a_fillet_is_a_quarter_of_its_size_where_two_solids_meet_and_nothing_beside(mix):
    sign = -1.0 if mix is smooth_union else 1.0
    one, other = np.array([0.0, 5.0, -9.0]), np.array([0.0, -5.0, 1.0])
    plain = np.minimum(one, other) if mix is smooth_union else np.maximum(one, other)
    assert mix(one, other, 8.0) - plain == pytest.approx([sign * 2.0, 0.0, 0.0])


def test_the_sheet_of_a_ball_is_a_sphere():
    found = sheet(ball, BOX, 1.0)
    shape = trimesh.Trimesh(found.vertices, found.faces, process=False)
    assert shape.is_watertight
    assert shape.euler_number == 2
    assert found.volume_mm3 == pytest.approx(4.0 / 3.0 * np.pi * 12.0**3, rel=0.01)
    assert np.abs(ball(settled(found, ball, 0.5).vertices)).max() < 1e-3


def test_a_ray_meets_the_last_surface_on_its_way():
    found = met(ball, np.zeros(3), np.array([0.0, 0.6, 0.8]), 40.0)
    assert found == pytest.approx([0.0, 7.2, 9.6], abs=1e-6)
    with pytest.raises(SolidError, match="meets no surface"):
        met(ball, np.array([0.0, 0.0, 20.0]), np.array([0.0, 0.0, 1.0]), 40.0)
