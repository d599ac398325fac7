"""The bangle and the cuff on the wrists of a man, a child and a figure."""

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
    sharpest_mm,
    skin,
    taken_off,
)

from fabcraft.errors import InputError
from fabcraft.template.bangle import KIND, diameter_mm
from fabcraft.wearer import find_body

CASES = {
    "closed": ("child", {}),
    "closed, of a figure": ("figure", {}),
    "open": ("man", {"style": "open"}),
}


@pytest.mark.parametrize("case", CASES)
def test_a_bangle_keeps_what_its_template_lists(case):
    wearer, settings = CASES[case]
    bangle, wrist = built("bangle", wearer, **settings), skin("bangle", wearer, **settings)
    assert_sound(bangle)
    assert_seated(bangle, wrist)
    assert_comes_off(bangle)
    assert_frames_look_outward(bangle, wrist)


def test_the_wall_is_as_thick_as_listed():
    assert_walled(built("bangle", "figure"))


def test_edges_on_the_wrist_are_rounded():
    assert sharpest_mm(built("bangle", "child"), 2.0, skin("bangle", "child")) >= ROUND_MM
    cuff = {"style": "open"}
    assert sharpest_mm(built("bangle", "man", **cuff), 4.0, skin("bangle", "man", **cuff)) >= ROUND_MM


def test_indian_sizes_are_sixteenths_of_an_inch_over_two():
    for size, across in {"2-2": 53.98, "2-4": 57.15, "2-10": 66.68, 61.0: 61.0}.items():
        assert diameter_mm(size) == pytest.approx(across, abs=0.01)


def test_a_size_is_the_inner_diameter():
    bangle = built("bangle", "child", size="2-4")
    assert inner_girth_mm(bangle, np.array(bangle.donning)) == pytest.approx(np.pi * 57.15, abs=0.4)


def test_a_bangle_smaller_than_the_hand_sticks_on_the_hand():
    bangle = built("bangle", "child")
    inside, hand = np.pi * bangle.parameters["size"], bangle.parameters["folded_hand"]
    small = narrowed(bangle.mesh, np.array(bangle.donning), (hand - 8.0) / inside)
    tried = taken_off(bangle, small)
    joints, ahead = bangle.body.joints, np.array(bangle.donning)
    wrist, knuckles = joints["wrist_left"] @ ahead, joints["finger3_1_left"] @ ahead
    assert not tried.donnable
    assert tried.stuck_pose > 10
    assert wrist < np.array(tried.stuck_place) @ ahead < knuckles + 10.0


def test_a_size_below_the_hands_is_refused_with_the_one_that_fits():
    with pytest.raises(InputError, match="does not go over the folded hand") as refused:
        built("bangle", "man", size="2-2")
    assert "size 2-" in str(refused.value) and "style=open" in str(refused.value)


def test_a_gap_that_does_not_let_the_wrist_through_is_refused():
    with pytest.raises(InputError, match="does not let the wrist through"):
        built("bangle", "man", style="open", gap=12.0)


def test_a_gap_is_as_wide_as_asked():
    cuff = built("bangle", "man", style="open", gap=40.0)
    ends = cuff.mesh.vertices - cuff.mesh.vertices.mean(0)
    gap_side = ends @ -cuff.motifs[0].outward
    across = ends[gap_side > 0.6 * gap_side.max()] @ cuff.motifs[0].right
    assert across[across > 0].min() - across[across < 0].max() == pytest.approx(40.0, abs=1.5)


@pytest.mark.parametrize(
    ("setting", "hint"), [({"width": 2.0}, "4 to 60 mm"), ({"style": "hinged"}, "closed or open")]
)
def test_settings_out_of_range_are_refused_with_the_range(setting, hint):
    with pytest.raises(InputError) as refused:
        KIND.build(find_body("child"), setting)
    assert hint in str(refused.value)
