"""A guidance mesh's views, or one picture, as guidance: nothing to pay for the same shape, more for another."""

import numpy as np
import pytest
import tiny_clip
import torch
from tiny_clip import globe, part, seen

from fabcraft.errors import InputError
from fabcraft.guidance.clip import ClipModel, load_clip
from fabcraft.guidance.guidance import Views
from fabcraft.guidance.picture import PictureGuidance, reference, targets_of

AROUND = (0.0, 40.0, 90.0, 180.0, 300.0)
ALL = ("shaded", "mask", "normal")


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> ClipModel:
    return load_clip(tiny_clip.save(tmp_path_factory.mktemp("tiny")))


def shape(stretch: float = 1.0, outputs=ALL, **more) -> tuple[torch.Tensor, Views]:
    vertices, faces = globe()
    points = torch.from_numpy(vertices * [stretch, 1.0, 1.0]).requires_grad_()
    return points, seen(points, faces, AROUND, 5.0, outputs=outputs, **more)


def test_the_guidance_itself_costs_nothing_and_another_shape_costs(model):
    wanted = targets_of([shape(1.4)[1]], model)
    guidance = PictureGuidance(wanted, model)
    same, other = guidance.losses(shape(1.4)[1]), guidance.losses(shape()[1])
    assert float(same["embedding"]) == pytest.approx(0.0, abs=1e-6) and float(same["image"]) == 0.0
    assert other["embedding"] > 1e-4 and other["image"] > 1e-2
    assert set(guidance.outputs) == set(ALL) and guidance.weights == {"embedding": 1.0, "image": 5.0}


def test_the_image_loss_is_the_mean_absolute_difference_of_every_picture():
    _, wanted = shape(1.4)
    _, views = shape()
    found = PictureGuidance(targets_of([wanted])).losses(views)
    expected = [(getattr(views, name) - getattr(wanted, name)).abs().mean() for name in ALL]
    assert list(found) == ["image"]
    assert float(found["image"]) == pytest.approx(float(sum(expected)) / 3, rel=1e-6)


def test_targets_of_some_pictures_ask_for_those_alone():
    guidance = PictureGuidance(targets_of([shape(1.4)[1]], images=("mask", "normal")))
    assert guidance.outputs == ("mask", "normal")
    assert guidance.losses(shape(outputs=("mask", "normal"))[1])["image"] > 0


def test_targets_are_found_by_camera_in_any_order_and_from_any_chunk(model):
    _, wanted = shape(1.4, camera=(10, 11, 12, 13, 14))
    targets = targets_of([part(wanted, [3, 0]), part(wanted, [1, 2, 4])], model)
    guidance = PictureGuidance(targets, model)
    found = guidance.losses(part(wanted, [4, 3, 1]))
    assert float(found["image"]) == 0.0 and float(found["embedding"]) == pytest.approx(0.0, abs=1e-6)
    with pytest.raises(InputError, match="camera 0"):
        guidance.losses(shape()[1])


def test_chunks_weighted_by_their_views_equal_the_whole(model):
    picture = np.full((30, 20, 4), 255, np.uint8)
    picture[5:15, 5:15, :3] = 40
    _, views = shape()
    for target in (targets_of([shape(1.4)[1]], model), reference(model, picture, within_deg=60.0)):
        guidance = PictureGuidance(target, model)
        whole = guidance.losses(views)
        for name, value in whole.items():
            chunks = [(len(rows), guidance.losses(part(views, rows))[name]) for rows in ([0, 3], [1, 2, 4])]
            mean = sum(count * float(one) for count, one in chunks) / 5
            assert mean == pytest.approx(float(value), abs=1e-6)


def test_one_picture_speaks_only_for_the_views_near_its_own(model):
    _, front = shape(outputs=("shaded", "mask"))
    shade = front.shaded[0].detach() + (1.0 - front.mask[0].detach())
    grey = np.repeat((255 * shade.clip(0, 1)).round().numpy().astype(np.uint8)[..., None], 3, axis=-1)
    picture = np.dstack([grey, np.full(grey.shape[:2], 255, np.uint8)])
    guidance = PictureGuidance(reference(model, picture, elevation_deg=5.0, within_deg=10.0), model)
    assert float(guidance.losses(part(front, [0]))["embedding"]) == pytest.approx(0.0, abs=1e-4)
    points, views = shape(1.5, outputs=("shaded", "mask"))
    away = guidance.losses(part(views, [1, 2, 3]))["embedding"]
    assert float(away) == 0.0
    away.backward()
    assert points.grad.abs().sum() == 0
    assert guidance.losses(part(views, [0]))["embedding"] > 1e-4


def test_a_transparent_picture_is_seen_before_white(model):
    clear = np.zeros((16, 8, 4), np.uint8)
    clear[4:12, 2:6] = (90, 90, 90, 255)
    white = np.full((16, 16, 4), 255, np.uint8)
    white[4:12, 6:10, :3] = 90
    a, b = (reference(model, picture).embedding for picture in (clear, white))
    assert torch.allclose(a, b, atol=1e-5)


@pytest.mark.parametrize("encoded", [True, False])
def test_following_the_loss_finds_the_proportions_of_the_guidance(model, encoded):
    vertices, faces = globe()
    used, ball = model if encoded else None, torch.from_numpy(vertices)
    goal = torch.tensor([1.3, 1.0, 0.8], dtype=torch.float64)
    targets = targets_of([seen(ball * goal, faces, AROUND, 5.0, outputs=ALL)], used)
    guidance = PictureGuidance(targets, used, weights={"image": 0.0} if encoded else None)
    scale = torch.ones(3, dtype=torch.float64, requires_grad=True)
    optimiser = torch.optim.Adam([scale], lr=0.04)
    for _ in range(24):
        losses = guidance.losses(seen(ball * scale, faces, AROUND, 5.0, outputs=guidance.outputs))
        sum(guidance.weights[name] * value for name, value in losses.items()).backward()
        optimiser.step()
        optimiser.zero_grad()
    assert torch.allclose(scale.detach(), goal, atol=0.05)


def test_what_it_says_names_what_is_compared_and_how(model):
    targets = targets_of([shape()[1]], model)
    assert PictureGuidance(targets).describe() == "a guidance mesh from 5 sides, pixel by pixel"
    assert "sees it and pixel by pixel" in PictureGuidance(targets, model).describe()


def test_what_cannot_be_used_is_refused(model):
    targets = targets_of([shape()[1]])
    with pytest.raises(InputError, match="nothing to compare"):
        PictureGuidance(targets, model, weights={"image": 0.0})
    with pytest.raises(InputError, match="'clip'"):
        PictureGuidance(targets, weights={"clip": 1.0})
    with pytest.raises(InputError, match="no camera"):
        targets_of([])
    with pytest.raises(InputError, match="without 'normal'"):
        targets_of([shape(outputs=("mask", "shaded"))[1]])
    with pytest.raises(InputError, match="same bank"):
        PictureGuidance(targets).losses(shape(pixels=40)[1])
    with pytest.raises(InputError, match="degrees"):
        reference(model, np.zeros((4, 4, 4), np.uint8), within_deg=0.0)
