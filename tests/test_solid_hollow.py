"""Hollowing: the wall is kept, every cavity drains, and what is thin stays as it is."""

import numpy as np
import pytest
import trimesh
from plated import box

from fabcraft.check.topology import inspect_topology
from fabcraft.errors import InputError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh
from fabcraft.solid.hollow import Hollowed, hollow

SIZE = (36.0, 28.0, 20.0)


@pytest.fixture(scope="module")
def made() -> Hollowed:
    return hollow(box(*SIZE), 2.5, 3.5)


def test_a_box_keeps_its_wall_and_loses_its_inside(made: Hollowed) -> None:
    assert made.cavities == 1
    assert 2.5 <= made.numbers["hollow_wall_mm"] <= 2.65
    inner = (SIZE[0] - 5) * (SIZE[1] - 5) * (SIZE[2] - 5)
    assert 0.85 * inner < made.numbers["hollow_saved_mm3"] < 1.02 * inner
    points = [one for one in made.mesh.vertices if (abs(one) < [17.9, 13.9, 9.9]).all()]
    assert len(points) > 50


def test_two_holes_at_the_low_points_open_the_cavity(made: Hollowed) -> None:
    found = inspect_topology(made.mesh)
    assert (found.open_edges, found.parts, found.genus, found.self_intersections) == (0, 1, 1, 0)
    assert len(made.holes) == 2
    assert min(z for _, _, z in made.holes) == pytest.approx(-10.0)
    assert max(z for _, _, z in made.holes) <= -10.0 + 0.4 * SIZE[2]
    # through each of them a rod of nearly its width passes into the inside
    surface = SurfaceDistance(made.mesh)
    for place in made.holes:
        assert surface.closest(np.array([place])).distances[0] == pytest.approx(1.75, abs=0.1)


def test_holes_keep_off_the_side_that_is_to_be_clean() -> None:
    found = hollow(box(*SIZE), 2.5, 3.5, lambda points: points[:, 2] < -9.9)
    assert min(z for _, _, z in found.holes) > -9.9


def test_a_thin_plate_stays_as_it_is() -> None:
    plate = box(60.0, 40.0, 5.0)
    found = hollow(plate, 2.0, 3.5)
    assert found.cavities == 0
    assert found.mesh is plate


def test_each_of_two_cavities_drains() -> None:
    two = trimesh.boolean.union(
        [trimesh.creation.box((20, 20, 20)), trimesh.creation.box((70, 6, 6)).apply_translation((25, 0, 0)),
         trimesh.creation.box((20, 20, 20)).apply_translation((50, 0, 0))], engine="manifold"
    )  # fmt: skip
    found = hollow(Mesh(two.vertices, two.faces.astype("int32"), "bone"), 2.0, 3.0)
    assert found.cavities == 2
    assert len(found.holes) == 4
    assert inspect_topology(found.mesh).parts == 1


@pytest.mark.parametrize(("wall", "hole"), [(-1.0, 3.0), (2.0, 0.0), (float("nan"), 3.0)])
def test_a_wall_or_hole_that_is_none_is_refused(wall: float, hole: float) -> None:
    with pytest.raises(InputError, match="was asked"):
        hollow(box(*SIZE), wall, hole)
