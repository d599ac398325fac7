"""Loop's weights on a mesh small enough to check by hand, and what subdivision must keep."""

import numpy as np
import pytest
import scipy.sparse
import trimesh

from fabcraft.geometry.subdivide import halving_matrix, loop_matrix


def test_a_tetrahedron_gets_loops_weights():
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], dtype=np.int32)
    matrix, children = loop_matrix(faces, 4)
    assert matrix.shape == (10, 4)
    assert children.shape == (16, 3)
    expected = np.full((4, 4), 3 / 16)
    np.fill_diagonal(expected, 1 - 3 * 3 / 16)
    assert matrix.toarray()[:4] == pytest.approx(expected)
    assert matrix.toarray()[4] == pytest.approx([3 / 8, 3 / 8, 1 / 8, 1 / 8])  # the edge 0-1


def test_a_boundary_follows_its_own_spline():
    matrix, _ = loop_matrix(np.array([[0, 1, 2]], dtype=np.int32), 3)
    assert matrix.toarray()[0] == pytest.approx([3 / 4, 1 / 8, 1 / 8])
    assert matrix.toarray()[3:] == pytest.approx(np.array([[0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]]))


def test_closed_stays_closed_and_outside_stays_outside():
    ball = trimesh.creation.icosphere(2)
    matrix, faces = loop_matrix(ball.faces.astype(np.int32), len(ball.vertices))
    fine = trimesh.Trimesh(matrix @ ball.vertices, faces, process=False)
    assert fine.is_watertight
    assert fine.is_winding_consistent
    assert 0.9 * ball.volume < fine.volume < ball.volume * 1.05
    assert np.asarray(matrix.sum(1)).ravel() == pytest.approx(1)


def test_a_linear_function_on_a_regular_grid_is_kept_inside():
    x, y = np.meshgrid(np.arange(6.0), np.arange(6.0))
    points = np.stack([x.ravel(), y.ravel(), np.zeros(36)], 1)
    corner = (np.arange(5)[:, None] * 6 + np.arange(5)).ravel()
    faces = np.concatenate(
        [np.stack([corner, corner + 1, corner + 7], 1), np.stack([corner, corner + 7, corner + 6], 1)]
    ).astype(np.int32)
    matrix, _ = loop_matrix(faces, 36)
    inner = (points[:, :2] > 0.5).all(1) & (points[:, :2] < 4.5).all(1)
    assert (matrix @ points)[:36][inner] == pytest.approx(points[inner])


def test_halving_leaves_no_long_edge_and_no_other_surface():
    box = trimesh.creation.box((10.0, 7.0, 3.0))
    points, faces = np.array(box.vertices), box.faces.astype(np.int32)
    while True:
        matrix, halved = halving_matrix(points, faces, 2.5)
        if len(halved) == len(faces):
            break
        points, faces = matrix @ points, halved
    fine = trimesh.Trimesh(points, faces, process=False)
    assert fine.edges_unique_length.max() <= 2.5
    assert fine.is_watertight
    assert fine.is_winding_consistent
    assert fine.volume == pytest.approx(210.0)
    assert fine.area == pytest.approx(box.area)


def test_short_edges_are_left_alone():
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    matrix, faces = halving_matrix(np.array(box.vertices), box.faces.astype(np.int32), 2.0)
    assert (matrix != scipy.sparse.identity(8)).nnz == 0
    assert faces.tolist() == box.faces.tolist()
