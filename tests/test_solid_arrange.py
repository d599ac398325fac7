"""Arranging: nothing overlaps, the gap is kept, the middle is the middle, and plates are counted."""

from itertools import combinations

import numpy as np
import pytest
from plated import box, tube

from fabcraft.profile import load_profile
from fabcraft.solid.arrange import PLATE_GAP_MM, arrange
from fabcraft.solid.manifolds import to_manifold

MINI = load_profile("prusa-mini")


def test_parts_lie_on_one_plate_with_the_gap_between_them() -> None:
    parts = [box(100.0, 40.0, 20.0), box(60.0, 60.0, 10.0), tube(25.0, 20.0, 15.0), box(30.0, 20.0, 40.0)]
    made = arrange(parts, MINI)
    assert made.count == 1
    solids = [to_manifold(one) for one in made.meshes]
    assert min(a.min_gap(b, 20.0) for a, b in combinations(solids, 2)) >= 5.0 - 1e-6
    lower = np.min([one.bounds[0] for one in made.meshes], axis=0)
    upper = np.max([one.bounds[1] for one in made.meshes], axis=0)
    assert (lower >= -1e-6).all() and (upper <= 180.0 + 1e-6).all()
    np.testing.assert_allclose(0.5 * (lower + upper)[:2], 90.0)
    for one, was in zip(made.meshes, parts, strict=True):
        assert one.bounds[0, 2] == pytest.approx(0.0)
        assert one.volume_mm3 == pytest.approx(was.volume_mm3)


def test_two_long_parts_are_turned_where_the_bed_asks_for_it() -> None:
    made = arrange([box(199.0, 115.0, 10.0), box(197.0, 111.0, 10.0)], load_profile("prusa-mk4"))
    assert made.count == 1


def test_a_part_lies_inside_an_open_one_where_its_shadow_has_room() -> None:
    made = arrange([tube(85.0, 80.0, 10.0), box(60.0, 60.0, 10.0)], MINI)
    assert made.count == 1


def test_what_does_not_fit_any_more_goes_onto_another_plate() -> None:
    made = arrange([box(120.0, 120.0, 10.0) for _ in range(3)], MINI)
    assert made.count == 3
    assert sorted(made.plates) == [0, 1, 2]
    middles = sorted(float(one.bounds.mean(0)[0]) for one in made.meshes)
    np.testing.assert_allclose(np.diff(middles), 180.0 + PLATE_GAP_MM)


def test_one_larger_than_the_bed_has_a_plate_of_its_own() -> None:
    made = arrange([box(300.0, 300.0, 10.0), box(20.0, 20.0, 10.0)], MINI)
    assert made.plates == (0, 1)
