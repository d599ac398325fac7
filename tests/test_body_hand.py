"""The relaxed hand: bent fingers, the same bones, the same girths."""

import numpy as np
import pytest
import trimesh

from fabcraft.body.human import human
from fabcraft.body.measures import measured


@pytest.fixture(scope="module")
def hands():
    return {pose: human("woman", hand=pose) for pose in ("flat", "relaxed")}


def test_a_relaxed_hand_is_closed_and_of_genus_zero(hands):
    for side in ("left", "right"):
        mesh = hands["relaxed"].part(f"hand_{side}").mesh
        solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        assert solid.is_watertight
        assert solid.euler_number == 2


def test_its_faces_do_not_cross():
    import igl.copyleft.cgal as cgal

    for name in ("man", "woman", "toddler"):
        mesh = human(name, hand="relaxed").part("hand_left").mesh
        crossing = cgal.remesh_self_intersections(
            np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int64), detect_only=True
        )[2]
        assert len(crossing) == 0, name


def test_fingers_bend_towards_the_palm_and_keep_their_length(hands):
    flat, relaxed = hands["flat"], hands["relaxed"]
    for side in ("left", "right"):
        palm = flat.landmarks[f"wrist_palm_{side}"] - flat.landmarks[f"wrist_back_{side}"]
        for tip in ("ring_finger_tip", "middle_finger_tip"):
            moved = relaxed.landmarks[f"{tip}_{side}"] - flat.landmarks[f"{tip}_{side}"]
            assert moved @ palm / np.linalg.norm(palm) > 15, tip
        for finger in (1, 2, 3, 4, 5):
            for bone in (1, 2):
                lengths = [
                    np.linalg.norm(
                        one.joints[f"finger{finger}_{bone + 1}_{side}"]
                        - one.joints[f"finger{finger}_{bone}_{side}"]
                    )
                    for one in (flat, relaxed)
                ]
                assert lengths[1] == pytest.approx(lengths[0], rel=1e-4)


def test_girths_stay_what_they_are(hands):
    names = ("ring_finger", "ring_knuckle", "wrist")
    flat, relaxed = (measured(hands[pose], names) for pose in ("flat", "relaxed"))
    assert relaxed["ring_finger"] == pytest.approx(flat["ring_finger"], abs=0.5)
    assert relaxed["wrist"] == pytest.approx(flat["wrist"], abs=0.1)
    assert relaxed["ring_knuckle"] == pytest.approx(flat["ring_knuckle"], abs=2.0)  # a bent joint is thicker


def test_right_mirrors_left(hands):
    body = hands["relaxed"]
    for key in ("ring_finger_tip", "thumb_tip", "index_knuckle"):
        left, right = body.landmarks[f"{key}_left"], body.landmarks[f"{key}_right"]
        assert right == pytest.approx(left * [-1, 1, 1], abs=1e-3)


def test_nothing_but_the_hands_moves(hands):
    moved = np.linalg.norm(hands["relaxed"].mesh.vertices - hands["flat"].mesh.vertices, axis=1) > 1e-6
    wrist = hands["flat"].joints["wrist_left"]
    away = hands["flat"].mesh.vertices[moved]
    away = np.linalg.norm(away * np.sign(away[:, :1]) ** [1, 0, 0] - wrist, axis=1)
    assert away.max() < 200
    assert 0.1 < moved.mean() < 0.35


def test_measures_and_poses_go_together():
    body = human("man", {"ring_finger": 60}, hand="relaxed")
    assert body.measures["ring_finger"].reached_mm == pytest.approx(60, abs=0.05)
    assert measured(body, ("ring_finger",))["ring_finger"] == pytest.approx(60, abs=0.6)
