import numpy as np
import pytest
import trimesh
from registered import SCALES, error, given, orientations, shaken
from scipy.spatial.transform import Rotation
from worn import ball, horned, torus

from fabcraft.errors import InputError
from fabcraft.geometry.align import Similarity
from fabcraft.guidance.alignment import Aligned, aligned, laid_on, mirror_plane, seated
from fabcraft.guidance.clean import cleaned
from fabcraft.mesh import Mesh


def turned(mesh, seed, scale):
    turn = Rotation.random(random_state=seed).as_matrix()
    return mesh.with_vertices(scale * mesh.vertices @ turn.T + [300.0, -20.0, 7.0])


@pytest.mark.parametrize(("seed", "scale"), [(1, 0.01), (2, 30.0), (3, 1.0)])
def test_a_mesh_of_any_scale_and_turn_comes_back_onto_itself(seed, scale):
    onto = horned()
    found = aligned(turned(onto, seed, scale), onto)
    assert found.residual < 0.04
    assert found.scaled == pytest.approx(1.0 / scale, rel=0.05)


def test_what_resembles_nothing_is_refused_unless_forced():
    stick = trimesh.creation.cylinder(0.5, 60.0)
    stick = Mesh(np.array(stick.vertices), np.array(stick.faces, dtype=np.int32), "stick")
    with pytest.raises(InputError, match=r"resembles the ring too little: .* at most 10 % was expected"):
        aligned(stick, torus(10.0, 2.0))
    assert aligned(stick, torus(10.0, 2.0), force=True).residual > 0.1


def test_a_mesh_without_a_surface_is_refused():
    with pytest.raises(InputError, match="no surface"):
        aligned(Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32)), ball())


@pytest.mark.parametrize("index", [7, 14])
def test_a_mesh_with_clutter_comes_back_within_two_degrees_and_two_percent(index):
    onto = horned()
    bent = onto.vertices + 0.006 * onto.vertices[:, :1] ** 2 * [
        1.0,
        0.0,
        0.0,
    ]  # no turn brings it onto itself
    uneven = onto.with_vertices(bent * [1.0, 0.8, 1.3])
    whole, pose = given(shaken(uneven, index), orientations()[index], SCALES[index % 3], index)
    found = aligned(cleaned(whole).mesh, uneven)
    degrees, scale, off = error(found.placed, pose, Similarity(), uneven)
    assert degrees < 2.0
    assert scale < 0.02
    assert off < 0.02


def test_a_mesh_stays_where_its_user_puts_it():
    onto = horned()
    found = laid_on(onto, onto, Similarity(2.0, np.eye(3), np.array([5.0, 0.0, 0.0])))
    assert found.mesh.vertices == pytest.approx(2.0 * onto.vertices + [5.0, 0.0, 0.0])
    assert found.residual > 0.1
    assert found.words.startswith("placed by its transform")


def arched(tilt: float = 0.0) -> Mesh:
    """Half of a flattened ball's skin, symmetric about x = 0; tilted about y, degrees."""
    made = trimesh.creation.icosphere(4)
    mesh = Mesh(np.array(made.vertices) * [30.0, 36.0, 12.0], made.faces.astype(np.int32), "visor")
    half = mesh.submesh(mesh.corners.mean(1)[:, 1] < 0.0)
    return half.with_vertices(half.vertices @ Rotation.from_euler("y", tilt, degrees=True).as_matrix().T)


def test_a_mesh_that_is_its_own_mirror_image_says_in_which_plane():
    place, normal = mirror_plane(arched())
    np.testing.assert_allclose(normal, [1.0, 0.0, 0.0])
    assert place[0] == pytest.approx(0.0, abs=1e-9)
    assert mirror_plane(arched(tilt=15.0)) is None
    assert (
        mirror_plane(
            horned().with_vertices(horned().vertices * [1.0, 1.0, 1.0] + horned().vertices[:, :1] ** 2 * 0.01)
        )
        is None
    )


def test_a_symmetric_mesh_stays_upright_on_a_symmetric_one_of_other_proportions():
    goal = arched().with_vertices(arched().vertices * [1.4, 1.0, 1.3])
    turn = aligned(goal, arched()).placed.rotation
    # its mirror plane is the template's
    assert abs(turn[0, 0]) == pytest.approx(1.0, abs=1e-4)


def test_a_turn_that_hardly_helps_the_seat_is_not_made():
    template = annulus(10.0, 11.0)
    seat = template.submesh(np.linalg.norm(template.corners[:, :, :2], axis=2).max(1) < 10.1)
    oval = annulus(10.0, 11.0)
    found = Aligned(oval.with_vertices(oval.vertices * [1.15, 0.95, 1.0]), 0.1, Similarity())
    turned = seated(found, seat).placed.rotation
    np.testing.assert_allclose(turned, np.eye(3), atol=1e-9)


def annulus(bore: float, rim: float, high: float = 5.0) -> Mesh:
    made = trimesh.creation.annulus(bore, rim, high, sections=96)
    made = made.subdivide_to_size(1.5)
    return Mesh(np.array(made.vertices), made.faces.astype(np.int32), "ring")


def test_a_thick_ring_is_sized_by_its_bore():
    template, goal = annulus(10.0, 11.0), annulus(6.0, 11.0)
    looks_in = np.linalg.norm(template.corners[:, :, :2], axis=2).max(1) < 10.1
    seat = template.submesh(looks_in)
    turn = Rotation.from_rotvec([0.0, 0.1, 0.0]).as_matrix()
    found = Aligned(goal.with_vertices(goal.vertices @ turn.T + [0.5, 0.0, 0.3]), 0.1, Similarity())
    placed = seated(found, seat)
    bore = np.linalg.norm(placed.mesh.vertices[:, :2], axis=1).min()
    assert bore == pytest.approx(10.0, abs=0.15)
    np.testing.assert_allclose(placed.placed.points(found.mesh.vertices), placed.mesh.vertices, atol=1e-9)


def test_a_ball_without_a_bore_stays_where_it_is():
    seat = annulus(10.0, 11.0)
    seat = seat.submesh(np.linalg.norm(seat.corners[:, :, :2], axis=2).max(1) < 10.1)
    ball = trimesh.creation.icosphere(3, 11.0)
    found = Aligned(Mesh(np.array(ball.vertices), ball.faces.astype(np.int32)), 0.1, Similarity())
    assert seated(found, seat) is found
