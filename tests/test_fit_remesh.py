from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh
from worn import ball, horned, torus

from fabcraft.fit.deform import deform
from fabcraft.fit.descend import Variables
from fabcraft.fit.presets import PRESETS
from fabcraft.fit.remesh import carried, refine, slivers
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.operators import boundary_loops
from fabcraft.geometry.poisson import PoissonSystem
from fabcraft.geometry.triangulate import triangulate
from fabcraft.guidance.target_points import TargetPoints
from fabcraft.mesh import Mesh


def pulled(mesh, length=40.0):
    """What is on the right is drawn out to the right."""
    side = np.clip(mesh.vertices[:, :1] / mesh.vertices[:, 0].max(), 0.0, 1.0)
    return mesh.with_vertices(mesh.vertices + length * side**2 * [1.0, 0.0, 0.0])


def sheet():
    square = np.array([[-20.0, -20.0], [20.0, -20.0], [20.0, 20.0], [-20.0, 20.0]])
    rim = np.concatenate(
        [np.linspace(a, b, 16, endpoint=False) for a, b in zip(square, np.roll(square, -1, 0), strict=True)]
    )
    turn = np.arange(16) * 2.0 * np.pi / 16
    hole = 6.0 * np.stack([np.cos(turn), np.sin(turn)], 1)
    flat = triangulate([rim, hole], 2.5)
    return Mesh(np.column_stack([flat.points, np.zeros(len(flat.points))]), flat.faces, "sheet")


def euler(mesh):
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).euler_number


def smallest_angles(mesh):
    return np.degrees(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).face_angles.min(1))


def none(mesh):
    return np.zeros(len(mesh.faces), dtype=bool)


@pytest.mark.parametrize("rest", [ball(20.0, 3), torus(20.0, 6.0), sheet()])
def test_a_stretched_surface_gets_faces_and_keeps_its_shape_genus_and_rims(rest):
    drawn = pulled(rest)
    found = refine(drawn, rest.vertices, none(rest), 3.0)
    assert found.split > 50 and euler(found.mesh) == euler(rest)
    assert np.quantile(smallest_angles(found.mesh), 0.02) > np.quantile(smallest_angles(drawn), 0.02)
    on_it = SurfaceDistance(drawn).closest(np.concatenate([found.mesh.vertices, found.mesh.corners.mean(1)]))
    assert on_it.distances.max() < 0.25 * 3.0
    before, after = (boundary_loops(mesh.faces.astype(np.int64)) for mesh in (drawn, found.mesh))
    assert len(after) == len(before)
    for old, new in zip(before, after, strict=True):
        length = [
            np.linalg.norm(np.diff(m.vertices[np.append(i, i[0])], axis=0), axis=1).sum()
            for m, i in ((drawn, old), (found.mesh, new))
        ]
        assert length[1] == pytest.approx(length[0], rel=1e-9)


def test_no_refined_edge_is_still_long_and_stretched():
    rest = ball(20.0, 3)
    found = refine(pulled(rest), rest.vertices, none(rest), 3.0)
    ends = found.mesh.vertices[found.mesh.faces[:, [0, 1]]]
    assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).max() < 1.6 * 3.0 * 4.0 / 3.0


def test_what_is_not_stretched_or_locked_keeps_its_faces():
    rest = ball(20.0, 3)
    assert refine(rest, rest.vertices, none(rest), 1.0).split == 0
    locked = rest.corners.mean(1)[:, 0] > 10.0
    found = refine(pulled(rest), rest.vertices, locked, 3.0)
    np.testing.assert_array_equal(found.mesh.faces[: len(locked)][locked], rest.faces[locked])
    np.testing.assert_array_equal(
        found.mesh.vertices[rest.faces[locked]], pulled(rest).vertices[rest.faces[locked]]
    )
    assert found.locked.sum() == locked.sum()


def test_moments_carried_over_to_the_same_mesh_are_the_same():
    rest = ball(1.0, 2)
    system = PoissonSystem.of(rest.vertices, rest.faces)
    random = torch.Generator().manual_seed(0)
    first, second = (torch.rand(len(rest.faces), 3, 2, generator=random) for _ in range(2))
    given = Variables(
        torch.zeros_like(first), torch.ones(3), (first, second, torch.ones(3), torch.ones(3)), 7
    )
    found = carried(given, system, rest, system)
    assert found.step == 7 and found.moments is not None and not found.offset.any()
    torch.testing.assert_close(found.moments[0], first, atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(found.moments[1], second, atol=1e-5, rtol=1e-4)


def test_a_gradient_carried_over_is_the_gradient_on_the_new_rest():
    rest = ball(1.0, 2)
    old = PoissonSystem.of(rest.vertices, rest.faces)
    now = rest.with_vertices(rest.vertices * [1.5, 0.8, 1.2])
    new = PoissonSystem.of(now.vertices, now.faces)
    pull = torch.from_numpy(np.random.default_rng(0).normal(size=now.vertices.shape)).float()

    def gradient(system, restricted):
        unknown = torch.from_numpy(restricted).float().requires_grad_(True)
        (system.vertices_of_restricted(unknown) * pull).sum().backward()
        return unknown.grad

    before = gradient(old, old.restricted(now.vertices))
    moments = (before, before, torch.zeros(3), torch.zeros(3))
    found = carried(Variables(torch.zeros_like(before), torch.zeros(3), moments, 1), old, now, new)
    # the solves differ (area weights), so they agree in direction, not in every number
    wanted = gradient(new, new.restricted(now.vertices))
    alike = torch.nn.functional.cosine_similarity(found.moments[0].flatten(), wanted.flatten(), dim=0)
    assert float(alike) > 0.9


@pytest.mark.parametrize("length", [20.0, 35.0])
def test_refining_comes_nearer_to_long_horns_than_fixed_triangles(length):
    rest, target = ball(20.0, 3), horned(length)
    goal = SurfaceDistance(target)
    settings = replace(PRESETS["draft"], steps=160, seed=1)
    missed, reached = {}, {}
    for every in (0, 40):
        guidance = TargetPoints.of(target, rest, count=2000)
        found = deform(rest, guidance=[guidance], settings=replace(settings, remesh_every=every))
        back = SurfaceDistance(found.mesh).closest(target.vertices).distances
        missed[every] = np.sqrt((goal.closest(found.mesh.vertices).distances ** 2).mean()) + np.sqrt(
            (back**2).mean()
        )
        reached[every] = found
    assert reached[0].remeshed == 0 and reached[40].remeshed >= 2
    assert missed[40] < 0.7 * missed[0]
    assert euler(reached[40].mesh) == 2 and smallest_angles(reached[40].mesh).min() > 3.0


def test_slivers_are_faces_without_an_area_to_speak_of():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 1e-7, 0]])
    faces = np.array([[0, 1, 2], [0, 1, 3], [0, 0, 1]], dtype=np.int32)
    assert slivers(Mesh(points, faces)).tolist() == [False, True, True]
