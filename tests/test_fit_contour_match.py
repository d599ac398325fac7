import numpy as np
import pytest

from fabcraft.fit.contour_match import match, seam


def circle(count, radius=10.0, start=-np.pi / 2):
    angle = start + np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.stack([np.cos(angle), np.sin(angle)], 1) * radius


def eared(count=600):
    points = circle(count)
    angle = np.arctan2(points[:, 1], points[:, 0])
    ear = sum(np.exp(-(((angle - at) / 0.15) ** 2)) for at in (np.pi / 3, 2 * np.pi / 3))
    return points * (1 + 0.9 * ear)[:, None]


def test_a_contour_matched_with_itself_stays():
    target = eared()
    # the last point shares its stretch with the seam: half a spacing
    np.testing.assert_allclose(match(target, target), target, atol=0.06)


@pytest.mark.parametrize("turn", [1, -1])
def test_the_match_goes_around_once_and_never_turns_back(turn):
    target = eared()
    rim = circle(150, start=0.7)[::turn]
    found = match(rim, target)
    index = np.array([np.argmin(((target - point) ** 2).sum(1)) for point in found])
    steps = np.diff(np.concatenate([index, index[:1]])) * turn
    backwards = (steps < -2) & (steps > -len(target) / 2)
    assert not backwards.any()
    assert (steps < -len(target) / 2).sum() == 1


def test_both_ears_get_points_up_to_the_tip():
    found = match(circle(150), eared())
    assert np.linalg.norm(found, axis=1).max() == pytest.approx(19.0, abs=0.8)
    assert (found[:, 0] > 0).sum() == pytest.approx((found[:, 0] < 0).sum(), abs=6)


def test_the_seam_is_at_the_bottom_in_the_middle():
    points = circle(90, start=1.0)
    assert points[seam(points)][1] < -9.9 and abs(points[seam(points)][0]) < 0.8
