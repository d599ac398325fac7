import numpy as np
import pytest
from scipy.spatial import cKDTree

from fabcraft.fit.lay import LONGEST, lay, remeshed_between
from fabcraft.geometry.contour import resample
from fabcraft.geometry.triangulate import PlaneMesh, triangulate

EDGE = 3.0


def circle(radius, centre=(0.0, 0.0), count=400):
    angle = np.linspace(-np.pi / 2, 1.5 * np.pi, count, endpoint=False)
    return np.stack([np.cos(angle), np.sin(angle)], 1) * radius + centre


def eared(height, width=0.18):
    angle = np.linspace(-np.pi / 2, 1.5 * np.pi, 900, endpoint=False)
    ears = sum(np.exp(-(((angle - at) / width) ** 2)) for at in (np.pi / 3, 2 * np.pi / 3))
    return resample(np.stack([np.cos(angle), np.sin(angle)], 1) * (40 * (1 + height * ears))[:, None], 1.0)


def crown():
    tips = [(-40, 0), (-34, 40), (-20, 12), (0, 44), (20, 12), (34, 40), (40, 0), (0, -30)]
    return resample(np.array(tips, dtype=float)[::-1], 1.0, corner_reach=3.0)


def round_sheet(hole=True):
    return triangulate([circle(38), circle(8, (0, 4))][: 1 + hole], EDGE)


def twice_areas(sheet):
    a, b, c = sheet.points[sheet.faces].transpose(1, 0, 2)
    return (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]


@pytest.mark.parametrize(
    "goal", [eared(0.1), eared(0.6), eared(1.2), crown()], ids=["low", "ears", "long", "crown"]
)
def test_rims_end_on_their_contours_and_no_face_turns_over(goal):
    goals = [goal, circle(10, (0, 2))]
    laid = lay(round_sheet(), goals, EDGE)
    assert not laid.from_contours
    assert twice_areas(laid.sheet).min() > 0.0
    for loop, contour in zip(laid.sheet.loops, goals, strict=True):
        rim = laid.sheet.points[loop]
        dense = resample(contour, 0.05)
        assert cKDTree(dense).query(rim)[0].max() < 0.1
        assert np.linalg.norm(np.roll(rim, -1, axis=0) - rim, axis=1).max() <= LONGEST * EDGE


def test_tips_of_the_contour_are_reached():
    laid = lay(round_sheet(hole=False), [crown()], EDGE)
    rim = cKDTree(laid.sheet.points[laid.sheet.loops[0]])
    assert rim.query([(-34, 40), (0, 44), (34, 40)])[0].max() < 0.3


def test_a_sheet_that_lies_there_already_keeps_its_mesh():
    sheet = round_sheet(hole=False)
    laid = lay(sheet, [resample(circle(38), 0.5)], EDGE)
    assert laid.remeshed == 0 and laid.moved_mm < 1.5
    np.testing.assert_array_equal(laid.sheet.faces, sheet.faces)


def test_a_pocket_in_the_rim_is_opened():
    goal = circle(30)
    rim = resample(goal, EDGE)
    pocket = np.array([[29.0, -1.2], [22.0, -0.6], [16.0, 0.0], [22.0, 0.6], [29.0, 1.2]])
    at = int(np.argmin(np.linalg.norm(rim - [30.0, 0.0], axis=1)))
    torn = triangulate([np.concatenate([rim[:at], pocket, rim[at + 1 :]])], EDGE, resampled=True)
    mended = remeshed_between(torn, [goal], EDGE)
    assert np.linalg.norm(mended.points[mended.loops[0]], axis=1).min() > 27.5
    laid = lay(torn, [goal], EDGE)
    assert not laid.from_contours
    assert laid.moved_mm > 10.0
    assert twice_areas(laid.sheet).sum() / 2 == pytest.approx(np.pi * 900, rel=0.01)


def test_what_cannot_be_laid_is_meshed_from_the_contours_and_says_so():
    sheet = round_sheet(hole=False)
    crossed = sheet.points.copy()
    loop = sheet.loops[0]
    crossed[loop] = crossed[loop][::-1] * 0.5  # the rim runs backwards: every face at it is turned over
    laid = lay(PlaneMesh(crossed, sheet.faces, sheet.loops), [resample(circle(38), 0.5)], EDGE)
    assert twice_areas(laid.sheet).min() > 0.0
    assert twice_areas(laid.sheet).sum() / 2 == pytest.approx(np.pi * 38**2, rel=0.01)
