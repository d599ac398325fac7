"""Which road words take, and what comes out of it."""

import json

import numpy as np
import pytest

from fabcraft import pipeline
from fabcraft.cli import main
from fabcraft.errors import InputError, MissingError
from fabcraft.recipe import Recipe, read_recipe, recipe_toml
from fabcraft.road import text as road
from fabcraft.road.text import text_drawing, text_road


@pytest.fixture
def bare(monkeypatch):
    """A machine without any weights."""
    monkeypatch.setattr(road, "_encoder_here", lambda: False)


def test_without_weights_words_go_to_the_library(bare):
    via, why = text_road(Recipe(text="cat"))
    assert via == "subjects" and "no encoder" in why


def test_with_weights_words_go_through_the_encoder_unless_a_drawing_is_asked_for(monkeypatch):
    monkeypatch.setattr(road, "_encoder_here", lambda: True)
    assert text_road(Recipe(text="cat"))[0] == "clip"
    assert text_road(Recipe(text="cat", template="ring", reading="motif"))[0] == "subjects"
    assert text_road(Recipe(text="cat", via="subjects"))[0] == "subjects"


def test_a_named_encoder_is_used_and_contradicts_another_road():
    assert text_road(Recipe(text="cat", encoder="tiny"))[0] == "clip"
    with pytest.raises(InputError, match="does not use one"):
        text_road(Recipe(text="cat", encoder="tiny", via="subjects"))


def test_a_back_end_that_is_not_there_is_named(bare):
    with pytest.raises(MissingError, match="text-to-image"):
        text_drawing(Recipe(text="cat", via="picture"))


def test_a_road_without_words_is_refused():
    with pytest.raises(InputError, match="there is no text"):
        pipeline.make(Recipe(sketch="cat.png", via="subjects"))


def test_the_route_says_what_was_chosen_and_why(bare):
    drawing, route, notes = text_drawing(Recipe(text="a shiny kitty"))
    assert len(drawing.eyes) == 2
    assert "cat, of the library of line drawings (no encoder" in route[0]
    assert "shiny" in notes[0]


def test_a_recipe_keeps_its_text_and_road(tmp_path):
    recipe = Recipe(template="ring", text='a "star"', via="subjects", reading="motif")
    path = tmp_path / "r.toml"
    path.write_text(recipe_toml(recipe), "utf-8")
    assert read_recipe(path) == recipe
    path.write_text('text = "cat"\nvia = "sketch"\n')
    with pytest.raises(InputError, match="via"):
        read_recipe(path)


def test_the_command_lists_shows_and_draws(tmp_path, capsys):
    assert main(["subjects", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert len(told["subjects"]) >= 60 and "heart glasses" in told["objects"]
    assert main(["subjects", "kitty", "--picture", str(tmp_path / "c.png"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["subject"] == "cat" and told["eyes"] == 2
    from PIL import Image

    assert np.asarray(Image.open(tmp_path / "c.png")).std() > 10


def test_the_command_refuses_what_there_is_not_with_code_2(capsys):
    assert main(["subjects", "unicycle"]) == 2
    assert "no drawing of 'unicycle'" in capsys.readouterr().err
    assert main(["guidance", "--text", "unicycle"]) == 2
    assert main(["guidance"]) == 2


def test_words_are_shown_before_anything_is_made(tmp_path, capsys):
    shown = tmp_path / "u.png"
    assert main(["guidance", "--text", "cat with star", "--show-input", str(shown), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert "cat with star" in told["route"][0] and told["holes"] == 2 and shown.is_file()
