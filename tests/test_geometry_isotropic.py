"""Remeshing is judged on surfaces with known shape: even edges, the same surface, the same topology."""

import numpy as np
import pytest
import trimesh

from fabcraft.errors import InputError, SolidError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.isotropic import isotropic, isotropic_within
from fabcraft.mesh import Mesh


def as_mesh(shape: trimesh.Trimesh, name: str = "") -> Mesh:
    return Mesh(np.array(shape.vertices), np.array(shape.faces, dtype=np.int32), name)


@pytest.fixture(scope="module")
def torus() -> Mesh:
    return as_mesh(trimesh.creation.torus(20.0, 6.0, major_sections=160, minor_sections=64), "torus")


def edges_mm(mesh: Mesh) -> np.ndarray:
    return np.linalg.norm(mesh.corners - np.roll(mesh.corners, 1, axis=1), axis=2).ravel()


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_torus_keeps_its_shape_and_handle_and_gets_even_edges(torus, mirrored):
    even = isotropic(torus, 1.5, mirrored=mirrored)
    shape = trimesh.Trimesh(even.vertices, even.faces, process=False)
    assert shape.is_watertight
    assert shape.is_winding_consistent
    assert shape.euler_number == 0
    assert edges_mm(even).mean() == pytest.approx(1.5, rel=0.06)
    assert edges_mm(even).std() < 0.25 * 1.5
    assert np.percentile(edges_mm(even), [0.5, 99.5]) == pytest.approx([1.5, 1.5], rel=0.5)
    there = SurfaceDistance(torus).closest(even.vertices).distances.max()
    back = SurfaceDistance(even).closest(torus.vertices).distances.max()
    assert there < 0.02
    assert back < 1.05 * edges_mm(even).max() ** 2 / (8 * 6.0)  # the sagitta of the longest edge on the tube


def test_the_same_surface_gives_the_same_mesh(torus):
    one, other = isotropic(torus, 2.0), isotropic(torus, 2.0)
    assert (one.vertices == other.vertices).all()
    assert (one.faces == other.faces).all()


def test_a_mirrored_mesh_is_its_own_mirror_image(torus):
    even = isotropic(torus, 2.0, mirrored=True)
    image = even.vertices * [-1.0, 1.0, 1.0] + 0.0
    order = np.lexsort(np.round(even.vertices, 9).T)
    assert image[np.lexsort(np.round(image, 9).T)] == pytest.approx(even.vertices[order], abs=1e-9)


def test_far_from_what_is_meshed_anew_every_face_stays_and_nothing_opens(torus):
    chosen = torus.corners.mean(1)[:, 0] > 15.0
    even = isotropic_within(torus, 3.0, chosen)
    shape = trimesh.Trimesh(even.vertices, even.faces, process=False)
    assert shape.is_watertight and shape.is_winding_consistent and shape.euler_number == 0
    places = {corners.tobytes() for corners in even.corners}
    assert sum(corners.tobytes() in places for corners in torus.corners[~chosen]) > 0.98 * (~chosen).sum()
    assert len(even.faces) < len(torus.faces) - 0.5 * chosen.sum()


def test_creases_stay_where_asked():
    box = trimesh.creation.box((20.0, 30.0, 10.0))
    even = isotropic(as_mesh(box), 2.0, crease_deg=40.0)
    away = SurfaceDistance(even).closest(np.asarray(box.vertices)).distances
    assert away.max() < 1e-6
    assert even.volume_mm3 == pytest.approx(6000.0, rel=1e-6)


def test_an_open_surface_keeps_its_border():
    disc = trimesh.creation.annulus(10.0, 30.0, 1.0, sections=180)
    top = as_mesh(disc).submesh(disc.face_normals[:, 2] > 0.5)
    even = isotropic(top, 2.5)
    shape = trimesh.Trimesh(even.vertices, even.faces, process=False)
    assert shape.euler_number == 0
    assert even.area_mm2 == pytest.approx(np.pi * (30.0**2 - 10.0**2), rel=0.01)
    assert even.vertices[:, 2] == pytest.approx(0.5)


def test_what_the_edges_are_too_long_for_is_refused(torus):
    with pytest.raises(SolidError, match="too small"):
        isotropic(torus, 10.0)


def test_a_branching_surface_is_refused():
    box = trimesh.creation.box()
    faces = np.array(np.concatenate([box.faces, box.faces[:1]]), dtype=np.int32)
    with pytest.raises(InputError, match="more than two faces"):
        isotropic(Mesh(np.array(box.vertices), faces), 0.2)


@pytest.mark.parametrize("edge_mm", [0.0, -1.0, float("nan")])
def test_a_length_must_be_above_zero(torus, edge_mm):
    with pytest.raises(InputError, match="edge length"):
        isotropic(torus, edge_mm)


def test_a_mesh_without_faces_is_refused():
    with pytest.raises(InputError, match="no faces"):
        isotropic(Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32)), 1.0)
