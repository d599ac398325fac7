"""The z-buffer and the silhouette against shapes whose picture is known."""

import numpy as np
import pytest

from fabcraft.geometry.raster import rasterize, silhouette_mask


def square(low, high, depth):
    corners = np.array(
        [[low, low, depth], [high, low, depth], [high, high, depth], [low, high, depth]], float
    )
    return corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def disc(centre, radius, sides=400):
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    ring = np.stack([centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)], 1)
    after = np.roll(np.arange(sides), -1)
    return np.vstack([centre, ring]), np.stack([np.zeros(sides, int), 1 + np.arange(sides), 1 + after], 1)


def test_a_square_covers_exactly_its_pixels():
    vertices, faces = square(2, 7, 1.5)
    seen = rasterize(vertices, faces, 10, 9)
    expected = np.zeros((9, 10), bool)
    expected[2:7, 2:7] = True
    assert ((seen.face_id >= 0) == expected).all()
    assert np.allclose(seen.depth[expected], 1.5)
    assert np.isinf(seen.depth[~expected]).all()


def test_a_centre_on_the_border_belongs_to_the_face_below_or_to_the_right():
    vertices, faces = square(0.5, 8.5, 0.0)
    face_id = rasterize(vertices, faces, 9, 9).face_id
    expected = np.zeros((9, 9), bool)
    expected[:8, :8] = (
        True  # the top and the left border belong to the square, the bottom and the right do not
    )
    assert ((face_id >= 0) == expected).all()


def test_a_centre_is_covered_once_by_a_fan_through_pixel_centres():
    points, faces = disc((10.5, 10.5), 9.0, sides=16)
    points = np.round(points - 0.5) + 0.5
    vertices = np.column_stack([points, np.zeros(len(points))])
    hits = sum(
        (rasterize(vertices, face[None].astype(np.int32), 21, 21).face_id >= 0).astype(int) for face in faces
    )
    together = rasterize(vertices, faces.astype(np.int32), 21, 21).face_id >= 0
    assert hits.max() == 1
    assert ((hits == 1) == together).all()


def test_the_nearer_face_is_seen_whatever_the_order_and_the_winding():
    near, faces = square(3, 6, 1.0)
    far, _ = square(1, 9, 2.0)
    vertices = np.vstack([far, near])
    both = np.vstack([faces, faces[:, ::-1] + 4])
    forward = rasterize(vertices, both, 10, 10)
    backward = rasterize(vertices, both[::-1], 10, 10)
    assert (forward.face_id[3:6, 3:6] >= 2).all()
    assert np.array_equal(forward.depth, backward.depth)
    assert forward.depth[4, 4] == pytest.approx(1.0)
    assert forward.depth[1, 1] == pytest.approx(2.0)


def test_barycentric_weights_give_back_the_pixel_centre_and_the_depth():
    rng = np.random.default_rng(0)
    vertices = rng.uniform(0, 60, (90, 3))
    faces = rng.permutation(90).reshape(30, 3).astype(np.int32)
    seen = rasterize(vertices, faces, 60, 50)
    row, col = np.nonzero(seen.face_id >= 0)
    points = np.einsum("nc,nci->ni", seen.barycentric[row, col], vertices[faces[seen.face_id[row, col]]])
    assert np.allclose(points, np.stack([col + 0.5, row + 0.5, seen.depth[row, col]], 1), atol=1e-4)


def test_the_z_buffer_agrees_with_a_plain_loop():
    rng = np.random.default_rng(1)
    vertices = rng.uniform(-10, 50, (60, 3))
    faces = rng.permutation(60).reshape(20, 3).astype(np.int32)
    seen = rasterize(vertices, faces, 40, 40)
    centres = np.stack(np.meshgrid(np.arange(40) + 0.5, np.arange(40) + 0.5), -1)
    nearest, best = np.full((40, 40), np.inf), np.full((40, 40), -1)
    for index, (a, b, c) in enumerate(vertices[faces]):
        weights = np.linalg.solve(np.stack([b - a, c - a], 1)[:2], (centres - a[:2])[..., None])[..., 0]
        inside = (weights >= 0).all(-1) & (weights.sum(-1) <= 1)
        depth = a[2] + weights @ np.array([b[2] - a[2], c[2] - a[2]])
        better = inside & (depth < nearest)
        nearest[better], best[better] = depth[better], index
    assert (seen.face_id == best).all()


@pytest.mark.parametrize("spoil", [np.nan, np.inf, 1e300])
def test_faces_out_of_reach_are_skipped(spoil):
    vertices, faces = square(2, 7, 1.0)
    vertices[3, 0] = spoil
    face_id = rasterize(vertices, faces, 10, 10).face_id
    assert set(np.unique(face_id)) <= {-1, 0, 1}
    assert (face_id == 0).any()


def test_no_faces_give_an_empty_picture():
    seen = rasterize(np.zeros((0, 3)), np.zeros((0, 3), np.int32), 5, 4)
    assert seen.face_id.shape == (4, 5)
    assert (seen.face_id == -1).all()


def test_the_silhouette_of_a_disc_has_its_area():
    points, faces = disc((50.3, 49.1), 37.0)
    mask = silhouette_mask(points, faces, 100, 100)
    assert mask.dtype == np.float32
    assert mask.sum() == pytest.approx(np.pi * 37**2, rel=1e-3)
    assert mask.min() == 0 and mask.max() == 1


def test_overlapping_triangles_count_once():
    vertices, faces = square(2, 7, 0.0)
    mask = silhouette_mask(vertices[:, :2], np.vstack([faces, faces, faces[:, ::-1]]), 10, 10)
    assert mask.sum() == pytest.approx(25.0)


def test_half_covered_pixels_are_half():
    corners = np.array([[2.5, 2.0], [6.0, 2.0], [6.0, 5.0], [2.5, 5.0]])
    mask = silhouette_mask(corners, np.array([[0, 1, 2], [0, 2, 3]]), 8, 8)
    assert np.allclose(mask[2:5, 2], 0.5)
    assert np.allclose(mask[2:5, 3:6], 1.0)
