import numpy as np
import pytest
from shells import assert_fits, assert_mirrored, assert_motifs_outside
from tried import assert_sound, built, skin, wearer

from fabcraft.check.wear import measure_path
from fabcraft.errors import InputError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.template.headwear import hat_mm
from fabcraft.template.kinds import kind_of

BODIES = ("man", "figure")


@pytest.mark.parametrize("body", BODIES)
def test_it_is_a_clean_solid_alike_on_both_sides(body):
    assert_sound(built("helmet", body))
    assert_mirrored(built("helmet", body).mesh)


@pytest.mark.parametrize("body", BODIES)
def test_it_keeps_its_clearance_and_wall_and_comes_off(body):
    assert_fits("helmet", body)


def test_the_head_fills_its_cavity():
    template = built("helmet", "man")
    inside = SurfaceDistance(template.mesh)
    crown = template.body.landmarks["vertex"]
    assert inside.signed(crown[None])[0] > 0.0  # not in the material,
    up = crown + np.array([[0.0, 0.0, template.listed_mm[1] + 0.5 * template.wall_mm]])
    assert -0.7 * template.wall_mm < inside.signed(up)[0] < 1.0  # but under it
    # the shell around the head is as large as the skull that it covers, and the room to it
    rim = template.mesh.vertices[:, 2].min()
    head = template.body.mesh.vertices
    covered = head[head[:, 2] > template.body.landmarks["glabella"][2] + 30.0]
    size = template.mesh.vertices.max(0) - template.mesh.vertices.min(0)
    assert (size[:2] > np.ptp(covered[:, :2], axis=0) + 2.0 * template.wall_mm).all()
    assert rim < template.body.landmarks["ear_tip_left"][2]


def test_the_skin_is_about_the_room_away_that_is_listed():
    template = built("helmet", "man")
    middles = template.mesh.corners.mean(1)[template.locked]
    away = skin("helmet", "man").signed(middles)
    near = away[away < 15.0]
    assert np.median(near) == pytest.approx(template.listed_mm[1], abs=0.5)


def test_the_rim_is_a_brim_that_stands_out_most_in_front():
    mesh, plain = built("helmet", "man").mesh, built("helmet", "man", peak=0.0, brim=0.0).mesh
    assert mesh.vertices[:, 1].min() < plain.vertices[:, 1].min() - 8.0
    assert 0.5 < mesh.vertices[:, 0].max() - plain.vertices[:, 0].max() < 6.0


def test_its_motif_frames_look_outward():
    assert_motifs_outside(built("helmet", "man"), "brow", "crown")
    brow, crown, crest = built("helmet", "man").motifs
    assert brow.outward[1] < -0.7
    assert crown.outward[2] > 0.99
    assert (crest.name, crest.reading) == ("crest", "object") and crest.outward[0] == 1.0


def test_a_helmet_with_an_undercut_is_refused_where_it_sticks():
    template = built("helmet", "man", nape=80.0)
    vertices = np.array(template.mesh.vertices)
    left = skin("helmet", "man").closest(vertices)
    # a tooth behind, under the widest part of the head: its inner side comes to a millimetre from the skin there
    inner = np.unique(template.mesh.faces[template.locked])
    tooth = inner[(vertices[inner, 1] > 20.0) & (vertices[inner, 2] < vertices[:, 2].min() + 12.0)]
    vertices[tooth] += (1.0 - 1.0 / left.distances[tooth, None]) * (left.points[tooth] - vertices[tooth])
    bad = template.mesh.with_vertices(vertices)
    assert skin("helmet", "man").signed(bad.vertices).min() > 0.0  # it sits well,
    path = template.path
    found = measure_path(bad, skin("helmet", "man"), path.poses, path.allowed_mm)
    assert not found.donnable  # and does not come off:
    assert 0 < found.stuck_pose < found.poses - 1
    assert found.pen_max_mm > path.allowed_mm + 1.0
    assert 5.0 < found.stuck_at_mm < 100.0
    place = np.array(found.stuck_place)
    assert place[1] > 20.0  # on the back of the head,
    assert place[2] > vertices[tooth, 2].mean()  # over where the tooth sits


def test_hat_sizes_are_circumferences():
    assert hat_mm("M") == 570.0
    assert hat_mm("hat57") == pytest.approx(570.0)
    assert hat_mm("US 7 1/8") == pytest.approx(np.pi * 25.4 * 7.125, abs=1.0)
    assert hat_mm(588.0) == 588.0


def test_a_larger_hat_size_is_wider():
    one, other = built("helmet", "man"), built("helmet", "man", size="XL")
    assert other.parameters["size"] == 610.0
    wider = np.ptp(other.mesh.vertices[:, 0]) - np.ptp(one.mesh.vertices[:, 0])
    assert wider == pytest.approx((610.0 - one.parameters["size"]) / np.pi, rel=0.4)


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"wall": 0.5}, "1.6 to 8 mm"),
        ({"peak": 90.0}, "0 to 40 mm"),
        ({"fit": "loose"}, "padded or show"),
        ({"brimm": 3.0}, "Did you mean brim"),
        ({"size": "hat40"}, "larger"),
    ],
)
def test_settings_out_of_range_are_refused_with_the_range(settings, says):
    with pytest.raises(InputError) as refused:
        kind_of("helmet").build(wearer("man"), settings)
    assert says in str(refused.value)
