from dataclasses import dataclass, field, replace

import numpy as np
import pytest
import torch
from worn import ball

from fabcraft.fit.descend import Descent, State, Stop, Variables, Ways, descend
from fabcraft.fit.losses import Term, point_loss
from fabcraft.fit.presets import PRESETS
from fabcraft.fit.topology import Topology
from fabcraft.fit.views import ViewBank, guidance_chunks, prepare
from fabcraft.geometry.frame import Frame
from fabcraft.geometry.poisson import PoissonSystem

BALL = ball(20.0, 2)
SETTINGS = replace(PRESETS["draft"], views=6, bank=12, chunk=4, pixels=48)


@dataclass
class Looking:
    """Asks pictures to be bright, to the left and near; keeps what it saw."""

    outputs: tuple = ("mask", "shaded")
    weights: dict = field(default_factory=lambda: {"bright": 2.0})
    seen: list = field(default_factory=list)

    def describe(self):
        return "bright pictures"

    def losses(self, views):
        self.seen.append(views)
        if not self.outputs:
            return {"bright": (views.positions**2).mean()}
        ramp = torch.linspace(0.0, 1.0, views.mask.shape[2])
        return {"bright": (1.0 - views.shaded).mean() + (views.mask * ramp).mean()}


def gradient(settings, guidance):
    """Of all views of one step by the positions, and the values."""
    bank = ViewBank.around(BALL, settings)
    points = torch.from_numpy(Frame.of(BALL).inside(BALL.vertices)).float().requires_grad_(True)
    values = 0.0
    chunks = guidance_chunks([guidance], bank, BALL.faces, settings)
    system = PoissonSystem.of(Frame.of(BALL).inside(BALL.vertices), BALL.faces)
    for chunk in chunks(State(system, points, torch.zeros(1, 3, 2), 3)):
        sum(chunk.values()).backward()
        values += sum(float(value.detach()) for value in chunk.values())
    return points.grad, values


@pytest.mark.parametrize("chunk", [1, 4])
def test_a_gradient_in_chunks_is_the_whole_gradient(chunk):
    whole, value = gradient(replace(SETTINGS, chunk=6), Looking())
    parts, same = gradient(replace(SETTINGS, chunk=chunk), Looking())
    assert whole.abs().max() > 1e-3
    assert float((whole - parts).abs().max()) < 1e-5 * float(whole.abs().max()) and same == pytest.approx(
        value
    )


def test_no_more_pictures_than_a_chunk_are_asked_for_at_a_time():
    guidance = Looking()
    gradient(replace(SETTINGS, views=10, bank=16, chunk=4), guidance)
    assert [len(views.camera) for views in guidance.seen] == [4, 4, 2]
    assert all(views.mask.shape == (len(views.camera), 48, 48) for views in guidance.seen)
    assert all(views.normal is None and views.depth is None for views in guidance.seen)


def test_a_guidance_without_pictures_is_asked_once_and_without_cameras():
    guidance = Looking(outputs=())
    found, _ = gradient(SETTINGS, guidance)
    assert len(guidance.seen) == 1 and len(guidance.seen[0].camera) == 0
    points = Frame.of(BALL).inside(BALL.vertices)
    np.testing.assert_allclose(found.numpy(), 2.0 * 2.0 * points / points.size, atol=1e-7)


def test_the_rest_shape_is_shown_from_the_whole_bank_to_who_wants_it():
    class Comparing(Looking):
        def prepare(self, rest):
            self.seen.append(rest)

    guidance = Comparing()
    prepare([guidance, Looking()], ViewBank.around(BALL, SETTINGS), BALL)
    assert np.concatenate([views.camera for views in guidance.seen]).tolist() == list(range(12))


def test_what_counts_for_nothing_is_not_asked():
    off = Looking()
    settings = replace(SETTINGS, steps=4, fit_after=0.5, guidance_then=0.0)
    gradient(settings, off)  # step 3 of 4 is in the fit phase
    weightless = Looking(weights={"bright": 0.0})
    gradient(SETTINGS, weightless)
    assert off.seen == [] and weightless.seen == []


def test_a_step_draws_the_same_cameras_again_and_another_step_others():
    bank = ViewBank.around(BALL, SETTINGS)
    np.testing.assert_array_equal(bank.at(5), bank.at(5))
    assert len({tuple(bank.at(step)) for step in range(10)}) > 5
    assert all(len(set(bank.at(step))) == 6 for step in range(10))


def test_paired_cameras_are_neighbours_and_come_together():
    settings = replace(SETTINGS, paired_views=True, chunk=3)
    bank = ViewBank.around(BALL, settings)
    points = torch.from_numpy(Frame.of(BALL).inside(BALL.vertices)).float()
    views = list(bank.chunks(points, Topology.of(BALL.faces), ("mask",), bank.at(0)))
    assert [len(part.camera) for part in views] == [4, 2]
    for part in views:
        turn = (part.azimuth_deg[1::2] - part.azimuth_deg[::2]) % 360.0
        assert (turn > 1.0).all() and (turn <= 15.0).all()
        np.testing.assert_allclose(part.elevation_deg[1::2], part.elevation_deg[::2], atol=1e-9)


def test_the_whole_object_is_in_every_picture_and_half_of_its_vertices_are_seen():
    bank = ViewBank.around(BALL, SETTINGS)
    points = torch.from_numpy(Frame.of(BALL).inside(BALL.vertices)).float()
    for views in bank.chunks(points, Topology.of(BALL.faces), ("mask",)):
        assert (views.pixels > 0).all() and (views.pixels < 48).all()
        assert views.mask[:, [0, -1]].abs().max() == 0
        share = views.visible.float().mean(1)
        assert (share > 0.3).all() and (share < 0.7).all()


def test_a_camera_at_azimuth_90_stands_at_the_left():
    bank = ViewBank.around(BALL, replace(SETTINGS, views=1, bank=200))
    points = torch.from_numpy(Frame.of(BALL).inside(BALL.vertices)).float()
    views = next(bank.chunks(points, Topology.of(BALL.faces), ("mask",), np.arange(40, 60)))
    for azimuth, elevation, index in zip(views.azimuth_deg, views.elevation_deg, views.camera, strict=True):
        view = bank.cameras[index].view
        place = -view[:3, :3].T @ view[:3, 3]
        place /= np.linalg.norm(place)
        a, e = np.radians([azimuth, elevation])
        expected = [np.cos(e) * np.sin(a), -np.cos(e) * np.cos(a), np.sin(e)]
        np.testing.assert_allclose(place, expected, atol=1e-9)


def test_the_loop_goes_down_on_chunks_and_notes_their_sum():
    bank = ViewBank.around(BALL, replace(SETTINGS, views=12))
    system = PoissonSystem.of(Frame.of(BALL).inside(BALL.vertices), BALL.faces)
    ways = Ways(chunks=guidance_chunks([Looking()], bank, BALL.faces, SETTINGS))
    outcome = descend(system, [], Descent(25, 2e-2, 1e-2), Variables.rest(len(BALL.faces), 3), ways=ways)
    bright = outcome.history["bright"]
    assert bright == outcome.history["total"] and len(bright) == 25 and bright[-1] < 0.9 * bright[0]


def test_the_best_is_judged_without_paces():
    system = PoissonSystem.of(Frame.of(BALL).inside(BALL.vertices), BALL.faces)
    goal = torch.from_numpy(Frame.of(BALL).inside(BALL.vertices) * 1.3).float()

    def stop(step, values, positions):
        if step == 30:
            raise KeyboardInterrupt

    outcome = descend(
        system,
        [Term("goal", 1.0, lambda state: point_loss(state.positions, goal))],
        Descent(200, 2e-2, 1e-2),
        Variables.rest(len(BALL.faces), 3),
        stop,
        Ways(
            pace=lambda name, step: (1.0 + step) ** 3
        ),  # the paced energy rises although the goal comes nearer
    )
    assert outcome.stopped is Stop.INTERRUPTED
    assert outcome.history["goal"][-1] > outcome.history["goal"][1]
    missed = np.abs(outcome.positions - goal.numpy()).max()
    assert missed < 0.6 * np.abs(Frame.of(BALL).inside(BALL.vertices) - goal.numpy()).max()
