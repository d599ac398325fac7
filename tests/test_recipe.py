"""Recipes: what a file says is what is made, and what it misspells is named."""

from dataclasses import replace
from pathlib import Path

import pytest
from worn import ball

from fabcraft.cli.make import Flags, recipe_from
from fabcraft.errors import InputError
from fabcraft.guidance.inflate import InflateSettings
from fabcraft.guidance.placement import PlacementSettings
from fabcraft.recipe import Recipe, read_recipe, recipe_of, recipe_toml

EXAMPLE = Path(__file__).parents[1] / "examples" / "cat-mask.toml"


def written(folder: Path, text: str) -> Path:
    path = folder / "r.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_example_names_its_own_sketch_and_an_output_where_the_command_runs() -> None:
    recipe = read_recipe(EXAMPLE)
    assert Path(recipe.sketch) == EXAMPLE.parent / "cat-mask.png"
    assert recipe.output == ("out/cat-mask.3mf",)
    assert (recipe.body, recipe.printer, recipe.preset) == ("man", "prusa-mk4", "draft")


def test_a_recipe_comes_back_from_its_own_toml() -> None:
    recipe = Recipe(
        sketch='c "a" t.png',
        output=("a.3mf", "b.stl"),
        preset="draft",
        seed=3,
        wall_mm=2.8,
        measures={"wrist": 158.0, "ring_finger": "US7"},
        pictures=False,
        placement=PlacementSettings(scale=1.1, left_mm=-2.0),
        inflate=InflateSettings(swell=0.1),
    )
    import tomllib

    assert recipe_of(tomllib.loads(recipe_toml(recipe))) == recipe


def test_a_travelling_recipe_tells_no_folders() -> None:
    text = recipe_toml(Recipe(sketch="/home/anna/secret/cat.png", output=("/home/anna/cat.3mf",)))
    assert "anna" not in text
    assert 'sketch = "cat.png"' in text


def test_one_output_may_stand_without_a_list() -> None:
    assert recipe_of({"output": "a.3mf"}).output == ("a.3mf",)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('skecth = "a.png"', ["skecth", "sketch"]),
        ("[placement]\nupp_mm = 3", ["placement.upp_mm", "placement.up_mm"]),
        ("sketch = 3", ["sketch", "str", "int"]),
        ('preset = "drfat"', ["preset", "drfat", "'draft'", "'standard'"]),
        ('template = "helmt"', ["template", "helmt", "helmet"]),
        ("wall_mm = 90.0", ["90", "between 1.6 and 5"]),
        ("[placement]\nup_mm = nan", ["up_mm", "nan"]),
        ("[inflate]\nswell = inf", ["swell", "inf"]),
        ("[placement]\nscale = 9.0", ["9.0", "between 0.5 and 2"]),
        ("placement = 3", ["placement"]),
        ("sketch = ", ["not valid TOML"]),
    ],
)
def test_what_does_not_fit_is_named(tmp_path: Path, text: str, words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        read_recipe(written(tmp_path, text))
    for word in words:
        assert word in str(caught.value)


def test_a_missing_a_binary_and_a_folder_are_no_recipes(tmp_path: Path) -> None:
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00")
    for path, word in (
        (tmp_path / "no.toml", "no recipe"),
        (tmp_path / "b.toml", "not text"),
        (tmp_path, "folder"),
    ):
        with pytest.raises(InputError, match=word):
            read_recipe(path)


def test_only_files_that_lie_beside_the_recipe_are_taken_from_there(tmp_path: Path) -> None:
    (tmp_path / "cat.png").write_bytes(b"x")
    recipe = read_recipe(written(tmp_path, 'sketch = "cat.png"\nbody = "man"\nprinter = "form4"'))
    assert recipe == replace(Recipe(), sketch=str(tmp_path / "cat.png"), printer="form4")


def test_measures_are_a_table_of_numbers_and_sizes(tmp_path: Path) -> None:
    recipe = read_recipe(
        written(tmp_path, 'body = "woman"\nmeasures = { wrist = 158, ring_finger = "US7" }\n')
    )
    assert recipe.measures == {"wrist": 158, "ring_finger": "US7"}
    table = read_recipe(written(tmp_path, '[measures]\nwrist = 158\nring_finger = "US7"\n'))
    assert table.measures == recipe.measures
    with pytest.raises(InputError, match="measures"):
        read_recipe(written(tmp_path, "measures = { wrist = [158] }\n"))


def package(path, recipe):
    from fabcraft.write.threemf import threemf_bytes

    path.write_bytes(threemf_bytes([ball()], title="ring", metadata={}, recipe=recipe))
    return path


def test_a_3mf_repeats_the_recipe_that_it_carries(tmp_path):
    (tmp_path / "star.png").touch()
    said = Recipe(template="ring", sketch="elsewhere/star.png", output=("out/ring.3mf",), wall_mm=3.0)
    path = package(tmp_path / "ring.3mf", recipe_toml(said))
    again = recipe_from(str(path), Flags(wall=2.0))
    assert again == Recipe(template="ring", sketch=str(tmp_path / "star.png"), wall_mm=2.0)


def test_a_3mf_whose_input_is_gone_says_so_unless_another_is_given(tmp_path):
    path = package(tmp_path / "ring.3mf", 'template = "ring"\nsketch = "gone.png"\n')
    with pytest.raises(InputError, match=r"needs the file gone\.png \(sketch\)"):
        recipe_from(str(path), Flags())
    (other := tmp_path / "other.svg").touch()
    assert recipe_from(str(path), Flags(sketch=str(other), output=("a.3mf",))).output == ("a.3mf",)


def test_a_3mf_without_a_recipe_is_a_mesh_of_ones_own(tmp_path):
    path = package(tmp_path / "own.3mf", None)
    assert recipe_from(str(path), Flags()).template == str(path)


def test_a_transform_without_a_guidance_mesh_is_refused():
    with pytest.raises(InputError, match="without a guidance mesh"):
        Recipe(guidance_transform="t.json")
