"""Girths against circles and squares of known length."""

import numpy as np
import pytest
import trimesh

from fabcraft.body.measures import girth_mm
from fabcraft.mesh import Mesh


def mesh_of(shape):
    return Mesh(np.asarray(shape.vertices, dtype=np.float64), np.asarray(shape.faces, dtype=np.int32))


def test_the_girth_of_a_cylinder_is_its_circle():
    tube = mesh_of(trimesh.creation.cylinder(radius=50.0, height=200.0, sections=256))
    up = np.array([0.0, 0.0, 1.0])
    assert girth_mm(tube, np.zeros(3), up) == pytest.approx(2 * np.pi * 50, rel=1e-3)


def test_the_girth_is_that_of_the_loop_nearest_to_the_point():
    near, far = (trimesh.creation.box((side, side, 100.0)) for side in (10.0, 40.0))
    far.apply_translation((100.0, 0.0, 0.0))
    both = Mesh(
        np.concatenate([near.vertices, far.vertices]),
        np.concatenate([near.faces, far.faces + 8]).astype(np.int32),
    )
    up = np.array([0.0, 0.0, 2.0])
    assert girth_mm(both, np.zeros(3), up) == pytest.approx(40)
    assert girth_mm(both, np.array([90.0, 0.0, 0.0]), up) == pytest.approx(160)


def test_a_tape_bridges_hollows():
    solid = mesh_of(
        trimesh.boolean.union(
            [trimesh.creation.box((60.0, 20.0, 50.0)), trimesh.creation.box((20.0, 60.0, 50.0))]
        )
    )
    assert girth_mm(solid, np.zeros(3), np.array([0.0, 0.0, 1.0])) == pytest.approx(80 + 4 * np.hypot(20, 20))


def test_a_plane_beside_the_mesh_has_no_girth():
    box = mesh_of(trimesh.creation.box((10.0, 10.0, 10.0)))
    assert girth_mm(box, np.array([0.0, 0.0, 50.0]), np.array([0.0, 0.0, 1.0])) == 0
