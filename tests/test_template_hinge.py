"""Hinges of glasses: on a child's glasses, and on a straight temple."""

import manifold3d
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tried import assert_comes_off, assert_seated, assert_sound, assert_walled, built, skin

from fabcraft.check.gap import measure_gaps
from fabcraft.check.topology import inspect_topology
from fabcraft.errors import InputError, SolidError
from fabcraft.profile import load_profile
from fabcraft.recipe import Recipe
from fabcraft.road.base import asked
from fabcraft.solid.manifolds import joined, part_count, to_manifold, to_mesh, without_specks
from fabcraft.solid.simplify import simplify_manifold
from fabcraft.template.glasses import KIND
from fabcraft.template.hinge import PLAY_MM, SCREW_MM, hinge_of, hinged
from fabcraft.template.temples import Temple

STYLES = {"pin": [1, 4, 1], "screw": [1, 6, 1]}
"""Genus of the right temple, the front with its two lens openings, and the left temple."""


def straight(thickness, length=60.0):
    """A level temple that leads straight back."""
    line = np.column_stack([np.full(121, 40.0), np.linspace(0.0, length, 121), np.zeros(121)])
    return Temple(line, np.full(121, 1.4 * thickness), thickness)


def bodies(mesh):
    """The wearer's right temple, the front, and the left temple."""
    found = to_manifold(mesh).decompose()
    return sorted(found, key=lambda one: one.bounding_box()[0] + one.bounding_box()[3])


def turned(part, axis, angle_deg):
    turn = Rotation.from_rotvec(np.radians(angle_deg) * axis.along).as_matrix()
    return part.transform(np.column_stack([turn, axis.point - turn @ axis.point]))


@pytest.fixture(params=STYLES)
def style(request):
    return request.param


def test_hinged_glasses_are_three_sound_bodies_of_known_genus(style):
    glasses = built("glasses", "child", hinge=style)
    assert_sound(glasses)
    found = inspect_topology(glasses.mesh)
    assert found.degenerate_faces == 0 and found.manifold_status == "NoError"
    assert [one.genus() for one in bodies(glasses.mesh)] == STYLES[style]
    assert glasses.genus == sum(STYLES[style]) and glasses.parts == 3


def test_the_wall_listed_is_that_of_the_hinge():
    glasses = built("glasses", "child", hinge="pin")
    assert glasses.wall_mm == pytest.approx(1.4)
    assert_walled(glasses)


def test_hinged_glasses_are_worn_as_rigid_ones(style):
    glasses = built("glasses", "child", hinge=style)
    assert_seated(glasses, skin("glasses", "child", hinge=style))
    assert_comes_off(glasses)


def test_both_temples_fold_and_keep_their_clearance_at_every_angle(style):
    glasses = built("glasses", "child", hinge=style)
    right, front, left = bodies(glasses.mesh)
    for temple, axis, other in ((right, glasses.hinges[0], left), (left, glasses.hinges[1], right)):
        for angle in (0.0, 3.0, 10.0, 20.0, 35.0, 50.0, 65.0, 75.0, 85.0):
            now = turned(temple, axis, angle)
            assert (now ^ front).volume() == 0.0 == (now ^ other).volume()
            assert now.min_gap(front, 1.0) > 0.95 * PLAY_MM
        assert axis.folds_deg == 85.0
        folded = turned(temple, axis, 85.0).bounding_box()
        assert folded[4] - folded[1] < 0.5 * np.ptp(glasses.mesh.vertices[:, 1])


def test_a_temple_does_not_open_outwards(style):
    glasses = built("glasses", "child", hinge=style)
    _, front, left = bodies(glasses.mesh)
    assert (turned(left, glasses.hinges[1], -12.0) ^ front).volume() > 0.01


def test_what_moves_keeps_the_clearance_of_the_printer():
    assert KIND.playing({"hinge": "pin"}, 0.6) == {"hinge": "pin", "hinge_play": 0.6}
    assert KIND.playing({"hinge_play": 0.3}, 0.6) == {"hinge_play": 0.3}
    assert KIND.playing({}, 9.0)["hinge_play"] == 1.0
    glasses = built("glasses", "child", hinge="pin")
    parts = inspect_topology(glasses.mesh).part_of_face
    assert glasses.parameters["hinge_play"] == PLAY_MM
    assert measure_gaps(glasses.mesh, parts, PLAY_MM, 0.4).between_mm is None
    assert measure_gaps(glasses.mesh, parts, PLAY_MM + 0.2, 0.4).between_mm == pytest.approx(
        PLAY_MM, abs=0.02
    )


def test_a_recipe_hands_the_clearance_of_its_printer_on():
    profile = load_profile("sls-pa12")
    assert asked(Recipe(template="glasses"), profile) == {"hinge_play": profile.clearance_moving_mm}
    assert asked(Recipe(template="ring", parameters={"width": 5.0}), profile) == {"width": 5.0}


def test_the_pin_holds_the_temple_and_a_screw_passes():
    for name, held in (("pin", True), ("screw", False)):
        glasses = built("glasses", "child", hinge=name)
        _, front, left = bodies(glasses.mesh)
        axis = glasses.hinges[1]
        along = np.column_stack([np.linalg.svd(axis.along[None])[2][1:].T, axis.along])
        along[:, 0] *= np.sign(np.linalg.det(along))
        screw = manifold3d.Manifold.cylinder(20.0, 0.49 * SCREW_MM, center=True)
        screw = screw.transform(np.column_stack([along, axis.point]))
        assert (screw ^ left).volume() == 0.0
        assert ((screw ^ front).volume() > 5.0) == held
        for away in np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False):  # it comes out nowhere
            moved = left.translate(tuple(1.2 * (along[:, :2] @ [np.cos(away), np.sin(away)])))
            assert not held or (moved ^ front).volume() > 0.0


def test_hinged_glasses_are_symmetric_to_the_middle_of_the_face():
    right, _, left = bodies(built("glasses", "child", hinge="pin").mesh)
    assert (right.mirror((1.0, 0.0, 0.0)) - left).volume() == pytest.approx(0.0, abs=1e-6)


def test_what_finishes_a_solid_keeps_the_three_bodies_apart(style):
    whole = to_manifold(built("glasses", "child", hinge=style).mesh)
    kept, dropped = without_specks(whole, 0.5)
    assert dropped == 0 and part_count(kept) == 3
    fewer, _ = simplify_manifold(kept, 0.01)
    right, front, left = bodies(fewer)
    assert min(right.min_gap(front, 1.0), left.min_gap(front, 1.0)) > 0.95 * PLAY_MM
    assert [right.genus(), front.genus(), left.genus()] == STYLES[style]


def test_a_plate_is_made_one_with_one_part_only():
    cube = manifold3d.Manifold.cube((10.0, 10.0, 4.0))
    carrier = to_mesh(cube + cube.translate((10.0 + PLAY_MM, 0.0, 0.0)), "pair")
    plate = manifold3d.Manifold.cube((4.0, 4.0, 2.0))
    assert part_count(joined(carrier, to_mesh(plate.translate((3.0, 3.0, 3.0))))) == 2
    for across in (8.0, 6.3):  # over both, and nearer to the other than a printer keeps apart
        with pytest.raises(SolidError, match="join parts of the pair"):
            joined(carrier, to_mesh(plate.translate((across, 3.0, 3.0))))


@pytest.mark.parametrize("name, genus", [("pin", 1), ("screw", 2)])
def test_a_straight_temple_is_parted_where_asked(name, genus):
    temple = straight(3.0)
    hinge = hinge_of(temple, 5.0, name)
    solid = temple.mesh(1.4)
    fore, rear = sorted(to_manifold(hinged(solid, hinge)).decompose(), key=lambda one: one.bounding_box()[1])
    assert (fore.genus(), rear.genus()) == (genus, 1)
    assert fore.min_gap(rear, 1.0) == pytest.approx(PLAY_MM, abs=0.01)
    assert hinge.axis[0] == pytest.approx(40.0 - 1.5) and hinge.axis[1] > 5.0 + hinge.barrel
    assert fore.bounding_box()[4] == pytest.approx(hinge.axis[1] + hinge.barrel, abs=0.05)
    assert fore.bounding_box()[3] == pytest.approx(41.5, abs=0.01)  # nothing stands out on the outside


def test_a_slender_temple_gets_smaller_knuckles_and_a_thin_one_is_refused():
    assert hinge_of(straight(2.2), 5.0, "pin").barrel < hinge_of(straight(3.0), 5.0, "pin").barrel
    assert hinge_of(straight(2.2), 5.0, "pin").wall_mm >= 1.0
    with pytest.raises(InputError, match=r"1\.6 mm thick.*too thin") as refused:
        hinge_of(straight(1.6), 5.0, "screw")
    assert "hinge=rigid" in str(refused.value)


def test_a_joint_that_misses_its_temple_is_refused():
    hinge = hinge_of(straight(3.0), 5.0, "pin")
    beside = straight(3.0).mesh(1.4)
    with pytest.raises(SolidError, match="does not part"):
        hinged(beside.with_vertices(beside.vertices + [20.0, 0.0, 0.0]), hinge)
