import numpy as np
import pytest
import torch

from fabcraft.fit.losses import (
    chamfer_loss,
    collapse_loss,
    contact_loss,
    image_loss,
    jacobian_loss,
    normal_consistency_loss,
    penetration_loss,
    point_loss,
    rim_loss,
    singular_values,
    smoothness_loss,
)
from fabcraft.fit.neighbours import Neighbours

GENERATOR = torch.Generator().manual_seed(3)


def random(*shape):
    return torch.randn(*shape, dtype=torch.float64, generator=GENERATOR)


@pytest.mark.parametrize("dimension", [2, 3])
def test_singular_values_are_those_of_the_matrix(dimension):
    field = random(50, dimension, 2)
    first, second = singular_values(field)
    expected = np.linalg.svd(field.numpy(), compute_uv=False)
    np.testing.assert_allclose(first, expected[:, 0], atol=1e-5)
    np.testing.assert_allclose(second.abs(), expected[:, 1], atol=1e-4)
    if dimension == 2:
        np.testing.assert_array_equal(np.sign(second.numpy()), np.sign(np.linalg.det(field.numpy())))


@pytest.mark.parametrize("dimension", [2, 3])
def test_singular_values_have_a_finite_derivative_at_the_identity(dimension):
    field = (
        torch.eye(3, dtype=torch.float64)[:dimension, :2].expand(4, dimension, 2).clone().requires_grad_(True)
    )
    first, second = singular_values(field)
    (first.sum() + second.sum()).backward()
    assert torch.isfinite(field.grad).all()


def test_doing_nothing_costs_nothing():
    rest = torch.eye(3)[:, :2].expand(5, 3, 2)
    areas = torch.arange(1.0, 6.0)
    assert float(jacobian_loss(rest, rest, areas)) == 0.0
    assert float(collapse_loss(rest, areas)) == 0.0
    neighbours = Neighbours.paired(np.array([[0, 1], [2, 4]]), 5)
    columns = torch.eye(3)[:, :2].expand(5, 3, 2)
    assert float(smoothness_loss(columns, columns, neighbours)) == 0.0


def test_the_jacobian_loss_of_a_uniform_scaling_is_known_and_area_weighted():
    rest = torch.eye(3)[:, :2].expand(2, 3, 2)
    field = torch.stack([1.5 * rest[0], rest[1]])
    assert float(jacobian_loss(field, rest, torch.tensor([3.0, 1.0]))) == pytest.approx(0.75 * 2 * 0.25)


def test_collapse_punishes_turned_and_torn_faces_only():
    areas = torch.ones(3)
    turned = torch.tensor([[[1.0, 0.0], [0.0, -1.0]]]).expand(3, 2, 2)
    torn = torch.tensor([[[5.0, 0.0], [0.0, 1.0]]]).expand(3, 2, 2)
    assert float(collapse_loss(turned, areas)) == pytest.approx(1.35**2, rel=1e-4)
    assert float(collapse_loss(torn, areas)) == pytest.approx(1.0, rel=1e-4)


def test_penetration_is_a_hinge_on_the_clearance():
    clearance, areas = torch.full((3,), 0.2), torch.tensor([1.0, 1.0, 2.0])
    signed = torch.tensor([0.3, 0.2, -0.1], requires_grad=True)
    loss = penetration_loss(signed, clearance, areas)
    assert float(loss.detach()) == pytest.approx(0.5 * 0.3**2)
    loss.backward()
    assert signed.grad[0] == 0 and signed.grad[1] == 0 and signed.grad[2] < 0  # outwards


def test_contact_is_least_at_the_wanted_gap_and_robust_far_away():
    gap = torch.zeros(1)
    assert float(contact_loss(torch.zeros(1), gap)) == 0.0
    near, far = (
        float(contact_loss(torch.full((1,), 0.05), gap)),
        float(contact_loss(torch.full((1,), 1.05), gap)),
    )
    assert near == pytest.approx(0.05**2)
    assert far - near == pytest.approx(2 * 0.05 * 1.0, rel=1e-5)


def test_an_image_loss_counts_only_where_its_weight_is():
    image, target = torch.zeros(2, 2), torch.tensor([[1.0, 3.0], [5.0, 7.0]])
    assert float(image_loss(image, target)) == 4.0
    assert float(image_loss(image, target, torch.tensor([[1.0, 0.0], [0.0, 1.0]]))) == 4.0
    assert float(image_loss(torch.zeros(1, 2, 3), torch.ones(1, 2, 3), torch.ones(1, 2))) == 1.0


def test_point_and_chamfer_losses_of_a_shifted_set():
    points = random(20, 3)
    shifted = points + torch.tensor([0.0, 3.0, 4.0])
    order = torch.arange(20)
    assert float(point_loss(points, shifted)) == pytest.approx(25.0)
    assert float(chamfer_loss(points, shifted, order)) == pytest.approx(25.0)
    assert float(chamfer_loss(points, shifted, order, order)) == pytest.approx(50.0)


def test_normals_of_a_flat_sheet_agree_and_those_of_a_fold_do_not():
    flat = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=torch.float64)
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    neighbours = Neighbours.of(faces.numpy())
    assert float(normal_consistency_loss(flat, faces, neighbours)) == pytest.approx(0.0, abs=1e-12)
    folded = flat.clone()
    folded[3] = torch.tensor([0.5, 0.5, 0.5**0.5])
    assert float(normal_consistency_loss(folded, faces, neighbours)) == pytest.approx(1.0, abs=1e-6)


def test_ripple_along_a_rim_costs_more_than_a_circle():
    angle = torch.linspace(0, 2 * torch.pi, 61)[:-1]
    circle = torch.stack([angle.cos(), angle.sin()], 1)
    rippled = circle * (1 + 0.02 * (torch.arange(60) % 2))[:, None]
    loops = (torch.arange(60),)
    assert float(rim_loss(rippled, loops)) > 3 * float(rim_loss(circle, loops))


@pytest.mark.parametrize("name", ["jacobian", "collapse", "smoothness"])
def test_gradients_match_finite_differences(name):
    rest, areas = torch.eye(3, dtype=torch.float64)[:, :2].expand(6, 3, 2), random(6).abs() + 0.1
    neighbours, frames = Neighbours.paired(np.array([[0, 1], [1, 2], [4, 5]]), 6), random(6, 3, 2)
    functions = {
        "jacobian": lambda x: jacobian_loss(x, rest, areas),
        "collapse": lambda x: collapse_loss(x, areas, 0.9, 1.1),
        "smoothness": lambda x: smoothness_loss(x, frames, neighbours),
    }
    field = random(6, 3, 2).requires_grad_(True)
    assert torch.autograd.gradcheck(functions[name], (field,))
