"""The baked model against the one it was baked from (extra `fabcraft[bake]`), and what its file holds."""

import os
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from fabcraft.body.human import PRESETS
from fabcraft.body.model import human_model, whole

ANNY_CACHE = Path(os.environ.get("ANNY_CACHE_DIR", Path.home() / ".cache" / "anny"))


@pytest.fixture(scope="module")
def model():
    return human_model()


@pytest.mark.skipif(
    find_spec("anny") is None, reason="anny is not installed (fabcraft[bake]): not compared with it"
)
@pytest.mark.skipif(not ANNY_CACHE.exists(), reason="anny has no cache here yet; filling it takes minutes")
def test_bodies_that_were_not_used_to_bake_are_met_to_a_tenth_of_a_millimetre(model):
    from fabcraft.body.bake import SEED, random_parameters
    from fabcraft.body.bake_sampler import Sampler

    sampler, rng = Sampler(), np.random.default_rng(SEED + 1)
    symmetric = len(model.basis) - model.differences
    basis = model.basis[:symmetric].reshape(symmetric, -1).astype(np.float64)
    gram = basis @ basis.T
    errors = []
    for _ in range(12):
        points = sampler.points(random_parameters(rng))
        own = np.linalg.solve(gram, basis @ (points - model.mean).ravel())
        nearest = model.points(np.append(own, np.zeros(model.differences)).astype(np.float32))
        errors.append(np.linalg.norm(nearest - points, axis=1))
    assert np.mean(errors) < 0.1
    assert np.max(errors) < 3.0
    assert (sampler.skin.faces == model.faces).all()
    assert sampler.skin.landmarks == model.landmarks


def test_the_file_is_small():
    assert (files("fabcraft.body") / "human.npz").stat().st_size < 5_000_000


def test_people_are_mirror_images_of_themselves(model):
    points = model.points(model.presets["woman"])
    count = len(points) - len(model.joint_names)
    opposite = model.hand.opposite
    assert (opposite[opposite] == np.arange(len(points))).all()
    assert points[opposite] == pytest.approx(points * [-1, 1, 1], abs=1e-4)
    for index, name in enumerate(model.joint_names):
        twin = model.joint_names[opposite[count + index] - count]
        assert {name, twin} in ({name}, {name.replace("_right", "_left"), name.replace("_left", "_right")})


def test_differences_move_left_and_right_apart(model):
    apart = model.basis[-model.differences :]
    opposite = model.hand.opposite
    assert apart[:, opposite] == pytest.approx(apart * np.array([1, -1, -1], np.float32), abs=1e-5)
    assert np.abs(apart).reshape(len(apart), -1).max(1).min() > 0.05


def test_a_half_becomes_whole():
    half, opposite = np.array([0, 1]), np.array([0, 2, 1])  # one in the middle, one on the left
    rows = np.array([[[0.5, 1.0, 2.0], [3.0, 4.0, 5.0]]], dtype=np.float32)
    assert whole(rows, half, opposite).tolist() == [[[0.0, 1.0, 2.0], [3.0, 4.0, 5.0], [-3.0, 4.0, 5.0]]]
    assert whole(rows, half, opposite, -1.0).tolist() == [
        [[0.0, 0.0, 0.0], [3.0, 4.0, 5.0], [3.0, -4.0, -5.0]]
    ]


def test_every_preset_is_in_the_file(model):
    assert tuple(model.presets) == PRESETS
    for coefficients in model.presets.values():
        assert coefficients[-model.differences :] == pytest.approx(0.0)
