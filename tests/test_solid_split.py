"""Splitting: every part fits, nothing but the sockets is lost, and the pins go in."""

from dataclasses import replace

import numpy as np
import pytest
from plated import box, tube

from fabcraft.check.topology import inspect_topology
from fabcraft.errors import SolidError
from fabcraft.profile import load_profile
from fabcraft.solid.manifolds import to_manifold, union
from fabcraft.solid.split import FILAMENT_MM, Parts, fits, split

MINI = load_profile("prusa-mini")
BAR = box(300.0, 60.0, 40.0)


@pytest.fixture(scope="module")
def bar() -> Parts:
    return split(BAR, MINI)


def test_what_fits_stays_whole() -> None:
    small = box(100.0, 100.0, 100.0)
    assert split(small, MINI).parts == (small,)
    assert fits(box(200.0, 20.0, 20.0), MINI)  # turned by 45 degrees


def test_a_bar_becomes_two_parts_that_fit(bar: Parts) -> None:
    assert len(bar.parts) == 2
    assert all(fits(one, MINI) for one in bar.parts)
    assert [one.name for one in bar.parts] == ["box, part 1 of 2", "box, part 2 of 2"]
    for one in (*bar.parts, *bar.pins):
        found = inspect_topology(one)
        assert (found.open_edges, found.parts, found.self_intersections) == (0, 1, 0)


def test_the_parts_together_are_the_object_less_its_sockets(bar: Parts) -> None:
    together = union([to_manifold(one) for one in bar.parts])
    assert together.volume() + bar.sockets_mm3 == pytest.approx(BAR.volume_mm3, abs=1.0)
    assert (to_manifold(bar.parts[0]) ^ to_manifold(bar.parts[1])).volume() < 1e-6


def test_the_pins_go_into_their_sockets_with_clearance(bar: Parts) -> None:
    (cut,) = bar.cuts
    assert len(cut.places) == len(bar.pins) >= 2
    pin = to_manifold(bar.pins[0])
    high = bar.pins[0].size_mm[2]
    assert high == pytest.approx(2 * (cut.depth_mm - MINI.clearance_fit_mm))
    together = union([to_manifold(one) for one in bar.parts])
    for place in cut.places:
        # a pin stands along z; the bar is cut across x
        lying = pin.translate((0.0, 0.0, -0.5 * high)).rotate((0.0, 90.0, 0.0)).translate(tuple(place))
        assert lying.min_gap(together, 5.0) == pytest.approx(MINI.clearance_fit_mm, abs=0.03)


def test_a_wall_takes_as_wide_pins_as_it_has_room_for_or_none() -> None:
    def pins(wall: float) -> list[float]:
        return [cut.pin_mm for cut in split(tube(92.0, 92.0 - wall, 60.0), MINI).cuts]

    # a wall of 0.9 and a clearance of 0.2 stay on both sides of the pin
    (wide,) = pins(5.0)
    assert FILAMENT_MM <= wide <= 5.0 - 2.0 * (0.9 + 0.2)
    assert pins(3.0) == [0.0]


def test_what_would_need_too_many_parts_is_refused() -> None:
    with pytest.raises(SolidError, match="more than"):
        split(box(2000.0, 2000.0, 2000.0), replace(MINI, build_mm=(100.0, 100.0, 100.0)))


def test_a_slab_too_large_both_ways_becomes_four_parts() -> None:
    made = split(box(150.0, 150.0, 50.0), replace(MINI, build_mm=(100.0, 100.0, 100.0)))
    assert len(made.parts) == 4
    total = sum(one.volume_mm3 for one in made.parts)
    assert total + made.sockets_mm3 == pytest.approx(150.0**2 * 50.0, abs=1.0)
    assert np.all([one.size_mm <= 98.0 for one in made.parts])
