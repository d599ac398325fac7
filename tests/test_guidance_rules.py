import cv2
import numpy as np
import pytest
from drawn import CENTRE, RADIUS, eyes, head, iou, page

from fabcraft.guidance.edges import understand
from fabcraft.guidance.rules import without_rules


def ruled(rgba, squared=False, turn=0.0, tone=(150, 180, 220)):
    """The page with printed lines every 40 px under its ink, level or turned by `turn` (rise over run)."""
    paper = np.full(rgba.shape[:2] + (3,), 255, np.uint8)
    side = len(rgba)
    for k in range(-120, side + 120, 40):
        cv2.line(paper, (0, k), (side, round(k + turn * side)), tone, 2)
        if squared:
            cv2.line(paper, (k, 0), (k, side), tone, 2)
    return np.dstack([np.minimum(paper, rgba[..., :3]), rgba[..., 3:]])


@pytest.fixture(scope="module")
def clean():
    return page([head(), *eyes()])


@pytest.mark.parametrize("how", [{}, {"squared": True}, {"turn": 0.08}])
def test_a_drawing_on_printed_lines_is_the_drawing(clean, how):
    drawing = understand(ruled(clean, **how))
    y, x = np.mgrid[0 : len(clean), 0 : len(clean)] + 0.5
    assert iou(drawing.silhouette, np.hypot(x - CENTRE[0], y - CENTRE[1]) < RADIUS + 5) > 0.98
    assert len(drawing.eyes) == 2
    assert drawing.strokes == ()


def test_a_page_without_printed_lines_is_left_alone(clean):
    dark = (1 - clean[..., 0] / np.float32(255)).astype(np.float32)
    assert without_rules(dark, 0.04) is dark


def test_five_long_lines_are_a_drawing_and_six_even_ones_are_rules():
    def lines(count):
        dark = np.zeros((600, 600), np.float32)
        for k in range(count):
            dark[60 + 80 * k : 62 + 80 * k] = 0.3
        return dark

    assert without_rules(lines(5), 0.04).max() > 0.25
    assert without_rules(lines(6), 0.04).max() < 0.02


def test_a_darker_stroke_over_a_printed_line_stays():
    dark = np.zeros((600, 600), np.float32)
    dark[40::60] = dark[41::60] = 0.3
    dark[:, 300:306] = 0.9
    left = without_rules(dark, 0.04)
    assert (left[:, 300:306] > 0.8).all()
    assert left[:, :280].max() < 0.02
