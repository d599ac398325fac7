import numpy as np
import pytest
import torch
import trimesh

from fabcraft.errors import InputError
from fabcraft.geometry.poisson import PoissonSystem


def sphere(subdivisions=2):
    mesh = trimesh.creation.icosphere(subdivisions, 2.0)
    return np.array(mesh.vertices) + [1.0, -2.0, 3.0], np.array(mesh.faces)


def open_patch():
    vertices, faces = sphere()
    faces = faces[vertices[faces].mean(1)[:, 2] > 3.2]
    used, compact = np.unique(faces, return_inverse=True)
    return vertices[used], compact.reshape(-1, 3)


def two_parts():
    (v1, f1), (v2, f2) = sphere(1), open_patch()
    return np.concatenate([v1, v2 + 5]), np.concatenate([f1, f2 + len(v1)])


@pytest.mark.parametrize("shape", [sphere, open_patch, two_parts])
def test_identity_jacobians_return_the_same_mesh(shape):
    vertices, faces = shape()
    system = PoissonSystem.of(vertices, faces)
    identity = torch.eye(3, dtype=torch.float64).expand(len(faces), 3, 3)
    np.testing.assert_allclose(system.vertices(identity).numpy(), vertices, atol=1e-9)


@pytest.mark.parametrize("shape", [sphere, open_patch, two_parts])
def test_a_constant_jacobian_gives_the_affine_image_about_each_centroid(shape):
    vertices, faces = shape()
    system = PoissonSystem.of(vertices, faces)
    matrix = np.array([[1.2, 0.3, 0.0], [-0.1, 0.8, 0.2], [0.4, 0.0, 1.5]])
    found = system.vertices(torch.from_numpy(matrix).expand(len(faces), 3, 3)).numpy()
    for component in np.unique(system.components):
        part = system.components == component
        weight = np.bincount(faces.ravel(), np.repeat(system.areas, 3), minlength=len(vertices))[part]
        centre = np.average(vertices[part], axis=0, weights=weight)
        np.testing.assert_allclose(found[part], (vertices[part] - centre) @ matrix.T + centre, atol=1e-8)


def test_the_normal_part_of_a_jacobian_moves_nothing():
    vertices, faces = sphere()
    system = PoissonSystem.of(vertices, faces)
    normals = np.cross(system.frames[:, :, 0], system.frames[:, :, 1])
    noise = np.random.default_rng(0).normal(size=(len(faces), 3))
    field = np.eye(3) + np.einsum("fi,fj->fij", noise, normals)
    np.testing.assert_allclose(system.vertices(torch.from_numpy(field)).numpy(), vertices, atol=1e-9)


def test_jacobians_and_vertices_are_inverse_to_each_other():
    vertices, faces = open_patch()
    system = PoissonSystem.of(vertices, faces)
    moved = vertices + 0.2 * np.sin(vertices[:, [1, 2, 0]])
    back = system.vertices(torch.from_numpy(system.jacobians(moved))).numpy()
    np.testing.assert_allclose(back - back.mean(0), moved - moved.mean(0), atol=1e-10)


def test_the_gradient_matches_finite_differences():
    vertices, faces = two_parts()
    system = PoissonSystem.of(vertices, faces)
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


def test_an_unused_vertex_is_named():
    vertices, faces = sphere(1)
    with pytest.raises(InputError, match=f"vertex {len(vertices)}"):
        PoissonSystem.of(np.vstack([vertices, [[0.0, 0, 0]]]), faces)
