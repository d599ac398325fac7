import numpy as np
import pytest
from worn import ball, limb, torus

from fabcraft.fit.settle import clear, settle_rigidly
from fabcraft.geometry.distance import SurfaceDistance

FINGER = SurfaceDistance(limb(9.0, 9.0))


def deepest(mesh, distance):
    return max(0.0, -float(distance.signed(np.concatenate([mesh.vertices, mesh.corners.mean(1)])).min()))


def test_a_ring_pushed_to_one_side_moves_back_as_a_whole():
    ring = torus(11.0, 1.5)
    aside = ring.with_vertices(ring.vertices + [1.5, 0.0, 0.0])
    settled = settle_rigidly(aside, FINGER, np.zeros(len(ring.vertices)))
    assert deepest(aside, FINGER) > 0.9 and deepest(settled.mesh, FINGER) < 0.05
    assert settled.shift_mm[0] == pytest.approx(-1.0, abs=0.15)
    np.testing.assert_allclose(settled.mesh.face_areas, ring.face_areas, rtol=1e-9)


def test_a_tilted_ring_turns_upright():
    ring = torus(10.6, 1.5)
    angle = np.radians(12.0)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    tight = SurfaceDistance(limb(9.05, 9.05))
    tilted = ring.with_vertices(ring.vertices @ turn.T)
    settled = settle_rigidly(tilted, tight, np.zeros(len(ring.vertices)), most_deg=15.0)
    assert deepest(settled.mesh, tight) < 0.3 * deepest(tilted, tight) and settled.turn_deg > 1.0


def test_what_is_clear_stays_where_it_is():
    ring = torus(12.0, 1.5)
    settled = settle_rigidly(ring, FINGER, np.full(len(ring.vertices), 0.5))
    np.testing.assert_array_equal(settled.mesh.vertices, ring.vertices)
    assert settled.turn_deg == 0.0 and not settled.shift_mm.any()


def test_a_ring_that_is_too_tight_all_around_does_not_wander():
    settled = settle_rigidly(torus(9.5, 1.5), FINGER, np.zeros(48 * 12))
    assert np.linalg.norm(settled.shift_mm) < 0.05 and settled.turn_deg < 0.1


def test_it_never_moves_farther_than_allowed():
    stuck = ball(4.0, 2)
    settled = settle_rigidly(stuck, FINGER, np.zeros(len(stuck.vertices)), most_mm=2.0)
    assert np.linalg.norm(settled.shift_mm) <= 2.0


def test_nothing_stands_through_between_the_vertices_either():
    coarse = torus(10.0, 1.5, 16, 8)  # its faces cut into the finger where its vertices do not
    pushed, most = clear(coarse, FINGER, np.full(len(coarse.vertices), 0.2))
    random = np.random.default_rng(0).dirichlet(np.ones(3), (len(coarse.faces), 40))
    samples = np.einsum("fsk,fkd->fsd", random, pushed.corners).reshape(-1, 3)
    assert FINGER.signed(samples).min() > 0.1 and most > 0.3
