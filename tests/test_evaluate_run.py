import json
import multiprocessing
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pretended_cells
import pytest
import tiny_clip
from worn import torus

from fabcraft.cli import main
from fabcraft.errors import InputError, MissingError, SolidError
from fabcraft.evaluate import cells as room
from fabcraft.evaluate import run, suite
from fabcraft.evaluate.cells import Cell, Options, cell_of, key_of, recipe_for
from fabcraft.evaluate.figures import extra_cells, figures
from fabcraft.evaluate.jobs import in_processes
from fabcraft.evaluate.judge import judge_of
from fabcraft.evaluate.suite import METHODS, QUICK, STAR, SUITE, chosen
from fabcraft.evaluate.table import NO_WEIGHTS, by_design, comparison, markdown, rows_of
from fabcraft.recipe import Recipe
from fabcraft.write.picture import png_bytes


def cell(method, design="star-ring", folder="", error="", missing=False, **metrics):
    return Cell(method, design, f"{design}, man", "k", folder, metrics, 1.0, error, missing=missing)


@pytest.fixture
def kitchen(monkeypatch, tmp_path):
    """Cells of which only the making is pretended; `calls` counts it, `raises` is what it raises."""
    state = SimpleNamespace(calls=0, raises=None, options=Options(tmp_path))

    def make(recipe, tell=None):
        state.calls += 1
        if state.raises is not None:
            raise state.raises
        return SimpleNamespace(interrupted=False)

    def draw(made, folder):
        folder.mkdir(parents=True)

    monkeypatch.setattr(room, "make", make)
    monkeypatch.setattr(room, "guidance_mesh", lambda design: torus(10.0, 1.0))
    monkeypatch.setattr(room, "_reference", lambda design, guidance: None)
    monkeypatch.setattr(room, "_measured", lambda *given: {"pen_max_mm": 0.5, "donnable": True})
    monkeypatch.setattr(room, "_draw", draw)
    return state


def test_the_suite_has_the_papers_categories_and_three_bodies():
    assert len(SUITE) >= 12 and len({design.name for design in SUITE}) == len(SUITE)
    assert {design.template for design in SUITE} == {
        "mask", "glasses", "bangle", "helmet", "visor", "necklace", "ring", "slippers"
    }  # fmt: skip
    assert len({design.body for design in SUITE}) >= 3
    assert all(design.made_for != design.body for design in SUITE)
    assert all(set(suite.drawing_of(design)) >= {"reading"} for design in SUITE)
    assert {name for design in SUITE for name in suite.drawing_of(design)} == {
        "sketch",
        "text",
        "via",
        "reading",
    }
    assert set(METHODS) <= set(suite.WORDS) and set(QUICK) <= {design.name for design in SUITE}


def test_a_missing_drawing_says_where_to_run():
    with pytest.raises(MissingError, match="is not beside the package") as caught:
        suite.drawing_of(replace(STAR, example="none.png"))
    assert "checkout" in caught.value.next_step


def test_cells_are_chosen_by_method_by_design_and_by_both():
    assert len(chosen((), False)) == len(METHODS) * len(SUITE)
    assert {design.name for _, design in chosen((), True)} == set(QUICK)
    assert [method for method, _ in chosen(("star-ring",), False)] == list(METHODS)
    assert len(chosen(("ours",), False)) == len(SUITE)
    assert chosen(("ours/star-ring", "ours", "ours/star-ring"), True) == [("ours", STAR)]
    assert [(a, b.name) for a, b in chosen(("ours/cat-mask",), True)] == [("ours", "cat-mask")]


@pytest.mark.parametrize(
    ("word", "hint"),
    [("our", "ours"), ("ours/star-rng", "star-ring"), ("cat-mas", "cat-mask"), ("ours/", "")],
)
def test_a_name_that_is_none_is_refused_with_the_nearest(word, hint):
    with pytest.raises(InputError) as caught:
        chosen((word,), False)
    assert word in caught.value.message and "Methods: template," in caught.value.next_step
    assert not hint or f"did you mean {hint}?" in caught.value.message


def test_each_method_reads_what_it_reads(tmp_path):
    options, mesh = Options(tmp_path, steps=7, seed=3, encoder="tiny"), tmp_path / "goal.ply"
    made = {method: recipe_for(method, STAR, options, mesh) for method in METHODS}
    assert made["direct"].sketch and not made["direct"].guidance
    assert made["textdeformer"].text == "a star ring" and made["textdeformer"].encoder == "tiny"
    assert made["ours"].guidance == made["guidance"].guidance == str(mesh)
    assert all((one.steps, one.seed, one.method) == (7, 3, name) for name, one in made.items())


def test_a_cell_is_made_once(kitchen):
    first = cell_of("ours", STAR, kitchen.options)
    assert first.metrics == {"pen_max_mm": 0.5, "donnable": True} and kitchen.calls == 1
    assert cell_of("ours", STAR, kitchen.options) == first and kitchen.calls == 1
    cell_of("ours", STAR, replace(kitchen.options, seed=1))
    cell_of("template", STAR, kitchen.options)
    assert kitchen.calls == 3


@pytest.mark.parametrize("left", ["", "{", "[]", '{"method": "ours"}'])
def test_half_a_cell_is_made_again(kitchen, left):
    first = cell_of("ours", STAR, kitchen.options)
    folder = kitchen.options.out / first.folder
    (folder / "cell.json").write_text(left)
    kitchen_draw = room._draw
    room._draw = lambda made, folder: None  # the folder is there
    try:
        again = cell_of("ours", STAR, kitchen.options)
    finally:
        room._draw = kitchen_draw
    assert again.metrics == first.metrics and kitchen.calls == 2


def test_other_input_is_another_cell(tmp_path):
    mesh = tmp_path / "goal.ply"
    mesh.write_bytes(b"one")
    recipe = Recipe(template="ring", guidance=str(mesh))
    before = key_of(recipe, mesh)
    assert key_of(recipe, mesh) == before
    assert key_of(replace(recipe, seed=1), mesh) != before and key_of(recipe, mesh, "a prompt") != before
    mesh.write_bytes(b"two")
    assert key_of(recipe, mesh) != before


def test_what_cannot_be_made_is_said_and_kept(kitchen):
    kitchen.raises = SolidError("it has no inside", "Close it.")
    found = cell_of("ours", STAR, kitchen.options)
    assert (found.error, found.next_step, found.metrics) == ("it has no inside", "Close it.", {})
    assert cell_of("ours", STAR, kitchen.options) == found and kitchen.calls == 1


def test_what_is_absent_is_tried_again(kitchen):
    kitchen.raises = MissingError("no weights", "fabcraft weights fetch")
    assert cell_of("textdeformer", STAR, kitchen.options).missing
    kitchen.raises = None
    assert not cell_of("textdeformer", STAR, kitchen.options).error and kitchen.calls == 2


def test_a_cell_that_is_stopped_leaves_nothing(kitchen):
    cell_of("template", STAR, kitchen.options)
    kitchen.raises = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        cell_of("ours", STAR, kitchen.options)
    assert len(list(kitchen.options.out.glob("cells/*/cell.json"))) == 1


def test_the_table_holds_means_worst_depth_and_shares():
    some = [
        cell("ours", "a", pen_max_mm=0.0, chamfer_mm=1.0, donnable=True),
        cell("ours", "b", pen_max_mm=3.0, chamfer_mm=2.0, donnable=False),
        cell("ours", "c", error="it broke"),
        cell("textdeformer", "a", error="no weights here", missing=True),
    ]
    rows = rows_of(some)
    assert [row.method for row in rows] == ["ours", "textdeformer"]
    assert rows[0].numbers == {"pen_max_mm": 3.0, "chamfer_mm": 1.5, "donnable": 0.5}
    assert rows[0].designs == 2 and rows[0].note == "c, man: it broke"
    assert rows[1].note == NO_WEIGHTS and rows[1].numbers == {}
    assert "clip_cos" not in rows[0].to_dict()  # absent, never zero
    text = markdown(rows, by_design(some))
    assert "design by design" not in text  # no body loss has none
    assert "| ours | 2 | – |" in text and NO_WEIGHTS in text


def test_ours_is_compared_where_both_are():
    some = [
        cell("ours", "a", pen_max_mm=0.01, pen_rms_mm=0.1, contact_rms_mm=0.5, silhouette_iou=0.90),
        cell("no-body-loss", "a", pen_max_mm=5.0, pen_rms_mm=2.0, contact_rms_mm=1.0, silhouette_iou=0.92),
        cell("ours", "b", pen_max_mm=9.0, silhouette_iou=0.1),
        cell("no-body-loss", "b", error="it broke"),
    ]
    found = comparison(some)
    assert found["designs"] == 1.0 and found["pen_max_mm_ours"] == 0.01
    assert found["pen_rms_mm_times_smaller"] == pytest.approx(20.0)
    assert found["contact_rms_mm_times_smaller"] == pytest.approx(2.0)
    assert found["silhouette_iou_lost"] == pytest.approx(0.02)
    assert "drawing_iou_lost" not in found
    assert comparison(some[2:]) == {"designs": 0.0}


def test_every_design_is_shown_with_both_likenesses():
    some = [
        cell("ours", "a", pen_max_mm=0.01, silhouette_iou=0.90, drawing_iou=0.97),
        cell("no-body-loss", "a", pen_max_mm=5.0, silhouette_iou=0.96, drawing_iou=0.98),
        cell("ours", "b", pen_max_mm=0.0, silhouette_iou=0.8),
        cell("no-body-loss", "b", pen_max_mm=1.0, silhouette_iou=0.8),
    ]
    found = comparison(some)
    assert found["silhouette_iou_lost"] == pytest.approx(0.03)
    assert found["drawing_iou_lost"] == pytest.approx(0.01)  # of the one that has a drawing
    heads, first, second = by_design(some)
    assert heads[:2] == ("design", "deepest, mm ↓") and "drawing IoU ↑" in heads
    assert first == ("a, man", "0.01 / 5.00", "– / –", "0.900 / 0.960", "0.970 / 0.980", "– / –", "– / –")
    assert second[4] == "– / –"
    assert "| a, man | 0.01 / 5.00 |" in markdown(rows_of(some), by_design(some))


@pytest.fixture
def pretended(monkeypatch, tmp_path):
    """`evaluate` with cells of grey pictures; the texts have no weights."""

    def made(method, design, options):
        if method in suite.TEXT_METHODS:
            return cell(method, design.name, error="the weights <b>are</b> not here", missing=True)
        folder = options.out / f"cells/{method}-{design.name}"
        folder.mkdir(parents=True, exist_ok=True)
        for name in ("worn", "other", "map", "evolution"):
            (folder / f"{name}.png").write_bytes(png_bytes(np.full((40, 40, 3), 128, np.uint8)))
        numbers = {"pen_max_mm": 0.01, "pen_rms_mm": 0.001, "silhouette_iou": 0.9, "contact_rms_mm": 0.1}
        return cell(method, design.name, f"cells/{folder.name}", **numbers)

    monkeypatch.setattr(run, "cell_of", made)
    monkeypatch.setattr("fabcraft.evaluate.figures._sliced", lambda found, out: figures_absent())
    return tmp_path / "out"


def figures_absent():
    from fabcraft.evaluate.figures import Figure

    return Figure("sliced", "Fabricated", "Layers.", None, "prusa-slicer is not installed; not asked.")


def test_everything_is_written_and_said(pretended, capsys):
    assert main(["evaluate", "-o", str(pretended), "--json"]) == 0
    said, told = capsys.readouterr()
    answer = json.loads(said)
    assert [row["method"] for row in answer["table"]] == list(METHODS)
    assert answer["table"][4]["pen_max_mm"] == 0.01 and answer["table"][5]["note"] == NO_WEIGHTS
    whole = len(METHODS) * len(SUITE) + len(extra_cells(False))
    assert len(answer["cells"]) == whole and f"{whole} of {whole}:" in told
    assert (
        answer["figures"]["gallery"] == answer["figures"]["joint"] == answer["figures"]["ablation"] == "there"
    )
    assert "weights" in answer["figures"]["text-image"]
    for name in (
        "index.html",
        "table.md",
        "table.json",
        "manifest.json",
        "study/study.html",
        "figures/gallery.png",
    ):
        assert (pretended / name).stat().st_size > 100 and str(pretended / name) in answer["files"]
    page = (pretended / "index.html").read_text()
    assert "http" not in page.replace("http-equiv", "") and "<b>are" not in page
    assert "<td>cat-mask, man</td>" in page.split("<h2>Design by design</h2>")[1]
    assert page.count("Not there:") == 2 and page.count("<img ") == 7
    manifest = json.loads((pretended / "manifest.json").read_text())
    assert manifest["seed"] == 0 and "numpy" in manifest["libraries"] and len(manifest["keys"]) == whole
    codes = json.loads((pretended / "study/study-key.json").read_text())
    assert {method for method, _ in codes.values()} == {"template", "no-body-loss", "ours"}


def test_a_figure_of_an_earlier_run_does_not_stay(pretended, capsys):
    main(["evaluate", "-o", str(pretended), "--only", "ours", "--quiet"])
    assert (pretended / "figures/gallery.png").exists()
    assert main(["evaluate", "-o", str(pretended), "--only", "template/star-ring", "--quiet"]) == 0
    assert not (pretended / "figures/gallery.png").exists()
    said, told = capsys.readouterr()
    assert "figure gallery: its cells were not asked for" in said and told == ""


def test_results_of_the_study_are_analysed(pretended, capsys, tmp_path):
    main(["evaluate", "-o", str(pretended), "--quick", "--quiet"])
    codes = json.loads((pretended / "study/study-key.json").read_text())
    results = tmp_path / "results.csv"
    lines = [f"{who},{code},{score},5,5" for code in codes for who, score in (("a", 2), ("b", 8))]
    results.write_text("\n".join(lines))
    capsys.readouterr()
    assert main(["evaluate", "-o", str(pretended), "--study", str(results)]) == 0
    assert "5.00 [2.00, 8.00]" in capsys.readouterr().out
    assert main(["evaluate", "-o", str(pretended), "--study", str(results), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["study"][0]["participants"] == 2


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--only", "nonsense"], "there is no 'nonsense'"),
        (["--jobs", "0"], "0 jobs were asked"),
        (["--steps", "-1"], "-1 steps were asked"),
        (["--key", "k.json"], "--key was given without --study"),
        (["--study", "none.csv"], "cannot be read"),
        (["--preset", "fast"], "preset"),
        (["--encoder", "no-such/encoder"], "no-such"),
    ],
)
def test_what_cannot_be_done_is_said_before_the_work(pretended, capsys, words, said):
    assert main(["evaluate", "-o", str(pretended), *words]) == 2
    assert said in capsys.readouterr().err and not pretended.exists()


def test_a_folder_that_cannot_be_is_said_before_the_work(capsys):
    assert main(["evaluate", "-o", "/nowhere/at/all"]) == 2
    assert "does not exist" in capsys.readouterr().err


def test_the_judge_is_the_encoder_that_is_named_or_none(tmp_path, monkeypatch):
    path = str(tiny_clip.save(tmp_path))
    assert judge_of(path) == path
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path / "empty"))
    assert judge_of() == "" and judge_of("ViT-B-32-quickgelu/openai") == ""


def test_without_any_cell_every_figure_says_why(tmp_path):
    assert all(one.picture is None and one.why for one in figures((), tmp_path))


def test_a_defect_in_one_cell_is_said_and_tried_again(kitchen):
    kitchen.raises = TypeError("no such thing")
    found = cell_of("ours", STAR, kitchen.options)
    assert (
        "defect in fabcraft: TypeError: no such thing" in found.error
        and "FABCRAFT_TRACEBACK" in found.next_step
    )
    kitchen.raises = None
    assert not cell_of("ours", STAR, kitchen.options).error


def test_guidance_that_cannot_be_made_costs_its_own_cells_alone(kitchen, monkeypatch):
    def broken(design):
        raise SolidError("it has no inside", "Close it.")

    monkeypatch.setattr(room, "guidance_mesh", broken)
    found = cell_of("ours", STAR, kitchen.options)
    assert found.error == "it has no inside" and not found.folder and kitchen.calls == 0


def test_a_run_that_is_stopped_says_how_to_go_on(pretended, monkeypatch, capsys):
    def stopped(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr(run, "cell_of", stopped)
    assert main(["evaluate", "-o", str(pretended)]) == 130
    assert "the same command goes on" in capsys.readouterr().err


def test_a_process_that_dies_costs_its_own_cell_alone(tmp_path):
    asked = [(method, STAR) for method in ("template", "dies", "ours")]
    found = list(in_processes(asked, Options(tmp_path), 1, pretended_cells.pretended))
    assert [cell.method for cell in found] == ["template", "dies", "ours"]
    assert [bool(cell.error) for cell in found] == [False, True, False]
    assert "was ended" in found[1].error and "--only dies/star-ring" in found[1].next_step


def test_processes_end_when_the_run_is_stopped(tmp_path):
    before = set(multiprocessing.active_children())
    asked = [("template", STAR), ("slow", STAR)]
    told = in_processes(asked, Options(tmp_path), 1, pretended_cells.pretended)
    assert next(told).method == "template"
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        told.throw(KeyboardInterrupt())
    assert time.monotonic() - start < 20.0 and set(multiprocessing.active_children()) <= before


def test_processes_end_with_the_one_that_they_work_for(tmp_path):
    asked = "[('slow', STAR)], Options(Path(sys.argv[1])), 1, pretended"
    code = (
        "import sys; from pathlib import Path; from pretended_cells import pretended; "
        "from fabcraft.evaluate.cells import Options; from fabcraft.evaluate.jobs import in_processes; "
        f"from fabcraft.evaluate.suite import SUITE; STAR = SUITE[0]; list(in_processes({asked}))"
    )
    parent = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], cwd=Path(__file__).parent)
    begun, patience = tmp_path / "begun", time.monotonic() + 50.0
    while not (begun.exists() and begun.read_text().endswith("\n")):
        assert time.monotonic() < patience and parent.poll() is None
        time.sleep(0.1)
    worker = int(begun.read_text())
    parent.kill()
    parent.wait()
    gone = time.monotonic() + 20.0
    while Path(f"/proc/{worker}").exists() and "Z" not in Path(f"/proc/{worker}/stat").read_text().split()[2]:
        assert time.monotonic() < gone
        time.sleep(0.1)
