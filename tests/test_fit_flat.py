import numpy as np
import pytest

from fabcraft.errors import InputError
from fabcraft.fit.descend import Stop
from fabcraft.fit.flat import fit_flat, rim_targets
from fabcraft.geometry.contour import inside, signed_area
from fabcraft.geometry.plane import Plane
from fabcraft.geometry.triangulate import triangulate


def circle(radius, centre=(0.0, 0.0), count=300):
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.stack([np.cos(angle), np.sin(angle)], 1) * radius + centre


def eared(radius=40.0, height=0.8, width=0.18):
    angle = np.linspace(-np.pi / 2, 1.5 * np.pi, 900, endpoint=False)
    ears = sum(np.exp(-(((angle - at) / width) ** 2)) for at in (np.pi / 3, 2 * np.pi / 3))
    return np.stack([np.cos(angle), np.sin(angle)], 1) * (radius * (1 + height * ears))[:, None]


EYES = [circle(6, (-14, 4)), circle(6, (14, 4))]
START = triangulate([circle(38), circle(8, (-14, 4)), circle(8, (14, 4))], 3.0)


def mask_of(loops, plane):
    x, z = plane.centres()
    return inside(np.column_stack([x.ravel(), z.ravel()]), loops).reshape(x.shape)


def overlap(sheet, loops):
    plane = Plane.around(np.vstack(loops), 0.5, 5.0)
    mine = mask_of([sheet.points[loop] for loop in sheet.loops], plane)
    goal = mask_of(loops, plane)
    return (mine & goal).sum() / (mine | goal).sum()


def areas(sheet):
    a, b, c = sheet.points[sheet.faces].transpose(1, 0, 2)
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def test_targets_are_the_outline_moved_in_and_the_openings_moved_out_by_half_a_wall():
    plane = Plane.around(circle(40), 0.25, 5.0)
    targets = rim_targets(mask_of([circle(40), *EYES], plane), plane, 2, 1.2)
    np.testing.assert_allclose(np.linalg.norm(targets[0], axis=1), 38.8, atol=0.15)
    for target, centre in zip(targets[1:], ((-14, 4), (14, 4)), strict=True):
        np.testing.assert_allclose(np.linalg.norm(target - centre, axis=1), 7.2, atol=0.15)


def test_openings_that_touch_the_outline_are_refused():
    plane = Plane.around(circle(40), 0.25, 5.0)
    solid = mask_of([circle(40), circle(6, (-36, 0)), circle(6, (14, 4))], plane)
    with pytest.raises(InputError, match="1 openings"):
        rim_targets(solid, plane, 2, 1.2)


def test_nothing_wider_than_the_wall_is_refused():
    plane = Plane(0.0, 10.0, 0.25, 40, 40)
    solid = np.zeros((40, 40), dtype=bool)
    solid[20:22] = True
    with pytest.raises(InputError, match="wider than the wall"):
        rim_targets(solid, plane, 0, 1.2)


@pytest.mark.parametrize("height", [0.5, 1.2])
def test_a_round_sheet_grows_ears_with_sound_faces(height):
    targets = [eared(height=height), *EYES]
    fitted = fit_flat(START, targets, 3.0, steps=80, pixels=160)
    assert overlap(fitted.sheet, targets) > 0.985
    assert areas(fitted.sheet).min() > 0.0
    assert len(fitted.sheet.loops) == 3
    assert fitted.remeshed >= 1
    assert fitted.history["total"][-1] < 0.1 * fitted.history["total"][0]
    assert fitted.stopped is Stop.STEPS


def test_the_target_of_the_start_itself_moves_nothing_far():
    targets = [START.points[loop] for loop in START.loops]
    fitted = fit_flat(START, targets, 3.0, steps=40, pixels=128)
    assert fitted.remeshed == 0
    assert np.abs(areas(fitted.sheet).sum() / areas(START).sum() - 1) < 0.005
    assert signed_area(fitted.sheet.points[fitted.sheet.loops[0]]) > 0


def test_two_fits_give_the_same_bytes():
    targets = [eared(height=0.4), *EYES]
    first, second = (
        fit_flat(START, targets, 3.0, steps=16, pixels=96).sheet.points.tobytes() for _ in range(2)
    )
    assert first == second
