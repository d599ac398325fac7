"""View consistency against features made by hand, and finite wherever there is nothing to compare."""

import numpy as np
import pytest
import torch
from torch.nn import functional

from fabcraft.guidance.consistency import consistency_loss, near_pairs, nearest_patch


def angles(*values: float) -> np.ndarray:
    return np.array(values, float)


def random(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(seed).standard_normal(shape))


def test_features_that_stay_with_their_vertex_cost_nothing():
    own = random(9, 5)
    patches = torch.stack([torch.from_numpy(np.random.default_rng(view).permutation(9)) for view in range(3)])
    features = torch.stack([own[torch.argsort(places)] * (view + 1) for view, places in enumerate(patches)])
    loss = consistency_loss(features.reshape(3, 3, 3, 5), patches, angles(0, 10, 350), angles(0, 0, 0))
    assert loss == pytest.approx(0.0, abs=1e-12)


def test_opposite_features_cost_two():
    feature = random(1, 2, 2, 4)
    patches = torch.arange(4).expand(2, 4)
    loss = consistency_loss(torch.cat([feature, -feature]), patches, angles(0, 1), angles(0, 0))
    assert loss == pytest.approx(2.0)


def test_the_loss_is_the_mean_over_vertices_seen_in_both_views_of_close_pairs():
    features = random(4, 3, 3, 6).requires_grad_()
    places = torch.from_numpy(np.random.default_rng(1).integers(-1, 9, (4, 50)))
    azimuth, elevation = angles(5, 359, 20, 100), angles(0, 10, 45, 0)
    loss = consistency_loss(features, places, azimuth, elevation)
    flat, found = functional.normalize(features.flatten(1, 2), dim=-1), []
    for first, second in [(0, 1)]:  # 20 is 35 degrees higher than 359's 10, and 45 than 5's 0
        for one, other in zip(places[first], places[second], strict=True):
            if one >= 0 and other >= 0:
                found.append(flat[first, one] @ flat[second, other])
    assert near_pairs(azimuth, elevation) == [(0, 1)]
    assert loss.item() == pytest.approx(1 - torch.stack(found).mean().item())
    loss.backward()
    assert features.grad[:2].abs().sum() > 0 and features.grad[2:].abs().sum() == 0


def test_angles_wrap_around_and_their_limits_are_20_and_30_degrees():
    level = angles(0, 0)
    assert near_pairs(angles(359, 1), level) == [(0, 1)]
    assert near_pairs(angles(-5, 714), level) == [(0, 1)]
    assert near_pairs(angles(0, 20), level) == [] and near_pairs(angles(0, 19.9), level) == [(0, 1)]
    assert near_pairs(level, angles(0, 30)) == [] and near_pairs(level, angles(-10, 19.9)) == [(0, 1)]


@pytest.mark.parametrize("count", [1, 2, 4])
@pytest.mark.parametrize("case", ["nothing visible", "views far apart", "all is well"])
def test_the_loss_and_its_gradient_are_finite_whatever_is_seen(count, case):
    features = random(count, 3, 3, 4).requires_grad_()
    patches = torch.full((count, 7), -1 if case == "nothing visible" else 4)
    azimuth = angles(*range(count)) * (90 if case == "views far apart" else 5)
    loss = consistency_loss(features, patches, azimuth, np.zeros(count))
    assert loss.ndim == 0 and torch.isfinite(loss) and loss.requires_grad
    if case != "all is well" or count == 1:
        assert loss == 0
    loss.backward()
    assert torch.isfinite(features.grad).all()


def test_the_nearest_patch_is_the_one_of_the_definition():
    """Of a 224 px picture with patches of 32 px, 8 px apart: round((p - 15.5) / 8), p clamped to 15.5..207.5."""
    place = np.random.default_rng(2).uniform(0, 224, (2, 400, 2))
    index = np.floor((np.clip(place - 0.5, 15.5, 207.5) - 15.5) / 8 + 0.5).astype(int)
    visible = torch.ones(2, 400, dtype=torch.bool)
    sizes = ((224, 224), (224, 224), (25, 25), 32)
    found = nearest_patch(torch.from_numpy(place), visible, *sizes)
    assert np.array_equal(found.numpy(), 25 * index[..., 1] + index[..., 0])
    doubled = nearest_patch(torch.from_numpy(2 * place), visible, (448, 448), *sizes[1:])
    assert torch.equal(doubled, found)


def test_hidden_vertices_and_those_off_the_picture_have_no_patch():
    pixels = torch.tensor([[[10.0, 10.0], [-1.0, 10.0], [10.0, 48.0], [10.0, 10.0], [float("nan"), 5.0]]])
    visible = torch.tensor([[True, True, True, False, True]])
    found = nearest_patch(pixels, visible, (48, 48), (32, 32), (13, 13), 8)
    assert found.tolist() == [[13 + 1, -1, -1, -1, -1]]
    assert nearest_patch(pixels, visible, (48, 48), (8, 8), (1, 1), 8).tolist() == [[0, -1, -1, -1, -1]]
