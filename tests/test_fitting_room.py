"""Templates tried on: what is measured, what is refused, and how the command tells it."""

import json
from pathlib import Path

import pytest

from fabcraft.body.human import human
from fabcraft.cli import main
from fabcraft.errors import InputError
from fabcraft.fitting_room import plain, try_on
from fabcraft.template.kinds import KINDS, NAMES, kind_of, with_article
from fabcraft.wearer import find_body


@pytest.fixture(scope="module")
def ring():
    return try_on("ring", human("child"))


def test_a_ring_keeps_what_it_promises(ring):
    assert ring.faults == ()
    assert ring.genus == 1 and ring.watertight and ring.self_intersections == 0 and ring.pen_max_mm == 0.0
    least, usual = ring.template.listed_mm
    assert least - 0.05 <= ring.clearance_min_mm <= ring.clearance_median_mm <= usual + 0.3
    assert ring.wall_min_mm == pytest.approx(ring.template.wall_mm, rel=0.05)
    assert ring.donning.donnable and ring.donning.poses >= 30


@pytest.mark.parametrize(
    ("template", "body"), [("ring", "toddler"), ("slippers", "bear"), ("slippers", "frog"), ("bangle", "dog")]
)
def test_small_and_odd_limbs_get_what_others_get(template, body):
    """Fingers that touch, legs close behind the toes, wide flat toes, a paw that does not fold."""
    assert try_on(template, find_body(body)).faults == ()


def test_a_broken_promise_is_named(ring):
    from dataclasses import replace

    broken = replace(ring, genus=2, watertight=False, wall_min_mm=0.5, clearance_min_mm=-1.0)
    assert broken.faults == (
        "genus 2, not 1",
        "not watertight",
        f"-1.00 mm from the skin, not {ring.template.listed_mm[0]:g}",
        f"wall 0.50 mm, not {ring.template.wall_mm:g}",
    )


def test_what_cannot_be_worn_is_refused_with_the_reason():
    with pytest.raises(InputError, match="the figure cannot wear a ring: its hands have no fingers"):
        plain("ring", find_body("figure"))
    with pytest.raises(InputError, match="did you mean helmet"):
        kind_of("helmt")


@pytest.mark.parametrize("name", NAMES)
def test_every_kind_is_there_with_its_name(name):
    kind = kind_of(name)
    assert kind.name == name and KINDS[name]
    assert all(one.meaning for one in kind.parameters)
    with pytest.raises(InputError, match=rf"no 'nonsense' to set of (a )?{name}"):
        kind.settled({"nonsense": 1.0})


@pytest.mark.parametrize("name", NAMES)
def test_a_word_for_a_number_is_refused(name):
    kind = kind_of(name)
    for one in kind.parameters:
        if one.name != "size" and not one.choices:
            with pytest.raises(
                InputError, match=f"{one.name} = abc was asked of the {name}, which is no number"
            ):
                kind.settled({one.name: "abc"})


def test_the_check_tells_the_table(capsys, tmp_path: Path):
    picture = tmp_path / "worn.png"
    words = ["templates", "check", "ring", "--body", "child", "--body", "figure", "--picture", str(picture)]
    assert main([*words, "--json"]) == 0
    child, figure = json.loads(capsys.readouterr().out)
    (row,), (without,) = child["templates"], figure["templates"]
    assert child["body"] == "child" and child["files"] == [str(picture)]
    assert row["applicable"] and row["genus"] == 1 and row["donnable"] and row["faults"] == []
    names = {
        "faces",
        "watertight",
        "self_intersections",
        "pen_max_mm",
        "clearance_min_mm",
        "clearance_median_mm",
    }
    assert names | {"wall_min_mm", "seconds", "why"} <= set(row)
    assert without == {"template": "ring", "applicable": False, "why": without["why"]}
    assert "no fingers" in without["why"]
    assert picture.stat().st_size > 1000


def test_the_check_takes_settings_and_says_them_in_words(capsys):
    assert main(["templates", "check", "ring", "--body", "child", "--set", "width=9"]) == 0
    told = capsys.readouterr().out
    assert told.splitlines()[0].startswith("template") and "ring" in told
    assert main(["templates", "check", "ring", "helmet", "--set", "width=9"]) == 2
    assert "Name the one" in capsys.readouterr().err
    assert main(["templates", "check", "ring", "--set", "width=900"]) == 2
    assert "2 to 12 mm" in capsys.readouterr().err


def test_show_tells_parameters_and_places(capsys):
    assert main(["templates", "show", "ring", "--body", "child", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert {"name": "width", "unit": "mm"}.items() <= told["parameters"][1].items()
    assert [(one["name"], one["shows"]) for one in told["frames"]] == [
        ("bezel", "motif"),
        ("profile", "object"),
    ]
    assert main(["templates", "--json"]) == 0
    assert [one["template"] for one in json.loads(capsys.readouterr().out)] == list(NAMES)


@pytest.mark.parametrize(
    ("name", "size", "range_"), [("slippers", "EU99", "20 to 350 mm"), ("ring", "ISO99", "12 to 90 mm")]
)
def test_the_name_of_a_size_is_held_to_the_range_too(name, size, range_):
    with pytest.raises(InputError, match=f"size = .* was asked of the {name}") as caught:
        plain(name, human("child"), {"size": size})
    assert range_ in str(caught.value)


def test_a_masks_wall_is_a_parameter_like_the_others():
    from fabcraft.recipe import Recipe
    from fabcraft.road.sheet import asked_wall_mm

    assert asked_wall_mm(Recipe()) == 0.0
    assert asked_wall_mm(Recipe(wall_mm=3.0)) == 3.0
    assert asked_wall_mm(Recipe(parameters={"wall": 2.0}, wall_mm=3.0)) == 2.0
    with pytest.raises(InputError, match="wall = 99 was asked of the mask"):
        asked_wall_mm(Recipe(parameters={"wall": 99.0}))


def test_refusals_say_glasses_and_not_a_glasses():
    assert [with_article(name) for name in ("ring", "glasses", "slippers")] == [
        "a ring",
        "glasses",
        "slippers",
    ]
    with pytest.raises(InputError, match="the figure cannot wear glasses: "):
        plain("glasses", find_body("figure"))
