"""What a recipe's `method` does, on the road of the views."""

import pytest
from worn import torus

from fabcraft.body.human import human
from fabcraft.errors import InputError
from fabcraft.fit.presets import LOSSES, PRESETS, ablations, baseline
from fabcraft.pipeline import make
from fabcraft.profile import load_profile
from fabcraft.read.mesh_file import read_mesh
from fabcraft.recipe import Recipe, recipe_of
from fabcraft.road.guided import shape_guided
from fabcraft.road.shaped import Clock, Given
from fabcraft.write.files import write_mesh


def test_the_ablations_are_methods_too():
    for name, settings in ablations(PRESETS["draft"]).items():
        assert baseline(f"loss-{name}", PRESETS["draft"]).settings == settings
    assert set(ablations(PRESETS["draft"])) == set(LOSSES)
    with pytest.raises(InputError, match="no baseline 'none'"):
        baseline("none")


def test_only_ours_locks_what_meets_the_body():
    assert baseline("ours").locked
    assert not any(
        baseline(name).locked for name in ("no-body-loss", "guidance+body", "loss-both", "template")
    )


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"method": "best"}, "no baseline 'best'"),
        ({"steps": -1}, "-1 steps were asked"),
        ({"steps": 10**6}, "1000000 steps were asked"),
    ],
)
def test_a_method_or_steps_that_are_none_are_refused(fields, words):
    with pytest.raises(InputError, match=words):
        recipe_of(fields)


@pytest.mark.parametrize(
    ("method", "given", "wanted"),
    [
        ("ours", {"sketch": "a.png"}, "--guidance"),
        ("direct", {"guidance": "a.stl"}, "--sketch"),
        ("textdeformer", {"guidance": "a.stl"}, "--text"),
        ("no-body-loss", {"text": "a cat"}, "--guidance"),
    ],
)
def test_a_method_with_another_input_is_refused(method, given, wanted):
    with pytest.raises(InputError, match=f"the method {method} was asked with a") as caught:
        make(Recipe(template="ring", method=method, **given))
    assert wanted in caught.value.next_step


def test_the_guidance_itself_is_measured_as_it_is(tmp_path):
    path = write_mesh(tmp_path / "goal.ply", torus(10.0, 1.5, 96, 24))
    recipe = Recipe(template="ring", guidance=str(path), method="guidance", preset="draft")
    given = Given(goal=read_mesh(path))
    made = shape_guided(recipe, given, human("man"), load_profile("prusa-mk4"), Clock({}, None))
    assert len(made.object.faces) == 2 * 96 * 24  # neither deformed nor made solid anew
    assert "the guidance mesh itself" in made.route[0]
