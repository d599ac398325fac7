"""`scan`: a known head, damaged the way scans are, comes back upright, closed and with its landmarks."""

import numpy as np
import pytest
import trimesh

from fabcraft.body.human import human
from fabcraft.body.scan import ScanSettings, scan
from fabcraft.errors import InputError
from fabcraft.mesh import Mesh

Y_UP = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
"""Z up, facing -y, becomes Y up, facing +z."""


@pytest.fixture(scope="module")
def head():
    return human("man").part("head")


def opened(head, below_chin_mm=55.0):
    """The head without the faces below the chin: a neck that is open and ragged."""
    floor = head.landmarks["menton"][2] - below_chin_mm
    return head.mesh.submesh(np.flatnonzero(head.mesh.corners[:, :, 2].min(1) > floor))


def saved(path, mesh: Mesh, matrix=None, scale=1.0, noise_mm=0.0):
    rng = np.random.default_rng(3)
    vertices = mesh.vertices + rng.normal(0.0, noise_mm, mesh.vertices.shape) if noise_mm else mesh.vertices
    vertices = scale * (vertices if matrix is None else vertices @ np.asarray(matrix).T)
    trimesh.Trimesh(vertices, mesh.faces, process=False).export(path)
    return path


def assert_landmarks_close(body, head, limit_mm=5.0):
    """Up to a rigid movement, since the body frame's origin is not part of a scan."""
    names = sorted(head.landmarks)
    ours = np.stack([body.landmarks[name] for name in names])
    true = np.stack([head.landmarks[name] for name in names])
    shift = np.median(true - ours, axis=0)
    away = np.linalg.norm(ours + shift - true, axis=1)
    assert away.max() < limit_mm, dict(zip(names, away.round(1), strict=True))


def assert_closed(mesh):
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert solid.is_watertight
    assert solid.body_count == 1
    assert mesh.volume_mm3 > 1e6


def test_a_scan_in_metres_with_y_up_an_open_neck_and_noise_comes_back(tmp_path, head):
    path = saved(tmp_path / "me.stl", opened(head), Y_UP, 0.001, noise_mm=0.3)
    body = scan(path)
    assert body.kind == "scan"
    assert body.name == "me"
    assert_closed(body.mesh)
    assert_landmarks_close(body, head)
    assert any("metres" in note for note in body.notes)
    assert any("neck" in note for note in body.notes)
    assert {"forehead", "nose_tip", "lips", "ear_left", "cheekbone_right"} <= set(body.regions)
    nose = body.mesh.vertices[body.regions["nose_tip"].vertex_indices].mean(0)
    assert np.linalg.norm(nose - body.landmarks["pronasale"]) < 10
    assert body.landmarks["ear_tip_left"][0] > 60
    assert_closed(body.part("head").mesh)


def test_a_fine_inside_out_scan_with_holes_and_crumbs_comes_back(tmp_path, head):
    mesh = opened(head)
    vertices, faces = trimesh.remesh.subdivide(mesh.vertices, mesh.faces)
    holes = np.arange(len(faces)) % 9001 > 3
    crumb = trimesh.creation.icosphere(1, radius=4.0)
    together = trimesh.util.concatenate(
        [trimesh.Trimesh(vertices, faces[holes][:, ::-1], process=False), crumb]
    )
    tilt = trimesh.transformations.rotation_matrix(0.25, (1.0, 0.3, 1.0))[:3, :3]
    path = saved(
        tmp_path / "fine.ply", Mesh(np.asarray(together.vertices), together.faces.astype(np.int32)), tilt
    )
    body = scan(path, ScanSettings(units="mm"))
    assert len(body.mesh.faces) <= 60_000
    assert_closed(body.mesh)
    assert_landmarks_close(body, head)
    assert body.notes


def test_a_wrong_unit_is_refused_with_the_right_one(tmp_path, head):
    path = saved(tmp_path / "me.stl", opened(head), scale=0.001)
    with pytest.raises(InputError, match=r"looks like metres|--body-units m"):
        scan(path, ScanSettings(units="mm"))


@pytest.mark.parametrize(
    "shape", [trimesh.creation.icosphere(4, radius=110.0), trimesh.creation.box((150.0, 180.0, 250.0))]
)
def test_things_that_are_no_head_are_refused(tmp_path, shape):
    shape = shape if len(shape.faces) > 100 else shape.subdivide().subdivide().subdivide().subdivide()
    path = tmp_path / "thing.stl"
    shape.export(path)
    with pytest.raises(InputError, match="nobody was found"):
        scan(path)
