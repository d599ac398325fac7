import numpy as np
import pytest
import torch
import trimesh

from fabcraft.fit.body_field import BodyField
from fabcraft.fit.settle import push_out
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.triangulate import triangulate
from fabcraft.mesh import Mesh


def ball(radius=30.0):
    shape = trimesh.creation.icosphere(5, radius)
    return SurfaceDistance(Mesh(np.array(shape.vertices), np.array(shape.faces, dtype=np.int32)))


def plate(y, half=20.0):
    square = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    flat = triangulate(
        [
            np.concatenate(
                [
                    np.linspace(a, b, 20, endpoint=False)
                    for a, b in zip(square, np.roll(square, -1, 0), strict=True)
                ]
            )
        ],
        3.0,
    )
    return Mesh(
        np.column_stack([flat.points[:, 0], np.full(len(flat.points), y), flat.points[:, 1]]), flat.faces
    )


def test_the_field_is_the_distance_to_the_ball_within_a_fraction_of_a_cell():
    field = BodyField.around(ball(), np.array([-20.0, -60.0, -20.0]), np.array([20.0, -20.0, 20.0]), 4.0)
    points = np.random.default_rng(0).uniform([-18, -55, -18], [18, -22, 18], (500, 3))
    found = field(torch.from_numpy(points).float()).numpy()
    # a chord of the cell lies above the distance by up to cell² (1/r + 1/r) / 8
    np.testing.assert_allclose(
        found, np.linalg.norm(points, axis=1) - 30.0, atol=4.0**2 * (2 / 22.0) / 8 + 0.03
    )


def test_the_fields_gradient_points_away_from_the_body():
    field = BodyField.around(ball(), np.array([-20.0, -60.0, -20.0]), np.array([20.0, -20.0, 20.0]), 4.0)
    points = torch.tensor([[1.0, -40.0, 2.0], [-7.0, -33.0, 5.0]], requires_grad=True)
    field(points).sum().backward()
    away = torch.nn.functional.normalize(points.detach(), dim=1)
    assert ((torch.nn.functional.normalize(points.grad, dim=1) * away).sum(1) > 0.98).all()


@pytest.mark.parametrize("y", [-31.0, -28.0, -24.0])
def test_a_plate_through_the_ball_is_pushed_clear_of_it(y):
    distance, sheet = ball(), plate(y)
    settled, pushed = push_out(sheet, distance, np.full(len(sheet.vertices), 2.0))
    centres = settled.vertices[settled.faces].mean(1)
    assert distance.signed(np.concatenate([settled.vertices, centres])).min() >= 2.0 - 0.03
    assert pushed == pytest.approx(2.0 + 30.0 + y, abs=0.15)
    assert (
        settled.face_normals[:, 1].min() < -0.5 or settled.face_normals[:, 1].max() < 0
    )  # nothing turned over


def test_a_sheet_that_is_clear_is_left_alone():
    sheet = plate(-40.0)
    settled, pushed = push_out(sheet, ball(), np.full(len(sheet.vertices), 2.0))
    np.testing.assert_array_equal(settled.vertices, sheet.vertices)
    assert pushed == 0.0
