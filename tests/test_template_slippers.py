import numpy as np
import pytest
from shells import assert_fits, assert_motifs_outside
from tried import assert_sound, built, skin, wearer

from fabcraft.errors import InputError
from fabcraft.template.kinds import kind_of

BODIES = ("man", "figure")


@pytest.mark.parametrize("body", BODIES)
def test_it_is_a_clean_solid(body):
    assert_sound(built("slippers", body))


@pytest.mark.parametrize("body", BODIES)
def test_it_keeps_its_clearance_and_wall_and_comes_off(body):
    assert_fits("slippers", body)


def test_the_right_one_is_the_mirror_image_of_the_left_one():
    left, right = built("slippers", "figure"), built("slippers", "figure", side="right")
    assert left.pair
    assert left.mesh.vertices[:, 0].min() > -1.0
    image = left.mesh.bounds * [-1.0, 1.0, 1.0]
    assert np.sort(image, axis=0) == pytest.approx(right.mesh.bounds, abs=0.2)
    assert right.mesh.volume_mm3 == pytest.approx(left.mesh.volume_mm3, rel=0.01)


def test_the_foot_stands_on_a_level_bed_over_a_sole_as_thick_as_listed():
    template = built("slippers", "man")
    heel = template.body.landmarks["heel_left"] + [0.0, -35.0, 0.0]
    middles = template.mesh.corners.mean(1)
    near = np.hypot(*(middles - heel)[:, :2].T) < 8.0
    bed, under = middles[near & template.locked], middles[near & (template.mesh.face_normals[:, 2] < -0.9)]
    assert np.ptp(bed[:, 2]) < 0.5
    assert bed[:, 2].mean() - under[:, 2].mean() == pytest.approx(template.parameters["sole"], abs=0.5)
    assert 0.0 < skin("slippers", "man").signed(template.mesh.vertices).min() < 0.1


def test_there_is_room_before_the_toes_and_the_heel_is_free():
    template = built("slippers", "man")
    foot, made = template.body.mesh.bounds, template.mesh.bounds
    before = foot[0, 1] - made[0, 1]
    assert before > template.parameters["toe"] - 1.0
    assert before < template.parameters["toe"] + 3.0 * template.parameters["wall"]
    behind = template.mesh.vertices[template.mesh.vertices[:, 1] > foot[0, 1] + 0.6 * np.ptp(foot[:, 1])]
    assert behind[:, 2].max() < foot[0, 2] + 15.0


def test_shoe_sizes_are_lengths_of_feet():
    template = built("slippers", "man", size="EU46")
    assert template.parameters["size"] == pytest.approx(46 * 20.0 / 3.0 - 12.5)
    longer = np.ptp(template.mesh.vertices[:, 1]) - np.ptp(built("slippers", "man").mesh.vertices[:, 1])
    asked = template.parameters["size"] - built("slippers", "man").parameters["size"]
    assert longer == pytest.approx(asked, abs=4.0)


def test_its_motif_frames_look_outward():
    template = built("slippers", "man")
    toe, ears, sole = template.motifs
    assert (toe.name, ears.name, sole.name, sole.reading) == ("toe", "ears", "sole", "object")
    assert toe.outward[2] > 0.5
    assert toe.outward[1] < 0.0
    assert_motifs_outside(template, "toe", "ears")


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"cover": 90.0}, "35 to 65 %"),
        ({"side": "both"}, "left or right"),
        ({"size": "EU20"}, "or larger"),
        ({"soles": 8.0}, "Did you mean sole"),
    ],
)
def test_settings_out_of_range_are_refused_with_the_range(settings, says):
    with pytest.raises(InputError) as refused:
        kind_of("slippers").build(wearer("man"), settings)
    assert says in str(refused.value)
