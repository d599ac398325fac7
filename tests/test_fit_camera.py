"""Cameras: a plane's front view is the plane itself, focal lengths are never rounded, nothing is mirrored."""

import numpy as np
import pytest
import torch

from fabcraft.errors import InputError
from fabcraft.fit.camera import Camera, bank, front, orbit, stack
from fabcraft.geometry.plane import Plane


def test_the_front_camera_agrees_with_its_plane():
    plane = Plane(left_mm=-83.0, top_mm=121.0, pixel_mm=0.7, width=230, height=310)
    points = np.random.default_rng(0).uniform(-120, 120, (50, 3))
    seen = front(plane).project(torch.tensor(points)).numpy()
    assert np.allclose(seen[:, :2], plane.to_pixels(points[:, [0, 2]]), atol=1e-10)
    assert np.allclose(seen[:, 2], points[:, 1], atol=1e-12)


@pytest.mark.parametrize(("fov_deg", "focal"), [(30.0, 3.732051), (60.0, 1.732051), (90.0, 1.0)])
def test_the_focal_length_is_not_rounded(fov_deg, focal):
    camera = orbit((0.0, 0.0, 0.0), 100.0, 0.0, 0.0, fov_deg, 200)
    assert camera.focal == pytest.approx(focal, abs=1e-6)
    # the upper edge of the picture is seen at half the opening angle
    edge = torch.tensor([[0.0, 0.0, 100.0 * np.tan(np.radians(fov_deg / 2))]], dtype=torch.float64)
    assert torch.allclose(camera.project(edge)[0], torch.tensor([100.0, 0.0, 100.0], dtype=torch.float64))


def test_orbit_looks_at_its_centre_from_its_radius():
    centre = (12.0, -7.0, 40.0)
    for azimuth_deg, elevation_deg in [(0.0, 0.0), (90.0, 30.0), (200.0, -45.0), (10.0, 90.0)]:
        camera = orbit(centre, 300.0, azimuth_deg, elevation_deg, 45.0, 128)
        seen = camera.project(torch.tensor([centre], dtype=torch.float64))[0]
        assert torch.allclose(seen, torch.tensor([64.0, 64.0, 300.0], dtype=torch.float64))
        assert np.linalg.det(camera.view[:3, :3]) == pytest.approx(1.0)


def test_azimuth_zero_sees_the_face_unmirrored_and_azimuth_ninety_the_left_side():
    points = torch.tensor([[10.0, 0.0, 0.0], [0.0, 0.0, 10.0], [0.0, -10.0, 0.0]], dtype=torch.float64)
    left, up, nose = orbit((0.0, 0.0, 0.0), 100.0, 0.0, 0.0, 60.0, 100).project(points)
    assert left[0] > 50 and up[1] < 50 and nose[2] == pytest.approx(90.0)
    left, up, nose = orbit((0.0, 0.0, 0.0), 100.0, 90.0, 0.0, 60.0, 100).project(points)
    assert left[2] == pytest.approx(90.0) and up[1] < 50 and nose[0] < 50


def test_a_higher_camera_sees_more_of_the_top():
    top = torch.tensor([[0.0, 0.0, 10.0]], dtype=torch.float64)
    depths = [orbit((0.0, 0.0, 0.0), 100.0, 0.0, e, 60.0, 100).project(top)[0, 2] for e in (0.0, 30.0, 60.0)]
    assert depths[0] > depths[1] > depths[2]


@pytest.mark.parametrize(
    "camera", [front(Plane(-50.0, 50.0, 1.0, 100, 80)), orbit((0.0, 0.0, 0.0), 150.0, 33.0, 12.0)]
)
def test_projection_has_the_derivative_of_finite_differences(camera):
    points = torch.randn(4, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0)) * 20
    assert torch.autograd.gradcheck(camera.project, (points.requires_grad_(),))


def test_projection_keeps_the_dtype_and_is_finite_behind_the_camera():
    camera = orbit((0.0, 0.0, 0.0), 100.0, 0.0, 0.0)
    points = torch.tensor([[0.0, -100.0, 0.0], [3.0, -200.0, 5.0]], requires_grad=True)
    seen = camera.project(points)
    assert seen.dtype == torch.float32
    seen.sum().backward()
    assert torch.isfinite(seen).all() and torch.isfinite(points.grad).all()


def test_stacked_cameras_project_as_each_alone():
    cameras = bank(5, (1.0, 2.0, 3.0), 80.0, seed=4)
    points = torch.randn(9, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1)) * 30
    together = stack(cameras).project(points)
    assert torch.allclose(together, torch.stack([camera.project(points) for camera in cameras]))


def test_the_bank_is_fixed_by_its_seed_and_holds_the_bounding_sphere():
    first, again, other = (bank(20, (0.0, 0.0, 10.0), 70.0, seed=seed) for seed in (3, 3, 5))
    assert all(np.array_equal(a.view, b.view) for a, b in zip(first, again, strict=True))
    assert not np.array_equal(first[0].view, other[0].view)
    ball = torch.randn(500, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(2))
    ball = 70.0 * ball / ball.norm(dim=1, keepdim=True) + torch.tensor([0.0, 0.0, 10.0])
    seen = stack(first).project(ball)
    assert (seen[..., :2] > 0).all() and (seen[..., :2] < 224).all() and (seen[..., 2] > 0).all()
    below = [camera.view[2, 2] > 0 for camera in first]  # looking upwards
    assert sum(below) == 4


def test_cameras_that_cannot_be_drawn_together_are_refused():
    one = orbit((0.0, 0.0, 0.0), 100.0, 0.0, 0.0, 60.0, 100)
    with pytest.raises(InputError):
        stack([one, orbit((0.0, 0.0, 0.0), 100.0, 0.0, 0.0, 60.0, 128)])
    with pytest.raises(InputError):
        stack([])


def test_impossible_cameras_are_refused():
    with pytest.raises(InputError):
        orbit((0.0, 0.0, 0.0), 0.0, 0.0, 0.0)
    with pytest.raises(InputError):
        orbit((0.0, 0.0, 0.0), 10.0, 0.0, 0.0, 180.0)
    with pytest.raises(InputError):
        Camera(np.diag([1.0, 1.0, -1.0, 1.0]), 1.0, True, 10, 10)
