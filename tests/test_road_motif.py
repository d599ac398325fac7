"""A drawing worked into a solid template, on a simple finger."""

import cv2
import numpy as np
import pytest
import trimesh
from worn import limb

from fabcraft.body.body import Body
from fabcraft.errors import InputError
from fabcraft.guidance.placement import PlacementSettings
from fabcraft.mesh import Mesh
from fabcraft.profile import load_profile
from fabcraft.recipe import Recipe
from fabcraft.road.motif import shape_motif
from fabcraft.road.shaped import Clock, Given
from fabcraft.template.catalogue import Kind
from fabcraft.template.template import MotifFrame, Parameter, Template

FINGER = Body("finger", limb(8.0, 8.0), {}, {}, "human")
BEZEL = MotifFrame(
    "bezel",
    np.array([0.0, -10.6, 0.0]),
    np.array([1.0, 0.0, 0.0]),
    np.array([0.0, 0.0, 1.0]),
    (14.0, 14.0),
    4.0,
)
BAND = MotifFrame(
    "band",
    np.array([0.0, -10.6, 0.0]),
    np.array([1.0, 0.0, 0.0]),
    np.array([0.0, 0.0, 1.0]),
    (14.0, 9.0),
    2.0,
    axis=(np.zeros(3), np.array([0.0, 0.0, 1.0])),
)
TURN = np.linspace(0.0, 2.0 * np.pi, 120, endpoint=False)
PROFILE = MotifFrame(
    "profile",
    np.array([0.0, 0.0, 3.5]),
    np.array([1.0, 0.0, 0.0]),
    np.array([0.0, 1.0, 0.0]),
    (24.0, 24.0),
    12.0,
    openings=(9.2 * np.column_stack([np.cos(TURN), np.sin(TURN)]),),
    depth_mm=7.0,
)


def build(body, settings):
    shape = trimesh.creation.annulus(8.6, 10.6, float(settings.get("width", 7.0)), sections=120).subdivide()
    mesh = Mesh(np.array(shape.vertices), np.array(shape.faces, dtype=np.int32), "ring")
    return Template(
        "ring", body, mesh, (), None, 1.8, 1, (), 0.6, listed_mm=(0.2, 0.6), motifs=(BEZEL, BAND, PROFILE)
    )


@pytest.fixture
def plain_ring(monkeypatch):
    """A ring whose measures are known."""
    kind = Kind("ring", build, (Parameter("width", "mm", 3.0, 12.0, "along the finger"),))
    monkeypatch.setattr("fabcraft.road.base.kind_of", lambda name: kind)


def star():
    page = np.full((500, 500, 4), 255, np.uint8)
    angle = np.pi / 2 + np.arange(10) * np.pi / 5
    radius = np.where(np.arange(10) % 2 == 0, 220, 100)
    tips = (
        np.column_stack([250 + radius * np.cos(angle), 260 - radius * np.sin(angle)]).round().astype(np.int32)
    )
    ink = np.ascontiguousarray(page[..., :3])
    cv2.polylines(ink, [tips], True, (0, 0, 0), 8, cv2.LINE_AA)
    page[..., :3] = ink
    return page


def shaped(picture=None, **changes):
    recipe = Recipe(template="ring", sketch="star.png", preset="draft", **changes)
    return shape_motif(
        recipe, Given(star() if picture is None else picture), FINGER, load_profile("form4"), Clock({}, None)
    )


@pytest.mark.parametrize("frame", ["", "band"], ids=["bezel", "band"])
def test_a_star_becomes_part_of_the_ring(plain_ring, frame):
    made = shaped(frame=frame)
    assert made.metrics["silhouette_iou"] > 0.95 > made.metrics["silhouette_iou_before"]
    solid = trimesh.Trimesh(made.object.vertices, made.object.faces, process=False)
    assert solid.is_watertight and solid.body_count == 1
    assert solid.euler_number == 0  # still a ring
    assert made.worn.body.signed(made.object.vertices).min() > 0.2
    assert solid.bounds[0, 1] < -10.8  # it stands out of the band
    assert made.stages[0][0] == "template" and len(made.stages) > 3


def test_a_place_that_the_ring_has_not_is_refused(plain_ring):
    with pytest.raises(InputError, match=r"'brow'.*\n?") as caught:
        shaped(frame="brow")
    assert "bezel (motif), band (motif), profile (object)" in str(caught.value)


def test_a_setting_out_of_its_range_is_refused(plain_ring):
    with pytest.raises(InputError, match="width = 40"):
        shaped(parameters={"width": 40.0})
    with pytest.raises(InputError, match="no 'widht'"):
        shaped(parameters={"widht": 4.0})


def cat_ring():
    """Seen along the finger: a round with two ears, and the hole for the finger."""
    page = np.full((600, 600, 4), 255, np.uint8)
    ink = np.ascontiguousarray(page[..., :3])
    turn = np.radians(
        np.concatenate([np.arange(-30, 40), [52], np.arange(64, 117), [128], np.arange(140, 330)])
    )
    away = np.where(np.isin(np.round(np.degrees(turn)), (52, 128)), 265, 190)
    tips = np.column_stack([300 + away * np.cos(turn), 330 - away * np.sin(turn)]).round().astype(np.int32)
    cv2.polylines(ink, [tips], True, (0, 0, 0), 8, cv2.LINE_AA)
    cv2.circle(ink, (300, 330), 140, (0, 0, 0), 8, cv2.LINE_AA)
    page[..., :3] = ink
    return page


def test_a_drawing_of_the_whole_ring_becomes_its_shape(plain_ring):
    made = shaped(cat_ring(), reading="object")
    assert made.metrics["silhouette_iou"] > 0.95 > made.metrics["silhouette_iou_before"]
    solid = trimesh.Trimesh(made.object.vertices, made.object.faces, process=False)
    assert solid.is_watertight and solid.body_count == 1 and solid.euler_number == 0
    assert made.worn.body.signed(made.object.vertices).min() > 0.2
    upper = solid.bounds[1]
    assert upper[1] > 11.5 and np.abs(solid.vertices[:, 1]).max() < 16.0
    ears = made.object.vertices[made.object.vertices[:, 1] > upper[1] - 0.6]
    assert np.ptp(ears[:, 2]) > 5.5  # as wide as the band


def test_the_whole_ring_needs_material_around_the_finger(plain_ring):
    with pytest.raises(InputError, match="beside an opening of the ring"):
        shaped(cat_ring(), reading="object", placement=PlacementSettings(up_mm=4.0))


def test_a_place_of_the_other_reading_is_refused(plain_ring):
    with pytest.raises(InputError, match="no place 'profile' for a motif"):
        shaped(reading="motif", frame="profile")
