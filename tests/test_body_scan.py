"""`scan`: parts of known people, damaged the way scans are, come back upright, closed and with their landmarks."""

import numpy as np
import pytest
import trimesh
from scanned import (
    Y_UP,
    dense,
    girth_errors,
    holed,
    inside_out,
    landmark_errors,
    noisy,
    opened,
    saved,
    somebody,
    with_crumb,
)

from fabcraft.body.human import human
from fabcraft.body.model import human_model
from fabcraft.body.scan import ScanSettings, scan
from fabcraft.body.scan_part import part_model

MOST_FACES = 55_000


@pytest.fixture(scope="module")
def man():
    return somebody(human("man"))


@pytest.fixture(scope="module")
def woman():
    """With bent fingers."""
    return somebody(human("woman", hand="relaxed"), seed=7)


def tilt(angle, axis):
    return trimesh.transformations.rotation_matrix(angle, axis)[:3, :3]


def assert_usable(body, truth, count, mean_mm, most_mm, girth_mm):
    """Closed, one piece, with at least `count` landmarks and measures near to the true ones."""
    solid = trimesh.Trimesh(body.mesh.vertices, body.mesh.faces, process=False)
    assert solid.is_watertight
    assert solid.body_count == 1
    assert solid.volume > 0
    assert len(body.mesh.faces) <= MOST_FACES
    away = landmark_errors(body, truth)
    assert len(away) >= count
    assert np.mean(list(away.values())) < mean_mm, away
    assert max(away.values()) < most_mm, away
    girths = girth_errors(body, truth)
    assert girths
    assert max(map(abs, girths.values())) < girth_mm, girths


@pytest.fixture(scope="module")
def head_scan(man, tmp_path_factory):
    mesh = dense(opened(man, "head"), 100_000)
    return scan(saved(tmp_path_factory.mktemp("head") / "me.stl", noisy(mesh, 0.2), Y_UP, 0.001))


def test_a_noisy_head_in_metres_with_y_up_an_open_neck_and_many_faces_comes_back(man, head_scan):
    assert_usable(head_scan, man, 25, 2.5, 8.0, 2.5)
    assert (head_scan.kind, head_scan.name) == ("scan", "me")
    said = " ".join(head_scan.notes)
    assert all(word in said for word in ("metres", "thinned", "up is y", "front is z", "neck was cut level"))


def test_its_regions_lie_where_their_landmarks_are(head_scan):
    assert {"forehead", "nose_tip", "lips", "ear_left", "cheekbone_right"} <= set(head_scan.regions)
    nose = head_scan.mesh.vertices[head_scan.regions["nose_tip"].vertex_indices].mean(0)
    assert np.linalg.norm(nose - head_scan.landmarks["pronasale"]) < 10
    assert head_scan.landmarks["ear_tip_left"][0] > 60
    assert head_scan.part("head").mesh.volume_mm3 > 1e6


def test_a_hole_in_the_cheek_is_closed_and_said(man, tmp_path):
    mesh = opened(man, "head")
    cheek = (man.landmarks["zygion_left"] + man.landmarks["cheilion_left"]) / 2
    cheek = mesh.vertices[np.linalg.norm(mesh.vertices - cheek, axis=1).argmin()]
    path = saved(tmp_path / "cheek.ply", holed(mesh, cheek, 16.0), scale=0.1)
    body = scan(path, ScanSettings(units="cm", kind="head", up="z", front="-y"))
    assert_usable(body, man, 25, 2.5, 8.0, 2.5)
    assert any(note.startswith(("A hole", "An opening")) for note in body.notes)
    home = body.landmarks["sellion"] - man.landmarks["sellion"]
    away = np.linalg.norm(body.mesh.vertices - home - cheek, axis=1)
    assert away.min() < 4  # there is skin where the hole was


def test_an_inside_out_scan_with_a_crumb_and_pinholes_comes_back(woman, tmp_path):
    mesh = opened(woman, "head")
    mesh = mesh.submesh(np.arange(len(mesh.faces)) % 9001 > 3)
    path = saved(tmp_path / "fine.obj", with_crumb(inside_out(mesh)), tilt(2.0, (1.0, 2.0, 0.5)))
    body = scan(path, ScanSettings(units="mm", kind="head"))
    assert_usable(body, woman, 25, 2.5, 8.0, 2.5)
    said = " ".join(body.notes)
    assert "inside out" in said
    assert "Loose pieces beside the scan were left out: 1." in said


def test_a_hand_with_bent_fingers_and_its_forearm_comes_back(woman, tmp_path):
    path = saved(tmp_path / "hand.ply", opened(woman, "hand_left"), tilt(1.0, (0.2, 1.0, 0.5)), 0.001)
    body = scan(path, ScanSettings(kind="hand"))
    assert_usable(body, woman, 7, 1.5, 3.0, 1.5)
    assert {"wrist", "ring_finger"} <= {name.removesuffix("_left") for name in body.regions}
    assert any("a left hand with its forearm" in note for note in body.notes)


@pytest.mark.parametrize("side", ["left", "right"])
def test_up_is_out_of_the_back_of_a_hand(side):
    part = part_model(human_model(), f"hand_{side}")
    back = part.mean[part.landmarks[f"wrist_back_{side}"]] - part.mean[part.landmarks[f"wrist_palm_{side}"]]
    assert part.frame(part.mean)[0] @ back > 0.9 * np.linalg.norm(back)


def test_a_foot_comes_back(woman, tmp_path):
    body = scan(saved(tmp_path / "foot.ply", opened(woman, "foot_right"), Y_UP))
    assert_usable(body, woman, 5, 3.0, 5.0, 3.0)
    assert any("a right foot" in note for note in body.notes)


def test_a_whole_body_comes_back(woman, tmp_path):
    path = saved(tmp_path / "all.ply", woman.mesh, Y_UP, 0.001)
    body = scan(path, ScanSettings(kind="body", up="y"))
    assert_usable(body, woman, 50, 2.0, 6.0, 4.0)
