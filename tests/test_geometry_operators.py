import numpy as np
import pytest

from fabcraft.errors import InputError
from fabcraft.geometry.operators import boundary_loops, edge_faces, face_frames, gradient, laplacian


def grid(n=5):
    x, y = np.meshgrid(np.arange(n, dtype=float), np.arange(n, dtype=float))
    vertices = np.stack([x.ravel(), y.ravel(), 0.1 * x.ravel() ** 2], 1)
    index = np.arange(n * n).reshape(n, n)
    a, b, c, d = (
        index[:-1, :-1].ravel(),
        index[:-1, 1:].ravel(),
        index[1:, 1:].ravel(),
        index[1:, :-1].ravel(),
    )
    return vertices, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def test_gradient_is_exact_on_a_linear_function_projected_to_the_faces():
    vertices, faces = grid()
    slope = np.array([0.3, -1.2, 0.7])
    matrix, frames, _ = gradient(vertices, faces)
    found = np.einsum("fdk,fk->fd", frames, (matrix @ (vertices @ slope)).reshape(-1, 2))
    normals = np.cross(frames[:, :, 0], frames[:, :, 1])
    expected = slope - (normals @ slope)[:, None] * normals
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_laplacian_of_a_right_triangle_is_the_matrix_written_by_hand():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    expected = np.array([[1.0, -0.5, -0.5], [-0.5, 0.5, 0.0], [-0.5, 0.0, 0.5]])
    np.testing.assert_allclose(laplacian(vertices, np.array([[0, 1, 2]])).toarray(), expected, atol=1e-14)


def test_frames_are_orthonormal_and_areas_right():
    vertices, faces = grid()
    frames, areas = face_frames(vertices, faces)
    np.testing.assert_allclose(
        np.einsum("fdi,fdj->fij", frames, frames), np.tile(np.eye(2), (len(faces), 1, 1)), atol=1e-14
    )
    flat = vertices * [1, 1, 0]
    np.testing.assert_allclose(face_frames(flat, faces)[1], 0.5)
    assert (areas > 0.5).all()


def test_a_face_without_area_is_named():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    with pytest.raises(InputError, match="face 0"):
        face_frames(vertices, np.array([[0, 1, 2]]))


def test_edges_of_a_grid_obey_euler_and_the_boundary_is_one_loop():
    vertices, faces = grid()
    edges, pairs = edge_faces(faces)
    assert len(vertices) - len(edges) + len(faces) == 1
    assert (pairs[:, 1] == -1).sum() == 16
    loops = boundary_loops(faces)
    assert len(loops) == 1 and len(loops[0]) == 16
    loop = vertices[loops[0]]
    assert 0.5 * np.sum(
        loop[:, 0] * np.roll(loop[:, 1], -1) - np.roll(loop[:, 0], -1) * loop[:, 1]
    ) == pytest.approx(16.0)


def test_an_edge_with_three_faces_is_refused():
    with pytest.raises(InputError, match="more than two faces"):
        edge_faces(np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]]))
