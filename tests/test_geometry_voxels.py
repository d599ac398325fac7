"""Surfaces from fields whose surface is known."""

import numpy as np
import pytest

from fabcraft.errors import SolidError
from fabcraft.geometry.voxels import Grid, isosurface, narrow_band, samples

BOX = np.array([[-10.0] * 3, [10.0] * 3])


def seed(grid, points, reach):
    marked = np.zeros(grid.shape, bool)
    grid.near(np.atleast_2d(points).astype(float), reach, marked)
    return marked


def sphere(points):
    return np.linalg.norm(points, axis=1) - 8.0


def test_a_sphere_comes_back_with_its_volume_and_outward_faces():
    grid = Grid.around(BOX, 0.5, 1.0)
    mesh = isosurface(grid, narrow_band(grid, np.ones(grid.shape, bool), sphere))
    assert mesh.volume_mm3 == pytest.approx(4 / 3 * np.pi * 8**3, rel=0.005)
    assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - 8).max() < 0.01


def test_the_band_follows_the_whole_surface_from_one_seed():
    grid = Grid.around(BOX, 0.5, 1.0)
    marked = seed(grid, [8.0, 0, 0], 1.2)
    assert marked.sum() < 400
    found = isosurface(grid, narrow_band(grid, marked, sphere))
    whole = isosurface(grid, narrow_band(grid, np.ones(grid.shape, bool), sphere))
    assert marked.mean() < 0.25
    assert np.array_equal(found.vertices, whole.vertices) and np.array_equal(found.faces, whole.faces)


def test_a_hollow_ball_keeps_its_cavity():
    grid = Grid.around(BOX, 0.5, 1.0)

    def hollow(points):
        radius = np.linalg.norm(points, axis=1)
        return np.maximum(radius - 8.0, 4.0 - radius)

    marked = seed(grid, [[8.0, 0, 0], [0, 4.0, 0]], 1.2)
    mesh = isosurface(grid, narrow_band(grid, marked, hollow))
    assert mesh.volume_mm3 == pytest.approx(4 / 3 * np.pi * (8**3 - 4**3), rel=0.01)


def test_a_face_on_round_coordinates_makes_no_triangle_without_area():
    grid = Grid.around(BOX, 1.0, 1.0)
    mesh = isosurface(grid, narrow_band(grid, np.ones(grid.shape, bool), lambda p: np.abs(p).max(1) - 5.5))
    assert mesh.face_areas.min() > 0
    assert np.abs(mesh.size_mm - 11.0).max() < 0.01


def test_near_marks_every_node_in_reach_also_at_the_border():
    grid = Grid.around(BOX, 0.7, 0.0)
    nodes = grid.positions(np.arange(grid.size))
    for point in (np.array([0.1, 0.2, 0.3]), grid.positions(np.array([0]))[0]):
        marked = seed(grid, point, 2.0).reshape(-1)
        distance = np.linalg.norm(nodes - point, axis=1)
        assert marked[distance <= 2.0].all()
        assert not marked[distance > 2.0 + 2 * 0.87 * 0.7].any()


def test_samples_leave_no_gap_above_their_spacing():
    corners = np.array([[[0.0, 0, 0], [7, 0, 0], [0, 5, 0]], [[0.0, 0, 1], [0.3, 0, 1], [0, 0.3, 1]]])
    points, owners = samples(corners, 0.5)
    assert set(owners.tolist()) == {0, 1}
    rng = np.random.default_rng(1)
    weights = rng.dirichlet([1, 1, 1], 500)
    inside = weights @ corners[0]
    gap = np.linalg.norm(inside[:, None] - points[None], axis=2).min(1)
    assert gap.max() <= 0.5


def test_a_grid_that_does_not_fit_in_memory_is_refused_with_a_cell_that_would():
    with pytest.raises(SolidError, match=r"400 million cells") as caught:
        Grid.around(np.array([[0.0] * 3, [1000.0] * 3]), 0.5, 0.0)
    assert "mm or more" in caught.value.next_step


def test_an_empty_field_is_refused():
    grid = Grid.around(BOX, 2.0, 0.0)
    with pytest.raises(SolidError, match="empty"):
        isosurface(grid, np.ones(grid.shape, np.float32))


def test_a_field_with_a_hole_in_its_numbers_is_refused():
    grid = Grid.around(BOX, 2.0, 0.0)
    with pytest.raises(SolidError, match="not a number"):
        narrow_band(grid, np.ones(grid.shape, bool), lambda p: np.full(len(p), np.nan))
