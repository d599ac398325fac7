import numpy as np
import pytest

from fabcraft.body.human import human
from fabcraft.fit.direct import direct
from fabcraft.fit.flat import rim_targets
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.heights import front_heights
from fabcraft.geometry.plane import Plane
from fabcraft.geometry.raster import silhouette_mask
from fabcraft.guidance.inflate import InflateSettings, inflate, solid_mask
from fabcraft.guidance.placement import PlacedDrawing
from fabcraft.solid.shell import PAD_ROOM_MM, shell
from fabcraft.solid.slots import RIM_MM, WIDTH_MM, StrapSlot, strap_slots
from fabcraft.solid.thicken import SolidSettings
from fabcraft.template.mask import RESTING_MM, mask


@pytest.fixture(scope="module")
def parts():
    template = mask(human("child"))
    middle = 0.5 * (template.outline.min(0) + template.outline.max(0))
    angle = np.linspace(-np.pi / 2, 1.5 * np.pi, 900, endpoint=False)
    outline = middle + np.stack([62 * np.cos(angle), 72 * np.sin(angle)], 1)
    stroke = middle + np.array([[-20.0, -50.0], [20.0, -50.0]])
    placed = PlacedDrawing(outline, template.openings, (), (stroke,), 1.0, 0.2, False, ())
    relief = inflate(
        placed, template, InflateSettings(stroke_height_mm=1.5, stroke_width_mm=3.0, rim_height_mm=0.0)
    )
    plane = Plane.around(outline, 0.25, 5.0)
    rims = rim_targets(solid_mask(outline, template.openings, plane), plane, 2, 0.5 * template.wall_mm)
    distance = SurfaceDistance(template.body.mesh)
    return template, relief, direct(rims, relief, template.edge_mm), distance


@pytest.fixture(scope="module")
def made(parts):
    template, relief, sheet, distance = parts
    slots = strap_slots(template, relief)
    settings = SolidSettings(wall_mm=template.wall_mm, cell_mm=0.8)
    return shell(sheet, template, relief, distance, settings, slots), slots


def test_the_shell_is_one_closed_part_with_eyes_and_slots_open(made):
    solid, slots = made
    assert len(slots) == 2
    assert solid.numbers["parts"] == 1 and solid.numbers["genus"] == 4
    assert solid.numbers["self_intersections"] == 0


def test_it_keeps_its_clearance_and_rests_on_the_contacts(parts, made):
    template, relief, _, distance = parts
    solid, _ = made
    assert solid.numbers["clearance_slack_mm"] > -0.02
    assert distance.signed(solid.mesh.vertices).min() > RESTING_MM - 0.02
    regions = [template.body.regions[name].vertex_indices for name in template.contacts]
    contacts = template.body.mesh.vertices[np.concatenate(regions)]
    contacts = contacts[relief.room_at(contacts[:, [0, 2]]) > PAD_ROOM_MM]
    gaps = SurfaceDistance(solid.mesh).closest(contacts).distances
    assert len(contacts) > 30 and np.median(gaps) < RESTING_MM + 0.15


def test_its_silhouette_is_the_drawn_outline(parts, made):
    _, relief, _, _ = parts
    solid, slots = made
    plane = Plane.around(relief.outline, 0.25, 4.0)
    x, z = plane.centres()
    wanted = solid_mask(relief.outline, relief.openings, plane)
    for slot in slots:
        wanted &= slot.distance(np.column_stack([x.ravel(), z.ravel()])).reshape(x.shape) > 0
    pixels = plane.to_pixels(solid.mesh.vertices[:, [0, 2]])
    seen = silhouette_mask(pixels, solid.mesh.faces, plane.width, plane.height) > 0.5
    assert (seen & wanted).sum() / (seen | wanted).sum() > 0.99


def test_a_stroke_stands_out_by_its_height(parts, made):
    template, relief, _, _ = parts
    solid, _ = made
    middle = 0.5 * (template.outline.min(0) + template.outline.max(0))
    on, off = middle + [0.0, -50.0], middle + [0.0, -44.0]

    plane = Plane.around(np.array([on, off]), 0.2, 5.0)
    height = front_heights(solid.mesh, plane)

    def outer(places):
        return plane.sample(height, places) - relief.height_at(places)

    # the wall leans, so the bead, raised along the normal, is seen a little lower down than it was drawn
    across = on + np.column_stack([np.zeros(21), np.linspace(-3.0, 3.0, 21)])
    assert outer(across).max() - outer(off[None])[0] == pytest.approx(1.5, abs=0.2)


def test_a_slot_is_a_stadium():
    slot = StrapSlot(np.array([10.0, 5.0]), np.array([0.0, 1.0]))
    points = np.array([[10.0, 5.0], [11.5, 5.0], [10.0, 11.0], [10.0, 12.0], [13.5, 5.0]])
    np.testing.assert_allclose(slot.distance(points), [-1.5, 0.0, 0.0, 1.0, 2.0], atol=1e-12)


def test_slots_lie_on_both_sides_inside_the_rim(parts):
    template, relief, _, _ = parts
    right, left = strap_slots(template, relief)
    assert (
        right.centre[0]
        < template.body.landmarks["eye_right"][0]
        < template.body.landmarks["eye_left"][0]
        < left.centre[0]
    )
    room = relief.room_at(np.array([right.centre, left.centre]))
    np.testing.assert_allclose(room, RIM_MM + 0.5 * WIDTH_MM, atol=1.0)
