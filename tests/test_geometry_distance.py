"""Distances to shapes whose distance has a closed form."""

import numpy as np
import pytest
import trimesh

from fabcraft.errors import InputError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh

RNG = np.random.default_rng(7)


def from_trimesh(shape) -> Mesh:
    return Mesh(np.array(shape.vertices), np.array(shape.faces, dtype=np.int32))


def box_signed(points, half):
    q = np.abs(points) - half
    return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(1), 0)


def test_signed_distance_to_a_box_is_the_closed_form():
    half = np.array([3.0, 5.0, 8.0])
    box = SurfaceDistance(from_trimesh(trimesh.creation.box(2 * half)))
    points = RNG.uniform(-12, 12, (5000, 3))
    assert np.abs(box.signed(points) - box_signed(points, half)).max() < 1e-9


def test_signed_distance_to_a_sphere_is_the_radius_difference():
    sphere = SurfaceDistance(from_trimesh(trimesh.creation.icosphere(5, 20.0)))
    points = RNG.uniform(-30, 30, (5000, 3))
    # The chord of a level-5 icosphere lies at most 0.01 mm below the sphere of radius 20.
    assert np.abs(sphere.signed(points) - (np.linalg.norm(points, axis=1) - 20.0)).max() < 0.012


def test_the_sign_is_negative_inside_also_where_two_parts_overlap():
    one = trimesh.creation.box([10, 10, 10])
    two = one.copy().apply_translation([4.0, 0, 0])
    both = SurfaceDistance(from_trimesh(trimesh.util.concatenate([one, two])))
    assert both.inside(np.array([[0.0, 0, 0], [2, 0, 0], [8, 0, 0], [9.5, 0, 0], [-5.5, 0, 0]])).tolist() == [
        True, True, True, False, False,
    ]  # fmt: skip


def test_the_gradient_points_out_and_has_unit_length():
    box = SurfaceDistance(from_trimesh(trimesh.creation.box([10, 10, 10])))
    points = np.array([[7.0, 0.3, 0.2], [4.0, 0.3, 0.2], [5.0, 0.3, 0.2]])
    signed, gradient = box.signed_with_gradient(points)
    assert np.allclose(signed, [2, -1, 0], atol=1e-9)
    assert np.allclose(gradient, [[1, 0, 0]] * 3, atol=1e-9)


def test_closest_names_the_face_that_holds_the_point():
    mesh = from_trimesh(trimesh.creation.icosphere(3, 20.0))
    found = SurfaceDistance(mesh).closest(RNG.uniform(-30, 30, (500, 3)))
    corners = mesh.corners[found.faces]
    weights = trimesh.triangles.points_to_barycentric(corners, found.points)
    assert weights.min() > -1e-9 and np.allclose(weights.sum(1), 1)


def test_no_points_give_no_distances():
    box = SurfaceDistance(from_trimesh(trimesh.creation.box([1, 1, 1])))
    assert box.signed(np.zeros((0, 3))).shape == (0,)
    assert box.closest(np.zeros((0, 3))).points.shape == (0, 3)


def test_a_mesh_without_faces_is_refused():
    with pytest.raises(InputError, match="no faces"):
        SurfaceDistance(Mesh(np.zeros((3, 3)), np.zeros((0, 3), np.int32)))
