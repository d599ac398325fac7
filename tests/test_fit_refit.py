import numpy as np
import pytest
import trimesh
from worn import ball

from fabcraft.errors import InputError
from fabcraft.fit.refit import refitted
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh

SKIN = SurfaceDistance(ball(8.0, 3))


def band(long: float, short: float, wall: float, high: float = 6.0) -> Mesh:
    """An upright oval band: the half axes of its bore, its wall, mm."""
    made = trimesh.creation.annulus(10.0, 10.0 + wall, high, sections=96).subdivide_to_size(1.0)
    radius = np.linalg.norm(made.vertices[:, :2], axis=1, keepdims=True)
    across = made.vertices[:, :2] / radius * (np.array([long, short]) + radius - 10.0)
    return Mesh(np.column_stack([across, made.vertices[:, 2]]), made.faces.astype(np.int32), "band")


def bore_of(mesh: Mesh) -> Mesh:
    middles = mesh.corners.mean(1)
    return mesh.submesh((mesh.face_normals[:, :2] * middles[:, :2]).sum(1) < -1.0)


def height(mesh: Mesh, seat: Mesh) -> np.ndarray:
    """How far the vertices are before the seat, mm."""
    near = SurfaceDistance(seat).closest(mesh.vertices)
    return -((mesh.vertices - near.points) * seat.face_normals[near.faces]).sum(1)


def test_a_round_band_goes_round_an_oval_wrist_with_its_wall():
    seat, goal = bore_of(band(13.0, 10.0, 2.0, 9.0)), band(10.0, 10.0, 2.0)
    outer = np.linalg.norm(goal.vertices[:, :2], axis=1) > 11.9
    assert height(goal, seat)[outer].min() < -0.9
    made = refitted(goal, seat, SKIN, 0.2, 0.8, 1.5)
    crowded = outer & (height(goal, seat) < 0.8)
    assert height(made, seat)[crowded].min() > 1.4 and height(made, seat)[outer].min() > 0.7
    assert height(made, seat).min() > -0.1
    # where it had room it stays
    roomy = outer & (np.abs(goal.vertices[:, 0]) < 2.0)
    assert np.abs(made.vertices - goal.vertices)[roomy].max() < 0.4


def test_a_goal_with_room_for_the_wall_stays_as_it_is():
    seat, goal = bore_of(band(9.9, 9.9, 2.0, 9.0)), band(10.0, 10.0, 2.0)
    np.testing.assert_array_equal(refitted(goal, seat, SKIN, 0.2, 1.5).vertices, goal.vertices)


def test_what_is_in_the_body_comes_out_of_it_and_no_farther():
    goal = band(10.0, 10.0, 2.0).with_vertices(band(10.0, 10.0, 2.0).vertices + [3.0, 0.0, 0.0])
    made = refitted(goal, None, SKIN, 0.2, 1.5)
    assert SKIN.signed(made.vertices).min() > 0.1
    far = goal.vertices[:, 0] > 8.0
    assert np.abs(made.vertices - goal.vertices)[far].max() < 0.1
    assert SKIN.signed(goal.vertices).min() < -0.5


def test_a_wider_band_does_not_narrow_the_way_over_the_hand():
    seat, goal = bore_of(band(13.0, 10.0, 2.0, 6.0)), band(10.0, 10.0, 2.0, 7.0)
    made = refitted(goal, seat, SKIN, 0.2, 1.5)
    assert height(goal, seat).min() < -2.9
    assert height(made, seat).min() > -0.1


def test_of_what_goes_through_the_body_only_the_outside_guides():
    around = ball(10.0, 3).with_vertices(ball(10.0, 3).vertices + [0.0, 0.0, 6.0])
    made = refitted(around, None, SKIN, 0.2, 1.5)
    assert 0 < len(made.faces) < len(around.faces)
    assert SKIN.signed(made.corners.mean(1)).min() >= 0.2
    known = {tuple(place) for place in around.vertices}
    assert all(tuple(place) in known for place in made.vertices)


def test_guidance_inside_the_body_altogether_is_refused():
    with pytest.raises(InputError, match="inside the body altogether"):
        refitted(ball(2.0, 2), None, SKIN, 0.2, 1.5)
