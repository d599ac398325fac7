"""Walls around a sphere that ends at a height: thickness, rim and pads are known."""

import numpy as np
import pytest

from fabcraft.check.topology import inspect_topology
from fabcraft.geometry.walled import Wall, walled
from fabcraft.mesh import Mesh

RADIUS, THICK, END = 20.0, 3.0, -5.0
BOUNDS = np.array([[-26.0] * 3, [26.0] * 3])


def radius(points):
    return np.linalg.norm(points, axis=1)


def cap(**more) -> Wall:
    return Wall(
        middle=lambda p: radius(p) - RADIUS,
        beyond=lambda p: END - p[:, 2],
        outer=lambda p: radius(p) - RADIUS - 0.5 * THICK,
        inner=lambda p: RADIUS - 0.5 * THICK - radius(p),
        **more,
    )


@pytest.fixture(scope="module")
def bowl() -> tuple[Mesh, np.ndarray]:
    return walled(cap(), BOUNDS, 3.0, 1.5, mirrored=True)


def test_a_bowl_is_a_closed_solid_between_its_spheres(bowl):
    mesh, inside = bowl
    found = inspect_topology(mesh)
    assert found.solid
    assert found.genus == 0
    assert found.self_intersections == 0
    away = radius(mesh.vertices)
    assert away.min() == pytest.approx(RADIUS - 0.5 * THICK, abs=1e-3)
    assert away.max() == pytest.approx(RADIUS + 0.5 * THICK, abs=1e-3)
    assert radius(mesh.corners[inside].reshape(-1, 3)) == pytest.approx(RADIUS - 0.5 * THICK, abs=1e-3)


def test_its_rim_is_a_half_round_beyond_its_end(bowl):
    mesh, _ = bowl
    height = mesh.vertices[:, 2].min()
    across = np.sqrt(1.0 - (END / RADIUS) ** 2)  # the rim runs on along the sphere
    assert height == pytest.approx(END * (1.0 + 0.5 * THICK / RADIUS) - 0.5 * THICK * across, abs=0.5)


def test_mirrored_fields_make_a_mirrored_mesh(bowl):
    places = {tuple(row) for row in np.round(bowl[0].vertices + 0.0, 6)}
    assert {(0.0 - x, y, z) for x, y, z in places} == places


def test_a_wall_is_nowhere_thinner_than_promised():
    mesh, inside = walled(cap(least_mm=4.0), BOUNDS, 3.0, 1.5)
    assert radius(mesh.corners[inside].reshape(-1, 3)) == pytest.approx(RADIUS - 0.5 * THICK, abs=1e-3)
    assert radius(mesh.vertices).max() == pytest.approx(RADIUS - 0.5 * THICK + 4.0, abs=1e-2)


def test_a_pad_reaches_in_to_where_it_rests():
    pad = cap(
        rest=lambda p: 15.0 - radius(p),
        resting=lambda p: (p[:, 2] > 15.0).astype(float),
    )
    mesh, inside = walled(pad, BOUNDS, 3.0, 1.5)
    corners = mesh.corners[inside].reshape(-1, 3)
    along = corners[:, 2] / radius(corners)
    assert radius(corners[along > 0.8]) == pytest.approx(15.0, abs=1e-3)
    assert radius(corners[along < 0.6]) == pytest.approx(RADIUS - 0.5 * THICK, abs=1e-3)
