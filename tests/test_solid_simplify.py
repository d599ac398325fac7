"""Fewer faces, same guarantee."""

import numpy as np
import pytest
import trimesh

from fabcraft.errors import SolidError
from fabcraft.geometry.crossing import self_intersecting_faces
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh
from fabcraft.solid.manifolds import try_manifold
from fabcraft.solid.simplify import reduce_faces, simplify


def mesh_of(shape) -> Mesh:
    return Mesh(np.array(shape.vertices), np.array(shape.faces, dtype=np.int32))


TORUS = mesh_of(trimesh.creation.torus(20.0, 5.0, major_sections=128, minor_sections=64))


def test_simplify_stays_closed_and_within_its_tolerance():
    smaller, tolerance = simplify(TORUS, 0.05)
    assert tolerance == 0.05 and len(smaller.faces) < 0.6 * len(TORUS.faces)
    assert try_manifold(smaller).genus() == 1
    assert SurfaceDistance(smaller).closest(TORUS.vertices).distances.max() <= 0.051


def test_no_tolerance_keeps_every_face():
    kept, tolerance = simplify(TORUS, 0.0)
    assert tolerance == 0 and len(kept.faces) == len(TORUS.faces)


def test_the_tolerance_is_halved_until_no_two_shells_cross():
    outer, inner = trimesh.creation.icosphere(5, 30.0), trimesh.creation.icosphere(5, 29.9)
    inner.invert()
    shell = mesh_of(trimesh.util.concatenate([outer, inner]))
    smaller, tolerance = simplify(shell, 0.6)
    assert tolerance < 0.6
    assert len(self_intersecting_faces(smaller)) == 0
    assert try_manifold(smaller) is not None


def test_faces_through_each_other_are_named():
    one = trimesh.creation.box([10, 10, 10])
    two = one.copy().apply_translation([5, 5, 5])
    assert len(self_intersecting_faces(mesh_of(trimesh.util.concatenate([one, two])))) > 0
    assert len(self_intersecting_faces(TORUS)) == 0


def test_a_face_budget_is_kept():
    smaller = reduce_faces(TORUS, 2000)
    assert len(smaller.faces) <= 2000
    assert try_manifold(smaller).genus() == 1
    assert SurfaceDistance(smaller).closest(TORUS.vertices).distances.max() < 0.2


def test_a_budget_that_would_ruin_the_shape_is_refused():
    balls = [trimesh.creation.icosphere(3, 3.0).apply_translation([10 * k, 0, 0]) for k in range(8)]
    with pytest.raises(SolidError, match="cannot become 20"):
        reduce_faces(mesh_of(trimesh.util.concatenate(balls)), 20)


def test_an_open_mesh_is_refused():
    with pytest.raises(SolidError, match="not a closed manifold"):
        simplify(TORUS.submesh(np.arange(10, len(TORUS.faces))), 0.1)
