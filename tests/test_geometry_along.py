"""Ways along a surface go round a wall and not through it."""

import numpy as np
import trimesh

from fabcraft.fit.shape_terms import lock_weights
from fabcraft.geometry.along import face_distances
from fabcraft.mesh import Mesh


def plate() -> Mesh:
    """40 x 40 x 2 mm."""
    made = trimesh.creation.box((40.0, 40.0, 2.0)).subdivide_to_size(2.0)
    return Mesh(np.array(made.vertices), made.faces.astype(np.int32))


def test_the_other_side_of_a_wall_is_as_far_as_the_way_round():
    mesh = plate()
    top, middle = mesh.face_normals[:, 2] > 0.9, np.linalg.norm(mesh.corners.mean(1)[:, :2], axis=1) < 2.0
    found = face_distances(mesh, top & middle, 100.0)
    assert (found[top & middle] == 0.0).all()
    under = found[middle & ~top]
    assert 36.0 < under.min() < 1.3 * 42.0  # to the edge, across it, and back, zigzag
    assert not np.isfinite(face_distances(mesh, top & middle, 10.0)[middle & ~top]).any()


def test_a_lock_does_not_reach_through_a_wall():
    mesh = plate()
    top = mesh.face_normals[:, 2] > 0.9
    lock = lock_weights(mesh, top, 5.0)
    assert (lock[top] == 1.0).all()
    middle = np.abs(mesh.corners.mean(1)[:, :2]).max(1) < 12.0
    assert (lock[middle & ~top] == 0.0).all()
    assert ((lock > 0.0) & ~top).any()  # it fades over the edge
