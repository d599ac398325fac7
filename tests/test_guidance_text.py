"""Words as guidance: each loss against its formula, in chunks and repeated, and a sphere that they pull."""

from pathlib import Path

import numpy as np
import pytest
import tiny_clip
import torch
from tiny_clip import globe, part, seen

from fabcraft.errors import InputError
from fabcraft.guidance.background import jittered
from fabcraft.guidance.clip import ClipModel, load_clip
from fabcraft.guidance.embedding import cosine_loss, direction_loss
from fabcraft.guidance.guidance import Views
from fabcraft.guidance.text import TextGuidance


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> ClipModel:
    return load_clip(tiny_clip.save(tmp_path_factory.mktemp("tiny")))


AROUND = (350.0, 5.0, 15.0, 90.0, 180.0)


def sphere(stretch: float = 1.0, **more) -> tuple[torch.Tensor, Views]:
    vertices, faces = globe()
    points = torch.from_numpy(vertices * [stretch, 1.0, 1.0 / stretch]).requires_grad_()
    return points, seen(points, faces, AROUND, 10.0, **more)


def test_the_clip_loss_is_one_minus_the_mean_cosine_to_the_prompt(model):
    _, views = sphere()
    guidance = TextGuidance(model, "a cat", consistency=False, seed=3)
    behind = jittered(views.camera, model.size, 3)
    cosines = model.encode_images(views.shaded, views.mask, behind) @ model.encode_text(["a cat"]).T
    losses = guidance.losses(views)
    assert list(losses) == ["clip"] and losses["clip"].shape == ()
    assert losses["clip"].item() == pytest.approx(1 - cosines.mean().item(), abs=1e-6)
    assert losses["clip"].dtype == views.positions.dtype


def test_the_direction_goes_from_the_base_prompt_to_the_prompt(model):
    _, rest = sphere()
    _, views = sphere(1.6)
    guidance = TextGuidance(model, "a cat", "a ball", weights={"clip": 0.0}, consistency=False)
    guidance.prepare(rest)
    behind = jittered(views.camera, model.size, 0)
    moved = [model.encode_images(one.shaded, one.mask, behind, unit=False) for one in (views, rest)]
    goal, base = model.encode_text(["a cat", "a ball"], unit=False)
    found = guidance.losses(views)
    assert list(found) == ["direction"]
    assert found["direction"].item() == pytest.approx(direction_loss(*moved, goal - base).item(), abs=1e-5)
    plain = torch.nn.functional.cosine_similarity(moved[0] - moved[1], (goal - base)[None]).mean()
    assert 0.6 < (1 - found["direction"].item()) / plain.item() < 1


def test_a_shape_at_rest_has_a_direction_loss_of_one_and_a_bounded_gradient(model):
    points, views = sphere()
    guidance = TextGuidance(model, "a cat", "a ball", consistency=False)
    guidance.prepare(views)
    loss = guidance.losses(views)["direction"]
    loss.backward()
    assert loss.item() == pytest.approx(1.0, abs=1e-6)
    at_rest = points.grad.norm()
    points, views = sphere(1.05)
    guidance.losses(views)["direction"].backward()
    assert 0 < at_rest < 20 * points.grad.norm()


def test_softening_leaves_a_picture_that_went_far_with_the_plain_cosine():
    generator = np.random.default_rng(0)
    rest, way = (torch.from_numpy(generator.standard_normal(shape)) for shape in ((3, 8), (8,)))
    assert float(direction_loss(rest + 5 * way, rest, way)) == pytest.approx(0.0, abs=1e-3)
    assert float(direction_loss(rest - 5 * way, rest, way)) == pytest.approx(2.0, abs=1e-3)
    assert float(cosine_loss(rest, rest * 2)) == pytest.approx(0.0)


def test_chunks_weighted_by_their_views_equal_the_whole(model):
    _, rest = sphere()
    _, views = sphere(1.3)
    guidance = TextGuidance(model, "a cat", "a ball", consistency=False)
    for rows in ([0, 1], [2, 3, 4]):
        guidance.prepare(part(rest, rows))
    whole = guidance.losses(views)
    for name in ("clip", "direction"):
        chunks = [(len(rows), guidance.losses(part(views, rows))[name]) for rows in ([0, 3], [1, 2, 4])]
        mean = sum(count * value.item() for count, value in chunks) / 5
        assert mean == pytest.approx(whole[name].item(), abs=1e-6)


def test_the_same_seed_gives_the_same_losses_and_gradients(model):
    def once(seed: int) -> tuple[dict, torch.Tensor]:
        _, rest = sphere()
        points, views = sphere(1.3)
        guidance = TextGuidance(model, "a cat", "a ball", seed=seed)
        guidance.prepare(rest)
        losses = guidance.losses(views)
        sum(losses.values()).backward()
        return {name: value.item() for name, value in losses.items()}, points.grad

    first, second, other = once(0), once(0), once(1)
    assert first[0] == second[0] and torch.equal(first[1], second[1])
    assert set(first[0]) == {"clip", "direction", "consistency"} and first[0] != other[0]


@pytest.mark.parametrize("count", [1, 2, 4])
@pytest.mark.parametrize("visible", [True, False])
def test_consistency_is_finite_for_any_number_of_views(model, count, visible):
    vertices, faces = globe()
    points = torch.from_numpy(vertices).requires_grad_()
    views = seen(points, faces, AROUND[:count])
    if not visible:
        views.visible[:] = False
    found = TextGuidance(model, "a cat").losses(views)["consistency"]
    found.backward()
    assert found.ndim == 0 and torch.isfinite(found) and torch.isfinite(points.grad).all()
    assert (found > 0) == (visible and count > 1)


def test_consistency_of_two_equal_views_is_perfect(model):
    vertices, faces = globe()
    views = seen(torch.from_numpy(vertices), faces, (20.0, 20.0), camera=(7, 7))
    assert float(TextGuidance(model, "a cat").losses(views)["consistency"]) == pytest.approx(0.0, abs=1e-5)


def test_weights_of_the_encoder_get_no_gradient(model):
    points, views = sphere()
    sum(TextGuidance(model, "a cat").losses(views).values()).backward()
    assert points.grad.abs().sum() > 0
    assert all(weight.grad is None for weight in model.network.parameters())


def test_a_sphere_pulled_by_words_comes_to_look_more_like_them(model):
    vertices, faces = globe()
    rest = torch.from_numpy(vertices)
    guidance = TextGuidance(model, "a rabbit with long ears", "a ball")
    guidance.prepare(seen(rest, faces, AROUND[:3]))
    offset = torch.zeros_like(rest, requires_grad=True)
    optimiser, told = torch.optim.Adam([offset], lr=0.04), []
    for _ in range(10):
        losses = guidance.losses(seen(rest + offset, faces, AROUND[:3]))
        sum(guidance.weights[name] * value for name, value in losses.items()).backward()
        optimiser.step()
        optimiser.zero_grad()
        told.append({name: value.item() for name, value in losses.items()})
    assert told[-1]["clip"] < told[0]["clip"] - 0.05
    assert told[-1]["direction"] < told[0]["direction"] - 0.2


def test_what_it_says_names_the_words_and_the_encoder(model):
    said = TextGuidance(model, "a cat", "a mask").describe()
    assert said.startswith("text 'a cat', away from 'a mask', as ") and Path(model.name).name in said


def test_what_cannot_be_used_is_refused(model):
    _, views = sphere()
    with pytest.raises(InputError, match="both"):
        TextGuidance(model, "a cat", "A cat ")
    with pytest.raises(InputError, match="'direction'"):
        TextGuidance(model, "a cat", weights={"direction": 1.0})
    with pytest.raises(InputError, match="'colour'"):
        TextGuidance(model, "a cat", weights={"colour": 1.0})
    with pytest.raises(InputError, match="'clip'"):
        TextGuidance(model, "a cat", weights={"clip": float("nan")})
    with pytest.raises(InputError, match="not seen from camera 0"):
        TextGuidance(model, "a cat", "a ball").losses(views)
    with pytest.raises(InputError, match="without shade"):
        TextGuidance(model, "a cat").losses(sphere(outputs=("mask",))[1])
