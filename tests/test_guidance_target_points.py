import numpy as np
import pytest
import torch
from worn import ball

from fabcraft.geometry.frame import Frame
from fabcraft.geometry.sampling import area_samples, corner_weights
from fabcraft.guidance.guidance import Views
from fabcraft.guidance.target_points import TargetPoints

BALL = ball(20.0, 3)
FRAME = Frame.of(BALL)


def views(mesh, step=0):
    points = torch.from_numpy(FRAME.inside(mesh.vertices)).double().requires_grad_(True)
    none = np.zeros(0)
    return Views(
        step=step, steps=10, camera=np.zeros(0, np.int64), azimuth_deg=none, elevation_deg=none,
        positions=points.float(), faces=torch.from_numpy(mesh.faces.astype(np.int64)),
        pixels=torch.zeros(0, len(points), 2), visible=torch.zeros(0, len(points), dtype=torch.bool),
    ), points  # fmt: skip


def chamfer(guidance, mesh, step=0):
    seen, points = views(mesh, step)
    value = guidance.losses(seen)["chamfer"]
    value.backward()
    return float(value.detach()), points.grad


def test_points_that_coincide_are_at_distance_exactly_zero():
    seen, _ = views(BALL)
    own = TargetPoints(np.zeros((1, 3)), samples=50)._samples(seen).detach().double().numpy()
    value, slope = chamfer(TargetPoints(own, samples=50), BALL)
    assert value == 0.0 and not slope.any()


def test_a_ball_is_a_millimetre_from_a_larger_one_both_ways():
    larger = BALL.with_vertices(BALL.vertices * 1.05)
    value, slope = chamfer(TargetPoints.of(larger, BALL, count=8000), BALL)
    spacing = 0.02 * 8.0  # of samples, in the frame, about: what a nearest sample is off sideways
    assert np.sqrt(value / 2.0) == pytest.approx(0.05, abs=spacing**2)
    assert ((-slope * torch.from_numpy(BALL.vertices.copy())).sum(1) >= -1e-4).float().mean() > 0.95


def test_targets_on_one_side_pull_nothing_on_the_other():
    front = BALL.submesh(BALL.corners.mean(1)[:, 1] < -8.0)
    pushed = front.with_vertices(front.vertices * 1.2)
    _, slope = chamfer(TargetPoints.of(pushed, BALL, sides="targets"), BALL)
    assert not slope[BALL.vertices[:, 1] > 12.0].any() and slope[BALL.vertices[:, 1] < -15.0].any()
    _, both = chamfer(TargetPoints.of(pushed, BALL), BALL)
    assert both[BALL.vertices[:, 1] > 12.0].any()


def test_a_trimmed_side_leaves_out_the_stray_points():
    own = np.concatenate([FRAME.inside(BALL.vertices), np.full((10, 3), 5.0)])
    plain, _ = chamfer(TargetPoints(own, sides="targets"), BALL)
    trimmed, _ = chamfer(TargetPoints(own, sides="targets", trim=0.95), BALL)
    assert plain > 0.5 and trimmed < 0.01


def test_every_step_draws_other_places_and_the_same_step_the_same():
    guidance = TargetPoints(np.zeros((1, 3)))
    draws = [guidance._samples(views(BALL, step)[0]).detach().numpy() for step in (0, 0, 1)]
    assert draws[0].tobytes() == draws[1].tobytes() and np.abs(draws[0] - draws[2]).max() > 0.01


def test_samples_are_even_by_area_and_their_weights_give_them_back():
    faces, places = area_samples(BALL.face_areas, 5000, np.random.default_rng(0))
    assert (
        np.abs(np.bincount(faces, minlength=len(BALL.faces)) / 5000 - BALL.face_areas / BALL.area_mm2).max()
        < 5e-4
    )
    points = (places[:, :, None] * BALL.corners[faces]).sum(1)
    np.testing.assert_allclose(corner_weights(points, BALL.corners[faces]), places, atol=1e-9)


def test_a_face_without_area_has_a_nearest_place_too():
    line = np.array([[[0.0, 0, 0], [1, 0, 0], [4, 0, 0]]])
    np.testing.assert_allclose(corner_weights(np.array([[3.0, 1, 0]]), line) @ line[0], [[3.0, 0, 0]])
    point = np.zeros((1, 3, 3))
    assert corner_weights(np.ones((1, 3)), point).sum() == pytest.approx(1.0)
