import numpy as np
import pytest
import torch
import trimesh

from fabcraft.fit.descend import Descent, Stop, Variables, descend
from fabcraft.fit.losses import Term, point_loss
from fabcraft.geometry.poisson import PoissonSystem

MESH = trimesh.creation.icosphere(2, 1.0)
SYSTEM = PoissonSystem.of(np.array(MESH.vertices), np.array(MESH.faces))
REST = Variables.rest(len(MESH.faces), 3)
GOAL = torch.from_numpy(np.array(MESH.vertices) * [1.4, 0.8, 1.0] + [0.3, 0.0, -0.1]).float()


def towards_goal():
    return Term("goal", 1.0, lambda state: point_loss(state.positions, GOAL))


def test_a_sphere_becomes_the_ellipsoid_it_is_asked_for_and_moves_there():
    outcome = descend(SYSTEM, [towards_goal()], Descent(200, 3e-2, 3e-2), REST)
    assert np.abs(outcome.positions - GOAL.numpy()).max() < 0.02
    assert outcome.history["total"][-1] < 1e-3 * outcome.history["total"][0]


def test_no_offset_is_the_rest_mesh():
    outcome = descend(
        SYSTEM, [Term("nothing", 0.0, lambda state: state.positions.sum())], Descent(1, 1e-2, 1e-2), REST
    )
    np.testing.assert_allclose(outcome.positions, MESH.vertices, atol=1e-6)


def test_two_runs_give_the_same_bytes():
    runs = [
        descend(SYSTEM, [towards_goal()], Descent(15, 1e-2, 1e-2), REST).positions.tobytes() for _ in range(2)
    ]
    assert runs[0] == runs[1]


def test_a_still_run_stops_early_and_says_so():
    outcome = descend(
        SYSTEM, [Term("nothing", 0.0, lambda state: state.positions.sum())], Descent(500, 1e-2, 1e-2), REST
    )
    assert outcome.stopped is Stop.STILL and len(outcome.history["total"]) <= 60


def test_an_energy_that_is_never_finite_stops_with_the_rest_mesh():
    bad = Term("bad", 1.0, lambda state: state.positions.sum() * float("nan"))
    outcome = descend(SYSTEM, [bad], Descent(50, 1e-2, 1e-2), REST)
    assert outcome.stopped is Stop.NOT_FINITE
    np.testing.assert_allclose(outcome.positions, MESH.vertices, atol=1e-6)


def test_one_bad_step_is_skipped():
    def sometimes(state):
        return point_loss(state.positions, GOAL) * (float("inf") if state.step == 3 else 1.0)

    outcome = descend(SYSTEM, [Term("goal", 1.0, sometimes)], Descent(60, 3e-2, 3e-2), REST)
    assert outcome.stopped is Stop.STEPS and len(outcome.history["total"]) == 59
    assert outcome.history["total"][-1] < 0.05 * outcome.history["total"][0]


def test_an_interrupt_keeps_the_best_so_far():
    def watch(step, values, positions):
        if step == 30:
            raise KeyboardInterrupt

    outcome = descend(SYSTEM, [towards_goal()], Descent(200, 3e-2, 3e-2), REST, watch)
    assert outcome.stopped is Stop.INTERRUPTED
    reached = float(point_loss(torch.from_numpy(outcome.positions).float(), GOAL))
    assert reached == pytest.approx(min(outcome.history["goal"]), rel=1e-4)


def test_a_run_goes_on_from_where_another_stopped():
    half = Descent(20, 1e-2, 1e-2, final_share=1.0)
    first = descend(SYSTEM, [towards_goal()], half, REST)
    second = descend(SYSTEM, [towards_goal()], half, first.variables)
    whole = descend(SYSTEM, [towards_goal()], Descent(40, 1e-2, 1e-2, final_share=1.0), REST)
    np.testing.assert_allclose(second.positions, whole.positions, atol=2e-5)
    assert second.variables.step == 40


def test_a_step_over_a_cliff_is_halved_until_it_is_back():
    wall = 1.15  # the goal lies beyond it, at 1.7

    def guarded(state):
        beyond = state.positions[:, 0].max() > wall
        return point_loss(state.positions, GOAL) * (float("nan") if beyond else 1.0)

    outcome = descend(SYSTEM, [Term("goal", 1.0, guarded)], Descent(80, 3e-2, 3e-2), REST)
    # it comes up to the cliff in ever smaller steps, and what it returns lies before it
    assert wall - 0.02 < outcome.positions[:, 0].max() <= wall + 1e-6
    assert np.isfinite(outcome.history["total"]).all()
