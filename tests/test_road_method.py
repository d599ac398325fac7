"""What a recipe's `method` does, on the road of the views."""

import pytest

from fabcraft.errors import InputError
from fabcraft.fit.presets import LOSSES, PRESETS, ablations, baseline
from fabcraft.pipeline import make
from fabcraft.recipe import Recipe, recipe_of


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
