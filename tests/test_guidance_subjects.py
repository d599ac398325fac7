"""The library of line drawings: every one is sound, and the sketch parser reads it as it was meant."""

import cv2
import numpy as np
import pytest

from fabcraft.errors import InputError
from fabcraft.geometry.contour import inside, signed_area
from fabcraft.guidance.edges import understand
from fabcraft.guidance.outline import fill_contour
from fabcraft.guidance.subjects.compose import composed
from fabcraft.guidance.subjects.library import THEMES, Subject, drawing_of, objects, subjects
from fabcraft.guidance.subjects.path import STEP, closed_curve, knots, open_curve
from fabcraft.guidance.subjects.words import Wish, wish_of

KNOWN = subjects()
ALL = {**KNOWN, **objects()}
PAPERS = ("cat", "bunny", "dinosaur", "alligator", "cow", "heart", "star", "rose")


def crossings(contour: np.ndarray) -> int:
    """How many pairs of edges of a closed contour cross."""
    a, b = contour, np.roll(contour, -1, 0)
    d = b - a

    def side(p):
        """Of which side of edge i the point p_j lies, (N, N)."""
        r = p[None] - a[:, None]
        area = d[:, None, 0] * r[..., 1] - d[:, None, 1] * r[..., 0]
        return np.sign(np.where(abs(area) < 1e-6, 0.0, area))

    start = side(a)
    apart = start * np.roll(start, -1, 1) < 0
    return int(np.triu(apart & apart.T, 2).sum())


def pen(drawing):
    """(H, W, 4) the drawing with a pen on white paper, four times as many pixels averaged."""
    page = np.full((2 * drawing.height, 2 * drawing.width), 255, np.uint8)
    rings = [(one, True) for one in (drawing.outline, *drawing.eyes, *drawing.holes, *drawing.regions)]
    for line, closed in [*rings, *((one, False) for one in drawing.strokes)]:
        at = np.round(line * 2 * 16 - 8).astype(np.int32)
        cv2.polylines(page, [at], closed, 0, round(2 * drawing.stroke_width_px), cv2.LINE_AA, 4)
    grey = cv2.resize(page, (drawing.width, drawing.height), interpolation=cv2.INTER_AREA)
    return np.dstack([grey, grey, grey, np.full_like(grey, 255)])


def iou(a, b):
    return (a & b).sum() / (a | b).sum()


def test_the_library_is_large_and_holds_the_papers_subjects():
    assert len(KNOWN) >= 60 and set(PAPERS) <= set(KNOWN)
    assert {one.theme for one in KNOWN.values()} == set(THEMES)
    for pair in ("heart glasses", "alligator bangle", "dinosaur helmet", "cow visor", "rose necklace",
                 "star ring", "bunny slippers"):  # fmt: skip
        assert pair in ALL


def test_no_word_stands_for_two_subjects():
    words = [word for one in KNOWN.values() for word in (one.name, *one.words)]
    assert sorted(words) == sorted(set(words))


@pytest.mark.parametrize("name", ALL)
def test_a_drawing_is_one_outline_that_crosses_itself_nowhere_with_its_details_inside(name):
    drawing = drawing_of(ALL[name])
    assert crossings(drawing.outline) == 0
    assert signed_area(drawing.outline) == pytest.approx(float(drawing.silhouette.sum()), rel=0.01)
    for loop in (*drawing.holes, *drawing.eyes):
        assert crossings(loop) == 0
        assert inside(loop, [drawing.outline]).all()
    for line in (*drawing.regions, *drawing.strokes):
        away = [cv2.pointPolygonTest(drawing.outline.astype(np.float32), p, True) for p in line[::4].tolist()]
        assert min(away) > -1.5 * drawing.stroke_width_px


@pytest.mark.parametrize("name", [n for i, n in enumerate(ALL) if i % 20 == 0 or n in PAPERS])
def test_a_drawing_on_paper_is_understood_as_it_was_drawn(name):
    drawing = drawing_of(ALL[name])
    found = understand(pen(drawing))
    scale = found.width / drawing.width
    truth = fill_contour(drawing.outline * scale, found.silhouette.shape)
    # the parser's silhouette goes to the outer edge of the drawn line, the library's outline is its middle
    line = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (13, 13))
    assert iou(found.silhouette, cv2.dilate(truth.astype(np.uint8), line) > 0) >= 0.97
    if ALL[name].face:
        assert len(found.eyes) == 2
        for eye, meant in zip(found.eyes, drawing.eyes, strict=True):
            drawn = fill_contour(meant * scale, found.silhouette.shape)
            assert iou(fill_contour(eye, found.silhouette.shape), drawn) > 0.85


def test_a_symmetric_subject_is_drawn_symmetric():
    for name in ("cat", "heart", "skull", "crown"):
        assert drawing_of(KNOWN[name]).symmetry_iou > 0.99


def test_a_curve_goes_through_its_knots_and_is_sharp_only_where_it_says_so():
    line = knots("0,0 100,0! 100,100 0,100")
    curve = closed_curve(line)
    for knot in line.at:
        assert np.linalg.norm(curve - knot, axis=1).min() < STEP
    assert (np.linalg.norm(curve - [100.0, 0.0], axis=1) < 1e-9).any()
    straight = open_curve(knots("0,0! 30,40!"))
    assert np.allclose(straight[[0, -1]], [[0, 0], [30, 40]])
    assert np.allclose(straight[:, 1], straight[:, 0] * 4 / 3)
    circle = closed_curve(knots("o 10,20 50"))
    assert np.allclose(np.linalg.norm(circle - [10, 20], axis=1), 50.0, atol=0.2)


@pytest.mark.parametrize("text", ["", "5,5", "a,b c,d", "1,2 3", "o 5", "nan,0 1,1", "1,2,3 4,5,6"])
def test_what_is_no_line_is_refused(text):
    with pytest.raises(InputError, match="is no line"):
        knots(text)


def test_a_table_that_is_no_drawing_is_refused():
    with pytest.raises(InputError, match="unknown key colour"):
        drawing_of(Subject("x", "sky", (), {"colour": "red"}))
    with pytest.raises(InputError, match="has no outline"):
        drawing_of(Subject("x", "sky", (), {}))


def test_a_detail_lies_in_the_free_part_of_a_face_and_keeps_off_its_eyes():
    alone, both = (composed(wish_of(text, KNOWN)) for text in ("a cat", "a cat with a star"))
    star = both.regions[-1]
    assert len(both.regions) == len(alone.regions) + 1 and len(both.eyes) == 2
    assert inside(star, [both.outline]).all()
    assert not any(inside(star, [eye]).any() for eye in both.eyes)
    assert abs(star[:, 0].mean() - both.symmetry_axis_px) < 3.0
    assert np.ptp(star, axis=0).min() > 0.1 * np.ptp(both.outline[:, 0])


def test_two_side_by_side_are_one_outline_as_large_as_both():
    both = composed(wish_of("heart and star", KNOWN), "ring")
    assert crossings(both.outline) == 0
    areas = []
    for name in ("heart", "star"):
        one = drawing_of(KNOWN[name])
        areas.append(one.silhouette.sum() * (700.0 / np.ptp(one.outline[:, 1])) ** 2)
    assert both.silhouette.sum() == pytest.approx(sum(areas), rel=0.03)


@pytest.mark.parametrize(
    ("text", "template", "reading", "why"),
    [
        ("heart and star", "mask", "", "no mask"),
        ("key with heart", "ring", "", "no room"),
        ("cat", "ring", "object", "no drawing of the whole ring"),
        ("star with heart", "ring", "object", "no drawing of the whole ring"),
    ],
)
def test_what_does_not_compose_is_refused_with_a_reason(text, template, reading, why):
    with pytest.raises(InputError, match=why):
        composed(wish_of(text, KNOWN), template, reading)


def test_the_papers_pairs_are_drawn_as_whole_objects():
    ring = composed(Wish(KNOWN["star"]), "ring", "object")
    assert len(ring.holes) == 1
    glasses = composed(Wish(KNOWN["heart"]), "glasses", "object")
    assert len(glasses.eyes) == 2
    mask = composed(Wish(KNOWN["cat"]), "mask", "object")
    assert np.array_equal(mask.outline, drawing_of(KNOWN["cat"]).outline)
