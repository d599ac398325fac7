from dataclasses import replace

import numpy as np
import pytest
from shells import assert_fits, assert_mirrored, assert_motifs_outside
from tried import assert_sound, built, skin, wearer

from fabcraft.check.topology import inspect_topology
from fabcraft.errors import InputError, SolidError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.solid.slots import with_straps
from fabcraft.template.kinds import kind_of

BODIES = ("child", "figure")


@pytest.mark.parametrize("body", BODIES)
def test_it_is_a_clean_solid_alike_on_both_sides(body):
    assert_sound(built("visor", body))
    assert_mirrored(built("visor", body).mesh)


@pytest.mark.parametrize("body", BODIES)
def test_it_keeps_its_clearance_and_wall_and_comes_off(body):
    assert_fits("visor", body)


def test_it_rests_on_the_forehead_and_before_the_ears():
    template = built("visor", "child")
    assert template.contacts == ("temple_left", "temple_right", "forehead")
    rest = template.body.mesh.vertices[template.body.regions["forehead"].vertex_indices]
    gaps = SurfaceDistance(template.mesh).closest(rest).distances
    assert np.median(gaps) < template.listed_mm[0] + 0.5


def test_the_brim_is_as_long_as_asked_in_front_and_runs_out_at_the_sides():
    template = built("visor", "child")
    short = built("visor", "child", brim=30.0)
    longer = short.mesh.vertices[:, 1].min() - template.mesh.vertices[:, 1].min()
    assert longer == pytest.approx(template.parameters["brim"] - 30.0, abs=3.0)
    # at the temples nothing is farther out than the band is
    side = template.mesh.vertices[
        np.abs(template.mesh.vertices[:, 1] - template.body.landmarks["vertex"][1]) < 8.0
    ]
    assert skin("visor", "child").signed(side).max() < 8.0


def test_closed_it_is_a_ring_without_slots():
    closed = built("visor", "child", open=0.0)
    assert closed.genus == 1
    assert_sound(closed)
    assert closed.straps == ()
    assert closed.holds and not built("visor", "child").holds  # the head goes through a ring


def test_the_elastic_has_a_slot_at_either_end_of_an_open_band():
    template = built("visor", "child")
    cut = with_straps(template.mesh, template.straps)
    found = inspect_topology(cut)
    assert found.solid
    assert found.genus == template.genus + 2
    lost = template.mesh.volume_mm3 - cut.volume_mm3
    one = template.straps[0]
    stadium = (one.length_mm - one.width_mm) * one.width_mm + 0.25 * np.pi * one.width_mm**2
    assert lost == pytest.approx(2.0 * stadium * template.wall_mm, rel=0.1)
    right, left = (strap.centre for strap in template.straps)
    assert right == pytest.approx(left * [-1.0, 1.0, 1.0])
    assert right[0] < 0.0


def test_a_slot_that_misses_the_wall_is_refused():
    template = built("visor", "child")
    astray = replace(template.straps[0], centre=template.straps[0].centre + [0.0, 0.0, 500.0])
    with pytest.raises(SolidError, match="slot"):
        with_straps(template.mesh, (astray,))


def test_its_motif_frame_is_rolled_around_the_front_of_the_band():
    template = built("visor", "child")
    assert_motifs_outside(template, "front")
    front, crown = template.motifs
    assert (crown.name, crown.reading) == ("crown", "object")
    assert front.outward[1] < -0.9
    point, way = front.axis
    away = front.origin - point
    assert away @ way == pytest.approx(0.15 * template.parameters["band"], abs=1e-6)


def test_a_brim_that_a_face_stands_in_the_way_of_is_refused():
    with pytest.raises(InputError, match="stands in the way"):
        kind_of("visor").build(wearer("figure"), {"tilt": 20.0})


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"brim": 500.0}, "5 to 110 mm"),
        ({"open": 200.0}, "0 to 150 deg"),
        ({"size": "S"}, "hat"),
        ({"spred": 60.0}, "Did you mean spread"),
    ],
)
def test_settings_out_of_range_are_refused_with_the_range(settings, says):
    with pytest.raises(InputError) as refused:
        kind_of("visor").build(wearer("man"), settings)
    assert says in str(refused.value)


def test_a_character_looks_out_from_under_its_brim():
    visor = built("visor", "figure")
    eye, vertices = visor.body.landmarks["eye_left"], visor.mesh.vertices
    ball = visor.body.mesh.vertices[visor.body.regions["eye_left"].vertex_indices]
    before = (vertices[:, 1] < eye[1]) & (np.abs(vertices[:, 0] - eye[0]) < visor.edge_mm)
    assert vertices[before, 2].min() > eye[2] + 0.55 * np.linalg.norm(ball - eye, axis=1).max()
