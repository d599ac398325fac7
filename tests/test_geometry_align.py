"""Similarities come back exactly from pairs, and closely from unpaired points."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fabcraft.geometry.align import Similarity, axis_rotations, fit_similarity, similarity_icp, spread_points


def some_similarity(angle_deg, scale):
    turn = Rotation.from_rotvec(np.radians(angle_deg) * np.array([0.6, 0.0, 0.8])).as_matrix()
    return Similarity(scale, turn, np.array([5.0, -7.0, 11.0]))


def test_known_pairs_give_the_similarity_back():
    points = np.random.default_rng(0).normal(size=(50, 3))
    asked = some_similarity(130.0, 1.7)
    found = fit_similarity(points, asked.points(points))
    assert found.matrix == pytest.approx(asked.matrix)
    assert found.rms == pytest.approx(0, abs=1e-12)


def test_the_scale_stays_in_its_range_and_a_mirror_is_never_used():
    points = np.random.default_rng(0).normal(size=(50, 3))
    assert fit_similarity(points, 3.0 * points, (0.5, 2.0)).scale == 2.0
    assert np.linalg.det(fit_similarity(points, points * [-1, 1, 1]).rotation) == pytest.approx(1)


def test_the_inverse_leads_back():
    points = np.random.default_rng(0).normal(size=(20, 3))
    there = some_similarity(40.0, 0.6)
    assert there.inverse().points(there.points(points)) == pytest.approx(points)


def test_icp_finds_a_turned_and_scaled_ellipsoid_bump():
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(1500, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = normals * (1.0 + 0.5 * np.exp(-8 * ((normals - [0, -1, 0]) ** 2).sum(1, keepdims=True)))
    points = points * [80.0, 100.0, 130.0]
    asked = some_similarity(15.0, 1.1)
    found = similarity_icp(
        points, asked.points(points), normals, normals @ asked.rotation.T, Similarity(), iterations=80
    )
    assert found.points(points) == pytest.approx(asked.points(points), abs=1.0)


def test_there_are_24_axis_rotations_and_all_differ():
    rotations = np.stack(axis_rotations())
    assert len(np.unique(rotations.reshape(24, -1), axis=0)) == 24
    assert np.linalg.det(rotations) == pytest.approx(1)
    assert (rotations[0] == np.eye(3)).all()


def test_spread_points_are_few_and_reach_everywhere():
    points = np.random.default_rng(2).uniform(size=(5000, 3))
    chosen = spread_points(points, 300)
    assert 100 < len(chosen) <= 300
    assert len(np.unique(chosen)) == len(chosen)
    gaps = np.linalg.norm(points[:, None] - points[chosen][None], axis=2).min(1)
    assert gaps.max() < 0.35
