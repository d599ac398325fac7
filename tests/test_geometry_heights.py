import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from fabcraft.geometry.heights import front_heights, lifted_over, raised, smoothest_over
from fabcraft.geometry.plane import Plane
from fabcraft.mesh import Mesh, concatenate

GRID = Plane(-50.0, 50.0, 1.0, 100, 100)
X, Z = GRID.centres()
AWAY = np.hypot(X, Z)


def ball(radius, centre=(0.0, 0.0, 0.0)):
    sphere = trimesh.creation.icosphere(5, radius)
    return Mesh(sphere.vertices + np.array(centre), sphere.faces.astype(np.int32))


def cap(radius, plane=GRID):
    """Front heights of a sphere about the origin."""
    x, z = plane.centres()
    square = radius**2 - x**2 - z**2
    return np.where(square > 0, np.sqrt(np.maximum(square, 0.0)), -np.inf)


def test_the_front_of_a_sphere_is_its_closed_form():
    heights = front_heights(ball(30.0), GRID)
    inner = AWAY < 27.0
    assert heights[inner] == pytest.approx(cap(30.0)[inner], abs=0.05)
    assert np.isneginf(heights[AWAY > 30.0]).all()


def test_of_two_surfaces_the_nearer_one_counts():
    both = concatenate([ball(30.0), ball(10.0, (0.0, -40.0, 0.0))])
    heights = front_heights(both, GRID)
    assert heights.max() == pytest.approx(50.0, abs=0.1)
    assert heights[(AWAY > 12.0) & (AWAY < 25.0)].max() < 30.0


def test_the_picture_is_not_mirrored():
    heights = front_heights(ball(5.0, (20.0, 0.0, 30.0)), GRID)
    rows, columns = np.nonzero(np.isfinite(heights))
    assert columns.mean() == pytest.approx(69.5, abs=0.1)  # x = +20: right
    assert rows.mean() == pytest.approx(19.5, abs=0.1)  # z = +30: up


def test_a_raised_sphere_is_a_bigger_sphere():
    fine = Plane(-50.0, 50.0, 0.5, 200, 200)
    x, z = fine.centres()
    inner = np.hypot(x, z) < 32.0
    grown = raised(cap(40.0, fine), 5.0, 0.5)
    assert grown[inner] == pytest.approx(cap(45.0, fine)[inner], abs=0.06)
    assert (grown[inner] <= cap(45.0, fine)[inner] + 1e-9).all()


def test_a_raised_plane_is_a_plane_and_a_raised_point_a_ball():
    assert raised(np.full((20, 20), 3.0), 2.5, 1.0) == pytest.approx(np.full((20, 20), 5.5))
    point = np.full((100, 100), -np.inf)
    point[50, 50] = 0.0
    grown = raised(point, 10.0, 1.0)
    away = np.hypot(*(np.mgrid[:100, :100] - 50.0))
    assert grown[away < 10] == pytest.approx(np.sqrt(100.0 - away[away < 10] ** 2))
    assert np.isneginf(grown[away > 10]).all()


def test_nothing_is_raised_by_nothing():
    heights = cap(20.0)
    assert (raised(heights, 0.0, 1.0) == heights).all()
    assert np.isneginf(raised(np.full((9, 9), -np.inf), 3.0, 1.0)).all()


def test_the_smoothest_sheet_at_a_plane_is_the_plane():
    nothing, everywhere = np.full((40, 40), -np.inf), np.ones((40, 40))
    level = smoothest_over(nothing, np.full((40, 40), 7.0), everywhere, 1.0, 5.0, 30.0)
    assert level == pytest.approx(np.full((40, 40), 7.0), abs=1e-9)
    slope = 0.3 * np.mgrid[:60, :60][1] + 2.0
    tilted = smoothest_over(np.full((60, 60), -np.inf), slope, np.ones((60, 60)), 1.0, 2.0, 1e4)
    assert tilted[15:-15, 15:-15] == pytest.approx(slope[15:-15, 15:-15], abs=0.01)


def test_the_smoothest_sheet_goes_on_level_where_nothing_is_wanted():
    wanted = np.full((40, 60), -np.inf)
    wanted[:, :20] = 4.0
    assert smoothest_over(
        np.full((40, 60), -np.inf), wanted, np.ones((40, 60)), 1.0, 5.0, 30.0
    ) == pytest.approx(np.full((40, 60), 4.0), abs=1e-6)


def test_the_smoothest_sheet_keeps_in_front_of_an_obstacle_and_bridges_its_edges():
    obstacle = np.where(AWAY < 8.0, 10.0, -np.inf)
    height = smoothest_over(obstacle, np.zeros((100, 100)), np.full((100, 100), 0.05), 1.0, 8.0, 60.0)
    assert (height[AWAY < 8.0] > 10.0 - 0.3).all()  # the give of a spring at a step of 10
    assert height.max() < 11.5
    assert np.abs(height[AWAY > 45.0]).max() < 2.5
    assert np.abs(np.diff(height, axis=0)).max() < 2.0  # no step, where the obstacle has one of 10


def test_a_narrow_pit_in_what_is_wanted_is_bridged():
    wanted = np.where(np.abs(X) < 2.0, -5.0, 0.0)
    height = smoothest_over(np.full(X.shape, -np.inf), wanted, np.ones(X.shape), 1.0, 15.0, 60.0)
    assert height.min() > -1.5


def test_a_sheet_that_is_clear_is_only_smoothed():
    height = np.full((30, 30), 2.0)
    assert lifted_over(height, np.full((30, 30), 1.0), 1.0, 4.0) == pytest.approx(height)
    assert lifted_over(height, np.full((30, 30), -np.inf), 1.0, 4.0) == pytest.approx(height)


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    pixel_mm=st.sampled_from([0.5, 1.0, 2.0]),
    blend_mm=st.floats(1.0, 8.0),
    share=st.floats(0.0, 1.0),
)
def test_a_lifted_sheet_is_nowhere_under_the_obstacle(seed, pixel_mm, blend_mm, share):
    rng = np.random.default_rng(seed)
    height = rng.normal(scale=5.0, size=(40, 50))
    obstacle = np.where(rng.uniform(size=(40, 50)) < share, rng.normal(scale=20.0, size=(40, 50)), -np.inf)
    assert (lifted_over(height, obstacle, pixel_mm, blend_mm) >= obstacle - 1e-9).all()


def test_the_lift_is_felt_only_near_the_obstacle():
    obstacle = np.full((100, 100), -np.inf)
    obstacle[50, 50] = 5.0
    lifted = lifted_over(np.zeros((100, 100)), obstacle, 1.0, 3.0)
    away = np.abs(np.mgrid[:100, :100] - 50).max(0)
    assert lifted[50, 50] == pytest.approx(5.0)
    assert (lifted[away > 9 + 13] == 0.0).all()  # a window of three sigma, and the disc around one
    assert lifted.max() == pytest.approx(5.0)
