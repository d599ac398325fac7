"""Glasses on a child's face, and the drawing of their front."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
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
from fabcraft.template.glasses import KIND
from fabcraft.template.lenses import SHAPES, FrontSizes, blank, lens_outline
from fabcraft.wearer import find_body

SET = {"size": "44-16-125", "groove": 0.8}
SIZES = FrontSizes(50.0, 38.0, 18.0, 3.5, 68.0, 9.5)


def test_glasses_keep_what_their_template_lists():
    glasses, face = built("glasses", "child"), skin("glasses", "child")
    assert_sound(glasses)
    assert_seated(glasses, face)
    assert_comes_off(glasses)
    assert_frames_look_outward(glasses, face)
    assert not glasses.holds  # temples follow the ears by their contacts


def test_rims_and_temples_are_as_thick_as_listed():
    assert_walled(built("glasses", "child"))


def test_edges_on_the_skin_are_rounded():
    assert sharpest_mm(built("glasses", "child"), 1.5, skin("glasses", "child")) >= ROUND_MM


def test_they_are_symmetric_to_the_middle_of_the_face():
    vertices = built("glasses", "child").mesh.vertices
    assert cKDTree(vertices).query(vertices * [-1.0, 1.0, 1.0])[0].max() < 1e-6


def test_they_sit_on_nose_and_ears():
    glasses = built("glasses", "child")
    own = SurfaceDistance(glasses.mesh)
    for name in ("nose_flank_left", "nose_flank_right", "ear_root_left", "ear_root_right"):
        region = glasses.body.regions[name]
        assert own.signed(glasses.body.mesh.vertices[region.vertex_indices]).min() < 0.6


def test_the_eyes_look_through_the_lenses():
    glasses = built("glasses", "child")
    front = glasses.motifs[1]
    for eye, opening in zip(("eye_right", "eye_left"), front.openings, strict=True):
        away = glasses.body.landmarks[eye] - front.origin
        seen = np.array([away @ front.right, away @ front.up])
        low, high = opening.min(0), opening.max(0)
        assert (low + 0.25 * (high - low) < seen).all() and (seen < high - 0.25 * (high - low)).all()


def test_a_groove_for_lenses_is_cut_into_the_rim():
    grooved = built("glasses", "child", **SET)
    assert_sound(grooved)
    assert grooved.wall_mm == pytest.approx(3.5 - 0.8)
    front = grooved.motifs[1]
    low = front.openings[1][front.openings[1][:, 1].argmin()]
    away = grooved.mesh.vertices - front.origin
    u, v, w = (away @ axis for axis in (front.right, front.up, front.outward))
    under = (np.abs(u - low[0]) < 4.0) & (np.abs(v - low[1]) < 1.5)
    middle = w[under & (v > low[1] - 0.1)].mean()  # of the two walls beside the groove
    assert v[under & (np.abs(w - middle) < 0.3)].min() == pytest.approx(low[1] - 0.8, abs=0.15)


def test_a_groove_deeper_than_the_rim_allows_is_refused():
    with pytest.raises(InputError, match="does not fit into a rim of 2 x 4 mm"):
        built("glasses", "child", groove=1.0, rim=2.0)


def test_the_printed_size_names_lens_bridge_and_temple():
    glasses = built("glasses", "child", **SET)
    made = [glasses.parameters[name] for name in ("lens_width", "bridge", "temple_length")]
    np.testing.assert_allclose(made, [44.0, 16.0, 125.0], atol=2.0)
    assert np.ptp(glasses.motifs[1].openings[0][:, 0]) == pytest.approx(44.0, abs=0.1)
    with pytest.raises(InputError, match="52-18-140"):
        KIND.build(find_body("child"), {"size": "large"})


@pytest.mark.parametrize("shape", SHAPES)
def test_a_lens_fills_its_box_and_its_rim_is_nowhere_narrower_than_asked(shape):
    lens = lens_outline(shape, SIZES)
    np.testing.assert_allclose(lens.min(0), [9.0, -19.0], atol=1e-6)
    np.testing.assert_allclose(lens.max(0), [59.0, 19.0], atol=1e-6)
    outline = blank(lens, SIZES).outline(np.zeros((0, 2)))
    assert outline[0, 0] == 0.0 == outline[-1, 0] and outline[0, 1] < outline[-1, 1]
    assert cKDTree(lens).query(outline)[0].min() > 0.97 * SIZES.rim


def test_a_front_is_cut_out_for_the_nose():
    drawn = blank(lens_outline("panto", SIZES), SIZES)
    nose = np.array([[-25.0, 9.0], [0.0, 5.0], [3.0, 0.0]])
    cut = drawn.outline(nose)
    below = cut[(cut[:, 1] < 0.0) & (cut[:, 0] < 20.0)]
    assert (below[:, 0] > np.interp(below[:, 1], nose[:, 0], nose[:, 1]) - 0.2).all()


def test_settings_out_of_range_are_refused_with_the_range():
    with pytest.raises(InputError, match="bridge = 40") as refused:
        KIND.settled({"bridge": 40.0})
    assert "4 to 30 mm" in str(refused.value)
    with pytest.raises(InputError, match="shape = star"):
        KIND.settled({"shape": "star"})
