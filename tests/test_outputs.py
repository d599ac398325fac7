"""What `make` leaves behind: complete, sound, told truthfully, and all of it or nothing."""

import errno
import json
import shutil
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

import lib3mf
import numpy as np
import pytest
from PIL import Image

import fabcraft
from fabcraft import outputs
from fabcraft.body.human import human
from fabcraft.check.slicer import ask_slicer
from fabcraft.errors import InputError
from fabcraft.outputs import side_files, write_all
from fabcraft.read.mesh_file import read_mesh
from fabcraft.recipe import Recipe, recipe_of
from fabcraft.write.bodies import body_picture
from fabcraft.write.places import require_places, write_together
from fabcraft.write.threemf import read_recipe, read_report

NEEDS_SLICER = pytest.mark.skipif(
    shutil.which("prusa-slicer") is None, reason="prusa-slicer is not installed"
)
PICTURES = ("front", "three-quarter", "side", "back", "fit", "contacts", "evolution", "input")


def test_every_file_of_the_report_is_there_and_nothing_else(cat) -> None:
    out = cat.folder / "out"
    names = {"cat.3mf", "cat.stl", "cat.json", "cat.html", *(f"cat-{name}.png" for name in PICTURES)}
    assert {path.name for path in out.iterdir()} == names
    assert {Path(file) for file in cat.report["files"]} == set(out.iterdir())
    assert [Path(file).name for file in cat.report["files"][:2]] == ["cat.3mf", "cat.stl"]


def test_the_3mf_is_read_strictly_as_one_closed_oriented_manifold(cat) -> None:
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromFile(str(cat.folder / "out" / "cat.3mf"))
    assert reader.GetWarningCount() == 0
    meshes = model.GetMeshObjects()
    assert meshes.Count() == 1
    assert meshes.MoveNext()
    assert meshes.GetCurrentMeshObject().IsManifoldAndOriented()


def test_the_3mf_carries_its_recipe_and_its_report(cat) -> None:
    import tomllib

    path = cat.folder / "out" / "cat.3mf"
    recipe = recipe_of(tomllib.loads(read_recipe(path) or ""))
    assert (recipe.sketch, recipe.preset, recipe.output) == ("cat-mask.png", "draft", ("cat.3mf", "cat.stl"))
    inside = json.loads(read_report(path) or "")
    outside = {
        key: value
        for key, value in cat.report.items()
        if key not in ("seconds", "peak_memory_bytes", "files")
    }
    assert inside == outside


def test_the_printable_files_lie_on_the_bed(cat) -> None:
    build = np.array(cat.made.profile.build_mm)
    for name in ("cat.3mf", "cat.stl"):
        lower, upper = read_mesh(cat.folder / "out" / name).bounds
        assert abs(lower[2]) < 1e-3
        assert (lower > -1e-3).all()
        assert (upper < build).all()


@NEEDS_SLICER
def test_the_slicer_finds_one_manifold_part_and_slices_it(cat) -> None:
    told = subprocess.run(
        ["prusa-slicer", "--info", str(cat.folder / "out" / "cat.3mf")],
        capture_output=True,
        text=True,
        timeout=60,
    )
    info = dict(map(str.strip, line.split(" = ")) for line in told.stdout.splitlines() if " = " in line)
    assert (info["manifold"], info["number_of_parts"]) == ("yes", "1")
    assert info.get("open_edges", "0") == "0"
    coarse = replace(cat.made.profile, nozzle_mm=1.0, layer_mm=0.8)  # few layers: a few seconds
    mesh = read_mesh(cat.folder / "out" / "cat.stl")
    answer = ask_slicer(mesh, coarse, supports=False, infill_percent=0)
    assert answer.sliced is True
    assert (answer.seconds or 0) > 600


def test_the_report_file_is_what_json_printed(cat) -> None:
    assert json.loads((cat.folder / "out" / "cat.json").read_text("utf-8")) == cat.report


def test_the_pictures_show_something(cat) -> None:
    for name in PICTURES:
        image = np.asarray(Image.open(cat.folder / "out" / f"cat-{name}.png").convert("RGB")).astype(float)
        assert min(image.shape[:2]) >= 400, name
        assert image.std() > 10, name


def test_the_page_embeds_every_picture_the_recipe_and_both_maps(cat) -> None:
    page = (cat.folder / "out" / "cat.html").read_text("utf-8")
    assert page.count("data:image/png;base64,") == len(PICTURES)
    assert "Wall thickness" in page
    assert "Distance to the body" in page
    assert "cat-mask.png" in page
    assert "http://" not in page.replace("http://www.w3.org", "")


def test_without_pictures_only_the_outputs_are_written() -> None:
    assert side_files(Recipe(output=("a/cat.3mf",), pictures=False)) == {}
    assert "input" not in side_files(Recipe(output=("a/cat.3mf",)))
    assert side_files(Recipe(output=("a/cat.3mf",), sketch="s.png"))["input"] == Path("a/cat-input.png")


def test_a_recipe_without_output_is_refused(cat) -> None:
    with pytest.raises(InputError, match="no output"):
        write_all(replace(cat.made, recipe=Recipe()))


def test_places_that_cannot_be_written_are_refused_beforehand(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    for path, word in (
        (tmp_path, "folder of that name"),
        (tmp_path / "a" / "b" / "c.3mf", "does not exist"),
        (tmp_path / "file" / "c.3mf", "is a file"),
        (tmp_path / ("x" * 300) / "c.3mf", "too long"),
        (Path("/proc/c.3mf"), "cannot write"),
    ):
        with pytest.raises(InputError, match=word):
            require_places([path])
    require_places([tmp_path / "new" / "c.3mf"])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file"]


def test_one_name_twice_and_a_name_that_is_read_are_refused(tmp_path: Path) -> None:
    drawing = tmp_path / "cat-front.png"
    drawing.write_bytes(b"x")
    with pytest.raises(InputError, match="twice"):
        require_places([tmp_path / "a.3mf", tmp_path / "." / "a.3mf"])
    recipe = Recipe(sketch=str(drawing), output=(str(tmp_path / "cat.3mf"),))
    with pytest.raises(InputError, match="overwrite"):
        outputs.require_outputs(recipe)


def test_a_folder_without_permission_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments, **named):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(tempfile, "TemporaryFile", refuse)
    with pytest.raises(InputError, match="no permission"):
        require_places([tmp_path / "a.3mf"])


@pytest.mark.parametrize("reason", [InputError("full", ""), KeyboardInterrupt()])
def test_when_one_file_fails_the_others_go_again(tmp_path: Path, reason: BaseException) -> None:
    first, second, kept = tmp_path / "new" / "a", tmp_path / "new" / "b", tmp_path / "c"
    kept.write_text("old")

    def fail() -> None:
        raise reason

    jobs = [(first, lambda: first.write_text("1")), (kept, lambda: kept.write_text("2")), (second, fail)]
    with pytest.raises(type(reason)):
        write_together(jobs)
    assert [path.name for path in tmp_path.iterdir()] == ["c"]


def test_the_picture_of_a_head_marks_its_landmarks() -> None:
    image = body_picture(human("man").part("head"))
    red = (image[..., 0] > 180) & (image[..., 1] < 60) & (image[..., 2] < 60)
    assert red.sum() > 600


def test_the_python_interface_makes_and_writes(cat, tmp_path: Path) -> None:
    recipe = fabcraft.Recipe(output=(str(tmp_path / "a.glb"), str(tmp_path / "a.ply")), pictures=False)
    files = fabcraft.write_all(replace(cat.made, recipe=recipe))
    assert [Path(file).name for file in files] == ["a.glb", "a.ply"]
    assert np.allclose(fabcraft.read_mesh(files[1]).bounds, cat.made.object.bounds)
    assert fabcraft.make.__module__ == "fabcraft.pipeline"
