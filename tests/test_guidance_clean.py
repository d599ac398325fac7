import numpy as np
import pytest
import trimesh
from registered import clutter, given
from worn import ball, horned, torus

from fabcraft.errors import InputError
from fabcraft.guidance.clean import cleaned
from fabcraft.mesh import Mesh, concatenate


def apart(mesh, shift):
    return mesh.with_vertices(mesh.vertices + shift)


def test_a_clean_mesh_is_left_as_it_is():
    found = cleaned(horned())
    assert found.notes == ()
    assert len(found.mesh.faces) == len(horned().faces)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6])
def test_a_floor_plate_and_crumbs_are_left_out_and_what_touches_stays(scale):
    shape = horned()
    plate, *balls = clutter(shape, 3)
    whole, _ = given(shape, np.eye(3), scale, 3)
    found = cleaned(whole)
    assert len(found.mesh.faces) == len(shape.faces) + sum(len(one.faces) for one in balls[6:])
    assert found.notes[0].startswith("A flat plate was left out")
    assert found.notes[1].startswith("6 pieces that stand apart were left out")
    assert len(plate.faces)


def test_a_mesh_of_unconnected_triangles_stays_whole():
    shape = ball()
    middle = shape.corners.mean(1, keepdims=True)
    corners = (middle + 0.97 * (shape.corners - middle)).reshape(-1, 3)
    soup = Mesh(corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3))
    assert len(cleaned(soup).mesh.faces) == len(shape.faces)


def test_doubled_and_collapsed_faces_go():
    shape = ball()
    faces = np.concatenate([shape.faces, shape.faces[:50, ::-1], shape.faces[:9, [0, 0, 1]]]).astype(np.int32)
    assert len(cleaned(Mesh(shape.vertices, faces)).mesh.faces) == len(shape.faces)


def test_two_alike_objects_are_kept_unless_one_is_asked():
    two = concatenate([torus(10.0, 2.0), apart(torus(10.0, 2.0), [60.0, 0.0, 0.0])])
    assert len(cleaned(two).mesh.faces) == len(two.faces)


def test_of_a_pair_one_is_kept():
    two = concatenate([ball(20.0), apart(ball(19.0), [80.0, 0.0, 0.0])])
    assert len(cleaned(two, single=True).mesh.faces) == len(ball().faces)


def test_too_many_faces_become_fewer(monkeypatch):
    monkeypatch.setattr("fabcraft.guidance.clean.MOST_FACES", 5000)
    shape = trimesh.creation.icosphere(5, 30.0)
    found = cleaned(Mesh(np.array(shape.vertices), np.array(shape.faces, dtype=np.int32)))
    assert len(found.mesh.faces) <= 5050
    assert np.linalg.norm(found.mesh.vertices, axis=1) == pytest.approx(30.0, abs=0.05)


def test_points_on_one_spot_are_no_surface():
    with pytest.raises(InputError, match="no surface"):
        cleaned(Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]], dtype=np.int32)))
