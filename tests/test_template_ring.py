"""The ring on the hands of a man and a child."""

import numpy as np
import pytest
from tried import (
    ROUND_MM,
    assert_comes_off,
    assert_frames_look_outward,
    assert_seated,
    assert_sound,
    assert_walled,
    built,
    inner_girth_mm,
    narrowed,
    pressed_mm,
    sharpest_mm,
    skin,
    taken_off,
)

from fabcraft.errors import InputError
from fabcraft.template.ring import KIND
from fabcraft.wearer import find_body


@pytest.mark.parametrize("wearer", ["man", "child"])
def test_a_ring_keeps_what_its_template_lists(wearer):
    ring, finger = built("ring", wearer), skin("ring", wearer)
    assert_sound(ring)
    assert_seated(ring, finger)
    assert_comes_off(ring)
    assert_frames_look_outward(ring, finger)


def test_the_wall_is_as_thick_as_listed():
    assert_walled(built("ring", "child"))


def test_edges_on_the_finger_are_rounded():
    assert sharpest_mm(built("ring", "man"), 1.0, skin("ring", "man")) >= ROUND_MM


@pytest.mark.parametrize(("size", "girth_mm"), [("ISO 54", 54.0), ("US 7", 54.35)])
def test_a_size_is_the_inner_girth(size, girth_mm):
    ring = built("ring", "child", size=size)
    assert ring.parameters["size"] == pytest.approx(girth_mm, abs=0.01)
    assert inner_girth_mm(ring, np.array(ring.donning)) == pytest.approx(girth_mm, abs=0.3)


def test_the_ring_passes_the_knuckle_with_a_third_in_reserve():
    ring = built("ring", "man")
    assert pressed_mm(ring) < 0.75 * ring.path.allowed_mm
    assert ring.parameters["size"] > ring.parameters["knuckle"] + 0.6


def test_a_ring_1_mm_too_small_sticks_at_the_knuckle():
    ring = built("ring", "man")
    size = ring.parameters["size"]
    small = narrowed(ring.mesh, np.array(ring.donning), (size - 1.0) / size)
    tried = taken_off(ring, small)
    knuckle = ring.body.joints["finger4_2_left"]
    assert not tried.donnable
    assert 0 < tried.stuck_pose < 15
    assert np.linalg.norm(np.array(tried.stuck_place) - knuckle) < 16.0
    assert tried.stuck_at_mm == pytest.approx(
        np.linalg.norm(knuckle - ring.mesh.vertices.mean(0)), abs=6.0
    )  # the way from the seat


def test_a_taped_knuckle_makes_the_ring_larger():
    taped = built("ring", "child", knuckle=52.0)
    assert taped.parameters["size"] > 52.0 > built("ring", "child").parameters["size"]
    assert taped.path.through is not None
    assert_comes_off(taped)


def test_a_size_below_the_knuckles_is_refused_with_the_one_that_fits():
    with pytest.raises(InputError, match="does not go on this finger") as refused:
        built("ring", "child", size="ISO 42")
    assert "ISO 46" in str(refused.value) or "ISO 47" in str(refused.value)


def test_the_right_hand_can_wear_it():
    left, right = built("ring", "child"), built("ring", "child", hand="right")
    assert right.contacts == ("ring_finger_right",)
    assert right.mesh.vertices[:, 0].max() < 0.0 < left.mesh.vertices[:, 0].min()


def test_settings_out_of_range_are_refused_with_the_range():
    with pytest.raises(InputError, match="width = 30") as refused:
        KIND.build(find_body("child"), {"width": 30.0})
    assert "2 to 12 mm" in str(refused.value)


def test_a_body_without_fingers_is_refused_with_the_reason():
    with pytest.raises(InputError, match="hands have no fingers"):
        built("ring", "figure")
