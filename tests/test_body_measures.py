"""Tapes against shapes of known length; measures that find their own body and no other."""

import numpy as np
import pytest
import trimesh

from fabcraft.body.body import Body, Measured
from fabcraft.body.human import human
from fabcraft.body.measures import MEASURES, folded_hand_mm, folded_hands, measured, sided, tapes
from fabcraft.body.tape import between, extent, girth
from fabcraft.errors import InputError
from fabcraft.mesh import Mesh

UP = np.array([0.0, 0.0, 1.0])


def mesh_of(shape):
    return Mesh(np.asarray(shape.vertices, dtype=np.float64), np.asarray(shape.faces, dtype=np.int32))


@pytest.fixture(scope="module")
def woman():
    return human("woman")


def test_the_girth_of_a_cylinder_is_its_circle():
    tube = mesh_of(trimesh.creation.cylinder(radius=50.0, height=200.0, sections=256))
    assert girth(tube, np.zeros(3), UP).length_mm == pytest.approx(2 * np.pi * 50, rel=1e-3)


def test_the_girth_is_that_of_the_loop_nearest_to_the_point():
    near, far = (trimesh.creation.box((side, side, 100.0)) for side in (10.0, 40.0))
    far.apply_translation((100.0, 0.0, 0.0))
    both = Mesh(
        np.concatenate([near.vertices, far.vertices]),
        np.concatenate([near.faces, far.faces + 8]).astype(np.int32),
    )
    assert girth(both, np.zeros(3), 2 * UP).length_mm == pytest.approx(40)
    assert girth(both, np.array([90.0, 0.0, 0.0]), UP).length_mm == pytest.approx(160)


def test_a_tape_bridges_hollows():
    solid = mesh_of(
        trimesh.boolean.union(
            [trimesh.creation.box((60.0, 20.0, 50.0)), trimesh.creation.box((20.0, 60.0, 50.0))]
        )
    )
    assert girth(solid, np.zeros(3), UP).length_mm == pytest.approx(80 + 4 * np.hypot(20, 20))


def test_a_plane_beside_the_mesh_is_refused():
    box = mesh_of(trimesh.creation.box((10.0, 10.0, 10.0)))
    with pytest.raises(InputError, match="no skin"):
        girth(box, np.array([0.0, 0.0, 50.0]), UP)


def test_a_calliper_takes_the_extremes_along_its_direction():
    box = mesh_of(trimesh.creation.box((10.0, 20.0, 30.0)))
    every = np.ones(8, dtype=bool)
    assert extent(box, np.array([0.0, 5.0, 0.0]), every).length_mm == pytest.approx(20)
    assert extent(box, np.array([1.0, 0.0, 1.0]), every).length_mm == pytest.approx(40 / np.sqrt(2))


@pytest.mark.parametrize("kind", ["girth", "extent", "between"])
def test_a_tape_knows_how_its_length_answers_to_the_skin(kind):
    ball = trimesh.creation.icosphere(2, radius=40.0)
    mesh, rng = mesh_of(ball), np.random.default_rng(1)
    tape = {
        "girth": lambda: girth(mesh, np.zeros(3), np.array([0.3, -0.2, 1.0])),
        "extent": lambda: extent(mesh, np.array([1.0, 2.0, 0.5]), np.ones(len(mesh.vertices), dtype=bool)),
        "between": lambda: between(mesh, np.array([40.0, 0.0, 0.0]), np.array([0.0, 0.0, 40.0])),
    }[kind]()
    nudge = rng.normal(size=mesh.vertices.shape)
    a, b = tape.edges.T
    moved = (1 - tape.shares)[:, None] * nudge[a] + tape.shares[:, None] * nudge[b]
    along = np.array([1.0, 2.0, 0.5]) / np.linalg.norm([1.0, 2.0, 0.5])

    def length(step: float) -> float:
        line = tape.points + step * moved
        if kind == "extent":
            return float((line[1] - line[0]) @ along)
        ends = np.roll(line, -1, axis=0) if tape.closed else line[1:]
        return float(np.linalg.norm(ends - line[: len(ends)], axis=1).sum())

    assert length(0.0) == pytest.approx(tape.length_mm)
    slope = (length(1e-4) - length(-1e-4)) / 2e-4
    assert (tape.pull * moved).sum() == pytest.approx(slope, rel=1e-6)


def test_tape_points_are_shares_of_edges(woman):
    hand = woman.part("hand_left")
    for name in ("wrist", "ring_finger", "hand_length"):
        tape = MEASURES[name].read(hand, "left")
        a, b = (hand.mesh.vertices[column] for column in tape.edges.T)
        assert tape.points == pytest.approx((1 - tape.shares)[:, None] * a + tape.shares[:, None] * b)


def test_every_measure_is_taken_on_a_person_and_both_sides_are_alike(woman):
    found = measured(woman)
    assert set(found) == set(MEASURES)
    assert min(found.values()) > 40


def test_measures_scale_with_the_body(woman):
    twice = Body(
        "big",
        woman.mesh.with_vertices(1.25 * woman.mesh.vertices),
        {key: 1.25 * point for key, point in woman.landmarks.items()},
        {},
        "human",
        {key: 1.25 * point for key, point in woman.joints.items()},
        smoothing=1,
    )
    names = ("height", "pupils", "neck", "wrist", "ring_finger", "foot", "foot_girth")
    small, large = measured(woman, names), measured(twice, names)
    assert large == pytest.approx({key: 1.25 * value for key, value in small.items()}, rel=1e-6)


def test_a_part_has_only_its_own_measures(woman):
    assert set(tapes(woman.part("foot_right"))) == {"foot_right", "foot_width_right", "foot_girth_right"}
    assert "height" not in measured(woman.part("head"))


def test_a_bare_shape_has_no_measures():
    assert measured(Body("box", mesh_of(trimesh.creation.box((1, 1, 1))), {}, {}, "character")) == {}


def test_sides_belong_to_paired_measures_only():
    assert sided("wrist_left") == ("wrist", "left")
    assert sided("ring_finger") == ("ring_finger", "")
    assert sided("tail_left") == ("tail_left", "")


def test_a_folded_hand_is_the_tapes_or_seven_percent_larger(woman):
    assert folded_hand_mm(woman) == pytest.approx(1.07 * 187.0, abs=0.1)
    assert folded_hands(woman).keys() == {"hand_folded"}
    taped = human("woman", {"hand_folded": 195})
    assert folded_hand_mm(taped, "right") == 195
    assert taped.measures["hand_folded"] == Measured(195.0, 195.0)
    assert folded_hands(woman.part("foot_left")) == {}
