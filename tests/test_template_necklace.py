"""The necklace round a child's neck: a collar that opens, and one that goes over the head."""

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
    sharpest_mm,
    skin,
)

from fabcraft.errors import InputError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.template.necklace import KIND, SIZES, length_mm
from fabcraft.wearer import find_body

STYLES = {"open": {}, "closed": {"style": "closed", "drop": 0.0}}


@pytest.mark.parametrize("style", STYLES)
def test_a_necklace_keeps_what_its_template_lists(style):
    necklace, neck = built("necklace", "child", **STYLES[style]), skin("necklace", "child", **STYLES[style])
    assert necklace.genus == (0 if style == "open" else 1)
    assert_sound(necklace)
    assert_seated(necklace, neck)
    assert_comes_off(necklace)
    assert_frames_look_outward(necklace, neck)
    assert necklace.holds == (style == "closed")  # the head goes through it


def test_it_rests_on_the_body():
    surface = skin("necklace", "child").signed(built("necklace", "child").mesh.vertices)
    assert surface.min() < 0.7


def test_tube_and_pendant_are_as_thick_as_listed():
    assert_walled(built("necklace", "child"))


def test_edges_on_the_skin_are_rounded():
    assert sharpest_mm(built("necklace", "child"), 4.0, skin("necklace", "child")) >= ROUND_MM


def test_it_is_symmetric_but_for_the_chords_of_its_fillet():
    necklace = built("necklace", "child")
    other = necklace.mesh.vertices * [-1.0, 1.0, 1.0]
    apart = np.abs(SurfaceDistance(necklace.mesh).signed(other))
    assert apart.max() < 0.15 * necklace.edge_mm and np.quantile(apart, 0.99) < 0.05 * necklace.edge_mm


def test_the_pendant_hangs_before_the_chest_below_the_tube():
    necklace = built("necklace", "child")
    frame = necklace.motifs[0]
    behind = skin("necklace", "child").signed(frame.origin[None])[0]
    assert frame.outward[1] < -0.5 and abs(frame.origin[0]) < 1e-6
    assert 0.75 * necklace.parameters["tube"] < behind < 15.0
    assert frame.origin[2] < necklace.mesh.vertices[:, 2].min() + frame.size_mm[1]


def test_usual_sizes_lie_within_their_ranges():
    ranges = {"collar": (305, 330), "choker": (355, 405), "princess": (430, 480), "matinee": (510, 610)}
    assert SIZES.keys() == ranges.keys()
    for name, (low, high) in ranges.items():
        assert low <= length_mm(name) <= high
    with pytest.raises(InputError, match="no necklace size 'opera'"):
        length_mm("opera")


def test_a_closed_one_that_is_too_short_for_the_head_is_refused():
    with pytest.raises(InputError, match="does not go over the head") as refused:
        built("necklace", "child", style="closed", size="choker")
    assert "style=open" in str(refused.value)


def test_a_gap_that_does_not_let_the_neck_through_is_refused():
    with pytest.raises(InputError, match="does not let the neck through"):
        built("necklace", "child", gap=20.0)


def test_settings_out_of_range_are_refused_with_the_range():
    with pytest.raises(InputError, match="tube = 20") as refused:
        KIND.settled({"tube": 20.0})
    assert "2.4 to 14 mm" in str(refused.value)


def test_a_body_without_a_neck_is_refused_with_the_reason():
    with pytest.raises(InputError, match="there is no neck to go round"):
        KIND.build(find_body("figure"), {})
