import numpy as np
import pytest

from fabcraft.geometry.contour import level_contours, resample, signed_area, signed_distance_image, smooth
from fabcraft.geometry.triangulate import triangulate


def circle(radius, centre=(0.0, 0.0), count=200):
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.stack([np.cos(angle), np.sin(angle)], 1) * radius + centre


def star(points=5, outer=40.0, inner=18.0):
    angle = np.linspace(0, 2 * np.pi, 2 * points, endpoint=False)
    radius = np.where(np.arange(2 * points) % 2, inner, outer)
    corners = np.stack([np.sin(angle), np.cos(angle)], 1) * radius[:, None]
    return np.concatenate(
        [np.linspace(a, b, 30, endpoint=False) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]
    )


def areas(mesh):
    a, b, c = mesh.points[mesh.faces].transpose(1, 0, 2)
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


@pytest.mark.parametrize(
    "loops", [[circle(30)], [star()], [circle(40), circle(8, (-15, 5)), circle(8, (15, 5))]]
)
def test_the_faces_fill_the_region_once_and_face_up(loops):
    mesh = triangulate(loops, 3.0)
    wanted = abs(signed_area(loops[0])) - sum(abs(signed_area(loop)) for loop in loops[1:])
    assert areas(mesh).min() > 0
    assert areas(mesh).sum() == pytest.approx(wanted, rel=0.01)
    euler = (
        len(mesh.points)
        - len(np.unique(np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), 1), axis=0))
        + len(mesh.faces)
    )
    assert euler == 2 - len(loops)


def test_triangles_are_nearly_equilateral():
    mesh = triangulate([circle(40)], 3.0)
    corners = mesh.points[mesh.faces]
    sides = np.linalg.norm(corners - np.roll(corners, 1, 1), axis=2)
    quality = 4 * np.sqrt(3) * areas(mesh) / (sides**2).sum(1)
    assert np.median(quality) > 0.95 and quality.min() > 0.4
    assert np.median(sides) == pytest.approx(3.0, rel=0.12)


def test_a_star_keeps_its_tips():
    mesh = triangulate([star()], 3.0)
    assert mesh.points[:, 1].max() == pytest.approx(40.0, abs=0.3)


def test_loops_name_the_boundary_in_order():
    mesh = triangulate([circle(40), circle(10)], 3.0)
    assert [round(abs(signed_area(mesh.points[loop])) ** 0.5) for loop in mesh.loops] == [71, 18]


def test_smoothing_removes_ripple_and_keeps_the_radius_and_a_tip():
    angle = np.linspace(0, 2 * np.pi, 800, endpoint=False)
    rippled = circle(50, count=800) * (1 + 0.01 * np.sin(90 * angle))[:, None]
    radius = np.linalg.norm(smooth(rippled, 2.5), axis=1)
    assert np.ptp(radius) < 0.25 and radius.mean() == pytest.approx(50.0, abs=0.1)
    assert smooth(star(), 1.5, corner_reach=4.0)[:, 1].max() > 39.0


def test_resampling_is_even_and_keeps_corners():
    square = np.array([[0.0, 0], [10, 0], [10, 10], [0, 10]])
    dense = np.concatenate(
        [np.linspace(a, b, 50, endpoint=False) for a, b in zip(square, np.roll(square, -1, 0), strict=True)]
    )
    points = resample(dense, 1.7, corner_reach=1.0)
    assert all(np.linalg.norm(points - corner, axis=1).min() < 1e-9 for corner in square)


def test_a_level_set_of_the_distance_is_the_offset_circle():
    rows, columns = np.mgrid[:200, :200] + 0.5
    mask = np.hypot(columns - 100, rows - 100) < 80
    contour = level_contours(signed_distance_image(mask, 0.5), 5.0, soften=1.0)[0]
    np.testing.assert_allclose(np.linalg.norm(contour - 100, axis=1), 70.0, atol=0.7)
