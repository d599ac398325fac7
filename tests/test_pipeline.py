"""The whole run: what the object promises, and what is said about it."""

from pathlib import Path

import numpy as np
import pytest
from drawn import arc, eyes, head, page

import fabcraft
from fabcraft.body.human import human
from fabcraft.errors import InputError
from fabcraft.guidance.drawing import Drawing
from fabcraft.guidance.edges import understand
from fabcraft.guidance.inflate import inflate
from fabcraft.guidance.placement import PlacementSettings, place
from fabcraft.judge import seat_findings
from fabcraft.pipeline import make
from fabcraft.read.image_file import read_image
from fabcraft.recipe import Recipe
from fabcraft.template.mask import mask
from fabcraft.template.template import Template
from fabcraft.wearer import find_body

EXAMPLES = Path(__file__).parents[1] / "examples"


def test_the_run_ends_printable(cat) -> None:
    assert cat.code == 0
    assert cat.report["printable"] is True


def test_the_outline_is_that_of_the_drawing_and_no_worse_than_cutting_it_out(cat) -> None:
    metrics = cat.report["metrics"]
    assert metrics["silhouette_iou"] >= 0.97
    assert metrics["silhouette_iou"] > metrics["silhouette_iou_direct"] - 0.01
    assert metrics["silhouette_iou_sheet"] > metrics["silhouette_iou_direct"] - 0.003
    assert any("outline from the fitted template" in line for line in cat.report["route"])
    assert metrics["silhouette_iou"] > metrics["silhouette_iou_before"] + 0.3


def test_nothing_is_in_the_body_and_the_eyes_look_out(cat) -> None:
    metrics = cat.report["metrics"]
    assert metrics["pen_max_mm"] <= 0.05
    assert cat.made.clearance_mm.min() >= -0.05
    assert metrics["sight_open_share"] > 0.95
    assert metrics["donnable"] is True


def test_the_wall_is_thick_enough_everywhere(cat) -> None:
    assert cat.report["metrics"]["wall_ok_share"] >= 0.995


def test_it_is_one_simple_solid_with_two_eyes_and_two_strap_slots(cat) -> None:
    metrics = cat.report["metrics"]
    assert (metrics["parts"], metrics["genus"]) == (1, 4)
    assert metrics["self_intersections"] == 0
    assert metrics["open_edges"] == metrics["non_manifold_edges"] == metrics["facets_reversed"] == 0


def test_the_report_has_its_keys_in_order(cat) -> None:
    assert list(cat.report) == [
        "schema",
        "version",
        "printable",
        "verdict",
        "findings",
        "route",
        "metrics",
        "seconds",
        "peak_memory_bytes",
        "files",
    ]
    assert cat.report["version"] == fabcraft.__version__
    assert {"read", "body", "guidance", "fit", "solid", "check"} <= set(cat.report["seconds"])
    assert cat.report["route"][0].startswith("sketch cat-mask.png")
    for finding in cat.report["findings"]:
        assert {"check", "severity", "advice"} <= set(finding)


def test_the_progress_names_every_stage_once(cat) -> None:
    lines = cat.progress.splitlines()
    assert len(lines) == len(set(lines)) == 8
    assert all(line.startswith("fabcraft: ") for line in lines)


def test_the_seed_and_the_given_recipe_are_kept(cat) -> None:
    assert cat.made.recipe.seed == 0
    assert cat.made.object.name == "mask"
    assert not cat.made.interrupted


@pytest.mark.parametrize(
    ("recipe", "word"),
    [
        (Recipe(), "neither"),
        (Recipe(sketch="a.png", guidance="b.stl"), "both"),
        (Recipe(sketch="a.png", printer="nosuch"), "nosuch"),
        (Recipe(sketch="nowhere.png"), "no file"),
        (Recipe(guidance="nowhere.stl"), "no file"),
    ],
)
def test_a_recipe_that_cannot_work_says_why(recipe: Recipe, word: str) -> None:
    with pytest.raises(InputError, match=word):
        make(recipe)


def test_a_misspelt_body_brings_the_one_that_comes_close() -> None:
    with pytest.raises(InputError, match="did you mean woman"):
        find_body("womann")


def test_of_two_drawings_the_larger_is_used_and_the_report_says_so() -> None:
    drawing = understand(page([head(), *eyes(), (arc((100.0, 100.0), 95.0), None)]))
    assert np.ptp(drawing.outline[:, 0]) > 600
    assert any("drawing" in text for text in drawing.warnings)


@pytest.fixture(scope="module")
def owl() -> tuple[Template, Drawing]:
    """A woman's mask, and what shall be on it."""
    return mask(human("woman")), understand(read_image(EXAMPLES / "owl.png"))


def test_a_mask_pushed_up_over_the_forehead_is_not_called_wearable(owl) -> None:
    template, drawing = owl
    relief = inflate(place(drawing, template, PlacementSettings(up_mm=80.0)), template)
    said = {finding.check: finding.severity for finding in seat_findings(template, relief)}
    assert said == {"rests": "fail", "eyes": "fail"}


def test_a_mask_where_it_belongs_has_no_seat_findings(owl) -> None:
    template, drawing = owl
    relief = inflate(place(drawing, template), template)
    assert seat_findings(template, relief) == []
