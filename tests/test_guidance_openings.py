"""A guidance mask's openings before the template's: known shifts, and when nothing is moved."""

from dataclasses import replace

import manifold3d
import numpy as np
import pytest

from fabcraft.geometry.align import Similarity
from fabcraft.geometry.plane import Plane
from fabcraft.guidance.alignment import Aligned
from fabcraft.guidance.openings import opened, openings
from fabcraft.mesh import Mesh
from fabcraft.solid.manifolds import to_mesh


def plate(
    *holes: tuple[float, float],
    width: float = 120.0,
    height: float = 160.0,
    radius: float = 9.0,
    y: float = 0.0,
) -> Mesh:
    """An upright plate, 4 mm thick, its middle at (0, y, 0), with round holes at (x, z)."""
    solid = manifold3d.Manifold.cube((width, 4.0, height), True).translate((0.0, y, 0.0))
    for x, z in holes:
        drill = manifold3d.Manifold.cylinder(20.0, radius, radius, 32, True).rotate((90.0, 0.0, 0.0))
        solid -= drill.translate((x, y, z))
    return to_mesh(solid, "plate")


def placed(mesh: Mesh, given: bool = False) -> Aligned:
    return Aligned(mesh, 0.02, Similarity(1.1, np.eye(3), np.array([1.0, 2.0, 3.0])), given)


EYES = ((-30.0, 20.0), (30.0, 20.0))


def test_openings_are_found_where_they_were_drilled() -> None:
    mesh = plate((-30.0, 20.0), (25.0, -5.0))
    plane = Plane.around(mesh.vertices[:, [0, 2]], 0.7, 3.0)
    found = openings(mesh, plane)
    assert found[np.argsort(found[:, 0])] == pytest.approx(np.array([[-30.0, 20.0], [25.0, -5.0]]), abs=0.4)


def test_a_pinhole_and_the_space_around_are_no_openings() -> None:
    mesh = plate((0.0, 0.0), radius=1.0)
    assert len(openings(mesh, Plane.around(mesh.vertices[:, [0, 2]], 0.7, 3.0))) == 0


def test_the_guidance_is_moved_by_the_way_between_the_openings_and_keeps_its_place_before_the_face() -> None:
    goal = placed(plate((-28.0, 8.0), (34.0, 8.0), width=150.0, y=-3.0))
    found = opened(goal, plate(*EYES))
    moved = found.mesh.vertices - goal.mesh.vertices
    assert np.ptp(moved, axis=0).max() < 1e-9
    assert moved[0] == pytest.approx([-3.0, 3.0, 12.0], abs=0.5)
    start = np.array([[5.0, 6.0, 7.0]])
    assert found.placed.points(start) == pytest.approx(goal.placed.points(start) + moved[0])


def test_of_three_openings_those_that_lie_as_the_template_s_are_taken() -> None:
    goal = placed(plate((-30.0, 10.0), (30.0, 10.0), (0.0, -45.0)))
    moved = opened(goal, plate(*EYES)).mesh.vertices - goal.mesh.vertices
    assert moved[0] == pytest.approx([0.0, 0.0, 10.0], abs=0.5)


@pytest.mark.parametrize(
    "holes",
    [(), ((0.0, 0.0),), ((-30.0, -55.0), (30.0, -55.0)), ((-5.0, 60.0), (0.0, -60.0))],
    ids=["none", "one", "too far away", "one over the other"],
)
def test_openings_that_are_not_the_template_s_move_nothing(holes: tuple[tuple[float, float], ...]) -> None:
    goal = placed(plate(*holes))
    assert opened(goal, plate(*EYES)) is goal


def test_what_its_user_has_placed_stays_there() -> None:
    goal = placed(plate((-30.0, 10.0), (30.0, 10.0)))
    said = replace(goal, given=True)
    assert opened(said, plate(*EYES)) is said
    assert opened(goal, plate()) is goal
