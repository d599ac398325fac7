"""What is done before printing, together: in one order, told in the route, kept in the recipe and in the 3MF."""

import tomllib

import numpy as np
import pytest
from plated import box, table, tube

from fabcraft.cli import main
from fabcraft.errors import InputError
from fabcraft.mesh import Mesh, concatenate
from fabcraft.plate import prepare, size_words
from fabcraft.profile import load_profile
from fabcraft.read.mesh_file import read_mesh
from fabcraft.recipe import Recipe, recipe_of, recipe_toml
from fabcraft.solid.orient import onto_bed
from fabcraft.solid.plate_settings import PlateSettings
from fabcraft.write.files import write_mesh

MINI, FORM4, MK4 = (load_profile(name) for name in ("prusa-mini", "form4", "prusa-mk4"))


def pair() -> Mesh:
    """Two blocks, mirrored, 20 mm apart."""
    return concatenate([box(60.0, 30.0, 10.0, at=(x, 0.0, 50.0)) for x in (-40.0, 40.0)], "block")


def test_nothing_asked_is_laid_as_before() -> None:
    made = prepare(table(), MK4, PlateSettings())
    np.testing.assert_array_equal(made.whole.vertices, onto_bed(table(), MK4).mesh.vertices)
    assert made.findings == ()


def test_a_pair_too_large_for_the_bed_as_it_lies_is_turned_and_arranged_unasked() -> None:
    soles = concatenate([box(100.0, 270.0, 20.0, at=(x, 0.0, 0.0)) for x in (-80.0, 80.0)], "soles")
    assert not onto_bed(soles, MK4).fits
    made = prepare(soles, MK4, PlateSettings())
    assert len(made.pieces) == 2
    assert (made.whole.bounds >= -1e-6).all() and (made.whole.bounds[1] <= MK4.build_mm).all()
    assert prepare(box(400.0, 400.0, 400.0), MK4, PlateSettings()).pieces[0].size_mm == pytest.approx(
        [400.0] * 3
    )


def test_each_of_a_pair_gets_its_side_and_its_place() -> None:
    made = prepare(
        pair(), MK4, PlateSettings(label="{size} {side}", orient=True), None, {"size": "EU42"}, True
    )
    assert [one.name for one in made.pieces] == ["block, right", "block, left"]
    assert any("label EU42 L" in line for line in made.route)
    assert any("label EU42 R" in line for line in made.route)
    assert "2 parts arranged on 1 plate" in made.route[-1]
    assert made.numbers["label_wall_mm"] >= MK4.min_wall_mm


def test_parts_that_hang_in_each_other_stay_together() -> None:
    upright = tube(20.0, 15.0, 5.0)
    linked = Mesh(upright.vertices[:, [0, 2, 1]] + [17.0, 0.0, 0.0], upright.faces[:, ::-1].copy())
    made = prepare(concatenate([upright, linked], "chain"), MK4, PlateSettings(arrange=True))
    assert len(made.pieces) == 1


def test_a_label_on_the_skin_side_comes_before_the_underside() -> None:
    plate = box(60.0, 30.0, 6.0)
    top = plate.face_normals[:, 2] > 0.9
    made = prepare(plate, MK4, PlateSettings(label="42"), top)
    lowered = made.whole.vertices[:, 2]
    assert ((lowered > 3.0) & (lowered < 5.9)).any()
    assert not ((lowered < 3.0) & (lowered > 0.1)).any()


def test_filament_is_not_hollowed_unless_a_wall_is_given() -> None:
    cube = box(30.0, 30.0, 30.0)
    told = prepare(cube, MK4, PlateSettings(hollow=True))
    assert told.whole.volume_mm3 == pytest.approx(27000.0)
    assert "filament" in told.findings[0].advice
    assert prepare(box(40.0, 20.0, 3.0), FORM4, PlateSettings(hollow=True)).findings[0].check == "hollow"


def test_a_split_part_lies_on_the_bed_and_its_pins_stand_beside_it() -> None:
    made = prepare(box(300.0, 60.0, 40.0), MINI, PlateSettings(split=True))
    names = [one.name for one in made.pieces]
    assert names[:2] == ["box, part 1 of 2", "box, part 2 of 2"]
    assert all("pin" in one for one in names[2:]) and len(names) >= 4
    assert all((one.size_mm <= np.array(MINI.build_mm) + 1e-6).all() for one in made.pieces)
    assert all(one.bounds[0, 2] == pytest.approx(0.0, abs=1e-9) for one in made.pieces)


def test_the_size_is_the_one_that_was_given() -> None:
    assert size_words({"size": "US 7"}, {"wrist": 158.0}) == {"size": "US 7"}
    assert size_words({}, {"foot": "EU42"}) == {"size": "EU42"}
    assert size_words({}, {"wrist": 158.0}) == {"size": "158"}
    assert size_words({}, {}) == {}


@pytest.mark.parametrize("label", ["{name}", "{", "{size.real}", "ä", "{size!r:>9999999}"])
def test_a_label_that_cannot_be_filled_is_refused_before_the_work(label: str) -> None:
    with pytest.raises(InputError, match="label"):
        PlateSettings(label=label)


def test_the_recipe_keeps_what_was_asked() -> None:
    plate = PlateSettings(orient=True, hollow_wall_mm=2.5, split=True, label="{size}", arrange=True)
    recipe = Recipe(plate=plate)
    assert recipe_of(tomllib.loads(recipe_toml(recipe))).plate == plate
    with pytest.raises(InputError, match="orientt"):
        recipe_of({"plate": {"orientt": True}})


def test_solid_orients_and_splits_a_file(tmp_path, capsys) -> None:
    write_mesh(tmp_path / "bar.stl", box(270.0, 12.0, 12.0))
    out = tmp_path / "parts.3mf"
    command = ["solid", str(tmp_path / "bar.stl"), "--printer", "prusa-mini", "-o", str(out), "--quiet"]
    assert main([*command, "--split"]) == 0
    assert "warn size" not in (told := capsys.readouterr().out) and "FAIL" not in told
    assert read_mesh(out).volume_mm3 > 0.9 * 270.0 * 12.0 * 12.0
    assert main(["solid", str(tmp_path / "bar.stl"), "--wall", "2", "--split", "-o", str(out)]) == 2
    assert "--printer" in capsys.readouterr().err
