import numpy as np
import pytest
import torch
import trimesh

from fabcraft.geometry.poisson import PoissonSystem, nearest_links


def two_balls(gap=0.5):
    ball = trimesh.creation.icosphere(2, 1.0)
    left, right = np.array(ball.vertices), np.array(ball.vertices) + [2.0 + gap, 0.1, -0.2]
    return np.concatenate([left, right]), np.concatenate([ball.faces, ball.faces + len(left)])


def test_one_piece_needs_no_links():
    ball = trimesh.creation.icosphere(1, 1.0)
    assert nearest_links(np.array(ball.vertices), np.array(ball.faces)).shape == (0, 2)


def test_links_tie_every_piece_and_only_pieces():
    ball = trimesh.creation.icosphere(1, 1.0)
    count = len(ball.vertices)
    vertices = np.concatenate([np.array(ball.vertices) + [3.0 * i, 0, 0] for i in range(4)])
    faces = np.concatenate([np.array(ball.faces) + i * count for i in range(4)])
    links = nearest_links(vertices, faces, count=3)
    assert (links[:, 0] // count != links[:, 1] // count).all()
    assert np.abs(links[:, 0] // count - links[:, 1] // count).max() == 1  # neighbours in the row of balls
    assert len(np.unique(PoissonSystem.of(vertices, faces, links).components)) == 1


def test_identity_jacobians_return_the_linked_mesh():
    vertices, faces = two_balls()
    system = PoissonSystem.of(vertices, faces, nearest_links(vertices, faces), link_weight=3.0)
    identity = torch.eye(3, dtype=torch.float64).expand(len(faces), 3, 3)
    np.testing.assert_allclose(system.vertices(identity).numpy(), vertices, atol=1e-9)


def gap_between(points, count):
    return points[count:, 0].min() - points[:count, 0].max()


def test_linked_pieces_stay_side_by_side_when_both_grow():
    vertices, faces = two_balls()
    count = len(vertices) // 2
    twice = 2.0 * torch.eye(3, dtype=torch.float64).expand(len(faces), 3, 3)
    alone = PoissonSystem.of(vertices, faces).vertices(twice).numpy()
    linked = PoissonSystem.of(vertices, faces, nearest_links(vertices, faces)).vertices(twice).numpy()
    assert gap_between(alone, count) < -1.0  # each grows about its own middle, into the other
    assert gap_between(linked, count) == pytest.approx(0.5, abs=0.15)


def test_the_gradient_of_a_linked_system_matches_finite_differences():
    vertices, faces = two_balls()
    system = PoissonSystem.of(vertices, faces, nearest_links(vertices, faces))
    generator = torch.Generator().manual_seed(0)
    weights = torch.randn(len(vertices), 3, dtype=torch.float64, generator=generator)
    field = torch.randn(len(faces), 3, 2, dtype=torch.float64, generator=generator, requires_grad=True)
    direction = torch.randn(field.shape, dtype=torch.float64, generator=generator)

    def energy(restricted):
        return (system.vertices_of_restricted(restricted) ** 2 * weights).sum()

    energy(field).backward()
    step = 1e-6
    with torch.no_grad():
        difference = (energy(field + step * direction) - energy(field - step * direction)) / (2 * step)
    assert float((field.grad * direction).sum()) == pytest.approx(float(difference), rel=1e-6)
