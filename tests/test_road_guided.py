"""A guidance mesh, or words, for a closed solid on a body."""

from dataclasses import replace

import numpy as np
import pytest
import tiny_clip
import trimesh
from worn import limb, lumpy, torus

from fabcraft.body.body import Body
from fabcraft.body.region import Region
from fabcraft.errors import MissingError
from fabcraft.fit import presets
from fabcraft.profile import load_profile
from fabcraft.recipe import Recipe
from fabcraft.road.guided import shape_guided
from fabcraft.road.shaped import Clock, Given
from fabcraft.template.catalogue import Kind
from fabcraft.template.template import Template

SKIN = limb(8.0, 8.0)
FINGER = Body(
    "finger",
    SKIN,
    {},
    {
        "ring_finger_left": Region(
            "ring_finger_left", np.flatnonzero(np.abs(SKIN.vertices[:, 2]) < 31), 1.0, 0.3, 0.0
        )
    },
    "human",
)
RING = torus(10.0, 1.8, around=60, across=16)


def build(body, settings):
    return Template("ring", body, RING, (), None, 1.8, 1, (), 0.6, listed_mm=(0.15, 0.2))


@pytest.fixture
def short(monkeypatch):
    """A plain ring, and few steps."""
    monkeypatch.setattr("fabcraft.road.base.kind_of", lambda name: Kind("ring", build, ()))
    few = replace(presets.PRESETS["draft"], steps=60, views=2, bank=8, pixels=64)
    monkeypatch.setattr(presets, "PRESETS", {**presets.PRESETS, "draft": few})


def shaped(given=None, **changes):
    recipe = Recipe(template="ring", preset="draft", **changes)
    return shape_guided(recipe, given or Given(), FINGER, load_profile("form4"), Clock({}, None))


def bulk(mesh):
    """How far the ring reaches out in eight directions."""
    angle = np.arctan2(mesh.vertices[:, 1], mesh.vertices[:, 0])
    sector = np.floor((angle + np.pi) / (2 * np.pi) * 20).astype(int).clip(0, 19)
    reach = np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1])
    return np.array([reach[sector == index].max() for index in range(20)])


def test_a_ring_takes_the_lumps_of_its_guidance_and_stays_off_the_finger(short):
    goal = lumpy(RING)
    turned = goal.with_vertices(0.01 * goal.vertices[:, [1, 2, 0]] + 5.0)
    made = shaped(Given(goal=turned), guidance="lumpy.stl")
    solid = trimesh.Trimesh(made.object.vertices, made.object.faces, process=False)
    assert solid.is_watertight and solid.euler_number == 0
    assert made.worn.body.signed(made.object.vertices).min() >= 0.0
    assert np.ptp(bulk(made.object)) > np.ptp(bulk(RING)) + 0.3
    assert any("lumpy.stl, turned by" in line for line in made.route)


def test_words_go_through_an_encoder(short, tmp_path):
    path = tiny_clip.save(tmp_path / "tiny")
    made = shaped(text="a ring with thorns", encoder=str(path))
    assert trimesh.Trimesh(made.object.vertices, made.object.faces, process=False).is_watertight
    assert "'a ring with thorns', away from 'a ring'" in made.route[0]


def test_words_without_weights_say_what_to_run(short, tmp_path, monkeypatch):
    monkeypatch.setenv("HF_HUB_CACHE", str(tmp_path))
    with pytest.raises(MissingError, match="fabcraft weights fetch"):
        shaped(text="a ring with thorns")


def test_a_baseline_is_handed_over_as_its_loop_leaves_it(short):
    goal = lumpy(torus(9.6, 1.8, around=60, across=16))  # too narrow for the finger
    free = shaped(Given(goal=goal), guidance="goal.stl", method="no-body-loss", steps=20)
    fitted = shaped(Given(goal=goal), guidance="goal.stl", method="ours", steps=20)
    assert [label for label, _ in free.stages] == ["template", "step 5", "step 10", "step 15", "fitted"]
    assert free.object.vertices.tobytes() == free.stages[-1][1].vertices.tobytes()
    assert (
        free.worn.body.signed(free.object.vertices).min()
        < fitted.worn.body.signed(fitted.object.vertices).min()
    )
    assert fitted.worn.body.signed(fitted.object.vertices).min() > -0.05


def test_the_template_and_the_guidance_are_measured_as_they_are(short):
    goal = lumpy(torus(10.4, 1.8, around=96, across=24))
    still = shaped(Given(goal=goal), guidance="goal.stl", method="template")
    np.testing.assert_allclose(still.object.vertices, RING.vertices)
    raw = shaped(Given(goal=goal), guidance="goal.stl", method="guidance")
    assert len(raw.object.faces) == 2 * 96 * 24  # neither deformed nor made solid anew
    assert "the guidance mesh itself" in raw.route[0]


@pytest.mark.parametrize("method", ["textdeformer", "body-aware-textdeformer"])
def test_words_are_a_method_with_any_encoder(short, monkeypatch, tmp_path, method):
    few = replace(presets.PRESETS["paper"], views=2, bank=8, pixels=64)
    monkeypatch.setattr(presets, "PRESETS", {**presets.PRESETS, "paper": few})
    encoder = str(tiny_clip.save(tmp_path))
    made = shaped(text="a star ring", encoder=encoder, method=method, steps=3)
    assert "text 'a star ring', away from 'a ring'" in made.route[0]
    assert not np.allclose(made.object.vertices, RING.vertices, atol=1e-4)
