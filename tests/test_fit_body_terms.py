from dataclasses import replace

import numpy as np
import pytest
import torch
from worn import ball, band, limb, torus

from fabcraft.errors import InputError
from fabcraft.fit.body_terms import (
    ContactSet,
    MovingDistance,
    contact_term,
    contacts_between,
    huber,
    penetration_term,
    seat,
)
from fabcraft.fit.descend import State
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.frame import Frame
from fabcraft.geometry.poisson import PoissonSystem

BODY = SurfaceDistance(ball(30.0, 5))
OBJECT = ball(8.0, 2)
FRAME = Frame.of(OBJECT)
SYSTEM = PoissonSystem.of(FRAME.inside(OBJECT.vertices), OBJECT.faces)


def at(shift):
    """The object moved by `shift` mm, as a term sees it."""
    positions = torch.from_numpy(FRAME.inside(OBJECT.vertices + np.array(shift))).float().requires_grad_(True)
    return State(SYSTEM, positions, torch.zeros(1, 3, 2), 0)


def test_what_is_clear_costs_nothing_and_is_pulled_nowhere():
    term = penetration_term(BODY, OBJECT, np.full(len(OBJECT.vertices), 0.5), FRAME)
    state = at([0.0, 0.0, 39.0])
    value = term(state)
    value.backward()
    assert float(value.detach()) == 0.0 and not state.positions.grad.any()


def test_what_is_inside_is_pushed_outward_by_its_depth_squared():
    term = penetration_term(BODY, OBJECT, np.zeros(len(OBJECT.vertices)), FRAME)
    state = at([0.0, 0.0, 10.0])  # wholly inside, the deepest 28 mm
    value = term(state)
    value.backward()
    depth = 30.0 - np.linalg.norm(OBJECT.vertices + [0.0, 0.0, 10.0], axis=1)
    assert float(value.detach()) == pytest.approx(float((depth**2).mean()) * FRAME.scale**2, rel=0.05)
    outward = OBJECT.vertices + [0.0, 0.0, 10.0]
    assert ((-state.positions.grad.numpy() * outward).sum(1) > 0.0).all()


def test_a_distance_carried_on_is_the_distance():
    moving = MovingDistance(BODY, FRAME)
    random = np.random.default_rng(0)
    points = random.normal(size=(200, 3)) * 18.0
    for _ in range(30):
        points = points + random.normal(size=points.shape) * 0.15
        found = moving(torch.from_numpy(FRAME.inside(points)), np.zeros(200)).numpy() / FRAME.scale
        exact = BODY.signed(points)
        assert np.abs(found - exact)[exact < 0.5].max() < 0.02
        assert (found[exact > 0.05] > 0.0).all()


@pytest.mark.parametrize("paired", [False, True])
def test_contacts_pull_a_ring_to_the_finger_and_rest_there(paired):
    finger, ring = SurfaceDistance(limb(9.0, 9.0)), torus(12.0, 1.5)
    frame = Frame.of(ring)
    contacts = contacts_between(ring, finger, reach_mm=2.0, count=60)
    if not paired:
        contacts = replace(contacts, faces=None, places=None)
    system = PoissonSystem.of(frame.inside(ring.vertices), ring.faces)
    positions = torch.from_numpy(frame.inside(ring.vertices)).float().requires_grad_(True)
    value = contact_term(contacts, ring.faces, frame)(State(system, positions, torch.zeros(1, 3, 2), 0))
    value.backward()
    pulled = (-positions.grad[:, :2].numpy() * ring.vertices[:, :2]).sum(1)
    assert float(value.detach()) > 0.0 and (pulled <= 1e-9).all() and pulled.min() < 0.0


def test_a_contact_that_is_met_costs_exactly_nothing():
    contacts = ContactSet(
        OBJECT.vertices[:5].copy(), OBJECT.vertex_normals[:5], np.zeros(5), np.ones(5),
        np.array([np.flatnonzero((OBJECT.faces == i).any(1))[0] for i in range(5)]),
        np.stack([(OBJECT.faces[np.flatnonzero((OBJECT.faces == i).any(1))[0]] == i) * 1.0 for i in range(5)]),
    )  # fmt: skip
    state = at([0.0, 0.0, 0.0])
    value = contact_term(contacts, OBJECT.faces, FRAME)(state)
    value.backward()
    assert float(value.detach()) == 0.0 and bool(torch.isfinite(state.positions.grad).all())


def nearest_to(point, normal, gap_mm):
    """The cost and the pull (V, 3) of one nearest contact on the object where it is, mm."""
    contacts = ContactSet(np.array([point]), np.array([normal]), np.array([gap_mm]), np.ones(1))
    state = at([0.0, 0.0, 0.0])
    value = contact_term(contacts, OBJECT.faces, FRAME)(state)
    value.backward()
    return float(value.detach()) / FRAME.scale**2, -state.positions.grad.numpy()


def test_a_nearest_contact_asks_for_its_gap_and_not_for_a_place():
    # 3 mm from the ball, while the skin's normal points past it
    top = OBJECT.vertices[np.argmax(OBJECT.vertices[:, 2])]
    point = top * (1.0 + 3.0 / np.linalg.norm(top))
    beside = np.cross(top, [0.0, 1.0, 0.0])
    towards = 0.3 * -top / np.linalg.norm(top) + beside / np.linalg.norm(beside)
    normal = towards / np.linalg.norm(towards)
    assert nearest_to(point, normal, 3.0)[0] == pytest.approx(0.0, abs=1e-4)
    cost, pull = nearest_to(point, normal, 1.0)
    assert cost == pytest.approx(4.0, rel=1e-2) and pull.sum(0) @ top > 0.0


def test_a_nearest_contact_in_the_skin_moves_the_object_out_of_it():
    # the object reaches 2 mm beyond the skin's place, which looks up: the way is up, not farther in
    bottom = OBJECT.vertices[np.argmin(OBJECT.vertices[:, 2])]
    cost, pull = nearest_to(bottom * 0.75, -bottom / np.linalg.norm(bottom), 1.0)
    assert cost == pytest.approx(9.0, rel=0.05) and pull.sum(0) @ -bottom > 0.0


def test_a_nearest_contact_draws_no_thorn_out_of_the_object():
    top = OBJECT.vertices[np.argmax(OBJECT.vertices[:, 2])]
    cost, pull = nearest_to(top * 1.2, -top / np.linalg.norm(top), 0.0)
    moved = np.linalg.norm(pull, axis=1)
    assert cost > 0.0 and (moved > 0.0).sum() == 48
    assert moved[moved > 0.0] == pytest.approx(moved.max(), rel=1e-3)  # all alike, as one patch
    far = np.linalg.norm(OBJECT.vertices - top, axis=1) > 10.0
    assert not moved[far].any()


def test_huber_is_the_square_and_then_a_line():
    squared = torch.tensor([0.0, 0.04, 4.0], dtype=torch.float64, requires_grad=True)
    found = huber(squared, 0.5)
    found.sum().backward()
    np.testing.assert_allclose(found.detach().numpy(), [0.0, 0.04, 2 * 0.5 * 2.0 - 0.25])
    np.testing.assert_allclose(squared.grad.numpy(), [1.0, 1.0, 0.25])


def test_contacts_lie_on_the_side_that_faces_the_body():
    finger, ring = SurfaceDistance(limb(9.0, 9.0)), torus(11.0, 1.0)
    contacts = contacts_between(ring, finger, reach_mm=5.0, count=80)
    held = (contacts.places[:, :, None] * ring.corners[contacts.faces]).sum(1)
    assert 40 <= len(contacts.points) <= 80 and (np.hypot(*held[:, :2].T) < 11.0).all()
    assert np.hypot(*contacts.points[:, :2].T) == pytest.approx(9.0, abs=0.02)
    with pytest.raises(InputError, match=r"within 0\.5 mm"):
        contacts_between(ring, finger, reach_mm=0.5)


def test_paired_contacts_follow_to_a_finer_mesh_of_the_same_surface():
    coarse, fine = limb(9.0, 9.0, sections=24), limb(9.0, 9.0, sections=24)
    halves = fine.faces[:48].copy()
    points = np.concatenate([fine.vertices, fine.corners[:48].mean(1)])
    middle = len(fine.vertices) + np.arange(48, dtype=np.int32)
    split = np.concatenate([np.stack([halves[:, i], halves[:, (i + 1) % 3], middle], 1) for i in range(3)])
    fine = type(fine)(points, np.concatenate([split, fine.faces[48:]]), "fine")
    contacts = contacts_between(coarse, SurfaceDistance(limb(8.0, 8.0)), reach_mm=30.0, count=40)
    moved = contacts.on(coarse, fine)
    before = (contacts.places[:, :, None] * coarse.corners[contacts.faces]).sum(1)
    after = (moved.places[:, :, None] * fine.corners[moved.faces]).sum(1)
    np.testing.assert_allclose(after, before, atol=1e-9)


def test_a_ball_in_a_wall_is_as_deep_as_it_is():
    wall = SurfaceDistance(limb(60.0, 60.0, 40.0))  # its top is the plane z = 20
    sunk = ball(5.0, 4)
    sunk = sunk.with_vertices(sunk.vertices + [0.0, 0.0, 23.0])  # the lowest 2 mm are inside
    found = seat(sunk, wall, None)
    assert found.pen_max_mm == pytest.approx(2.0, abs=0.01)
    # share of the sphere's area at depth > d is (2 - d) / 10, so the mean of d² is ∫ d² dd / 10 from 0 to 2
    assert found.pen_rms_mm == pytest.approx(np.sqrt(8.0 / 3.0 / 10.0), rel=0.03)
    assert found.contact_rms_mm is None


def test_a_ring_that_sits_touches_by_its_gap():
    found = seat(torus(10.7, 1.5, 96, 32), SurfaceDistance(limb(9.0, 9.0)), band(9.0))
    assert found.pen_max_mm == 0.0 and found.contact_rms_mm < 0.02 and found.contact_p95_mm < 0.03


def test_no_contacts_are_refused():
    with pytest.raises(InputError, match="0 contacts"):
        ContactSet(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0))
