"""The two sides of a wall kept apart: known crossings, and walls that are left alone."""

import numpy as np
import pytest
from nasty import ball, inverted

from fabcraft.fit.walls import kept_apart
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh, concatenate

BODY = SurfaceDistance(ball(20.0))


def shell(outer_mm: float = 25.0, inner_mm: float = 23.0) -> Mesh:
    """A hollow ball around the body."""
    return concatenate([ball(outer_mm), inverted(ball(inner_mm))])


def dented(mesh: Mesh, to_mm: float) -> Mesh:
    """Its outer side pressed in to a radius at the top."""
    radius = np.linalg.norm(mesh.vertices, axis=1)
    pressed = (radius > 24.0) & (mesh.vertices[:, 2] > 0.8 * radius)
    return mesh.with_vertices(np.where(pressed, to_mm / radius, 1.0)[:, None] * mesh.vertices)


def test_what_went_through_the_other_side_comes_back_behind_it() -> None:
    built = shell()
    found, pushed = kept_apart(dented(built, 22.0), built.vertices, BODY, 1.2, 3.0)
    count = len(ball(25.0).vertices)
    radius = np.linalg.norm(found.vertices, axis=1)
    # the inner side is left where it was, but for what the facets of the balls take
    assert radius[:count].min() > 24.2 - 0.08
    assert np.abs(radius[count:] - 23.0).max() < 0.05
    assert pushed == pytest.approx(2.2, abs=0.1)


def test_a_wall_that_is_thick_enough_is_left_alone() -> None:
    built = shell()
    found, pushed = kept_apart(dented(built, 24.6), built.vertices, BODY, 1.2, 3.0)
    assert pushed == 0.0
    np.testing.assert_array_equal(found.vertices, dented(built, 24.6).vertices)


def test_a_wall_that_was_built_thinner_stays_so() -> None:
    built = shell(25.0, 24.3)
    assert kept_apart(built, built.vertices, BODY, 1.2, 3.0)[1] == 0.0


def test_a_solid_without_a_side_towards_the_body_is_left_alone() -> None:
    ring = ball(30.0)
    assert kept_apart(ring, ring.vertices, BODY, 1.2, 3.0)[1] == 0.0


def test_a_fold_far_through_the_other_side_draws_no_thorn() -> None:
    built = shell()
    folded = built.vertices.copy()
    folded[int(np.argmax(folded[:, 2] * (np.linalg.norm(folded, axis=1) > 24.0)))] = [0.0, 0.0, 12.0]
    found, _ = kept_apart(built.with_vertices(folded), built.vertices, BODY, 1.2, 3.0)
    assert np.linalg.norm(found.vertices - folded, axis=1).max() < 3.0
