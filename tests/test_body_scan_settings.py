"""What is said of a scan: landmark files, kind, up, front and unit; wrong ones are refused with what to do."""

import json

import numpy as np
import pytest
import trimesh
from scanned import Y_UP, opened, saved

from fabcraft.body.human import human
from fabcraft.body.scan import NotFoundError, ScanSettings, scan
from fabcraft.errors import InputError
from fabcraft.mesh import Mesh, concatenate


@pytest.fixture(scope="module")
def man():
    return human("man")


@pytest.fixture(scope="module")
def head_file(man, tmp_path_factory):
    return saved(tmp_path_factory.mktemp("head") / "me.stl", opened(man, "head"), Y_UP, 0.001)


def ellipsoid(middle, radii):
    ball = trimesh.creation.icosphere(1)
    return Mesh(np.array(ball.vertices) * radii + middle, ball.faces.astype(np.int32))


def animal() -> Mesh:
    """A four-legged animal of 49 low-poly pieces, metres, Y up, looking along +z, as a game has it."""
    pieces = [ellipsoid((0, 0.8, 0), (0.25, 0.28, 0.6)), ellipsoid((0, 1.05, 0.6), (0.13, 0.3, 0.16))]
    pieces += [ellipsoid((0, 1.3, 0.75), (0.14, 0.15, 0.2)), ellipsoid((0, 1.24, 0.93), (0.09, 0.08, 0.12))]
    for side in (-1, 1):
        pieces.append(ellipsoid((0.09 * side, 1.36, 0.86), (0.04, 0.04, 0.04)))
        pieces += [ellipsoid((0.1 * side, 1.42 + 0.05 * k, 0.7), (0.03, 0.06, 0.02)) for k in range(3)]
        for z in (-0.42, 0.42):
            legs = [ellipsoid((0.15 * side, 0.7 - 0.08 * k, z), (0.07, 0.09, 0.07)) for k in range(8)]
            pieces += legs
    pieces += [ellipsoid((0, 0.85 - 0.04 * k, -0.58 - 0.03 * k), (0.03, 0.05, 0.04)) for k in range(5)]
    return concatenate(pieces)


MARKS = {
    "sellion": (0, 1.36, 0.935),
    "menton": (0, 1.165, 0.93),
    "tragion_left": (0.14, 1.3, 0.75),
    "tragion_right": (-0.14, 1.3, 0.75),
}
"""On the animal's head, in its file's frame."""


@pytest.fixture(scope="module")
def animal_file(tmp_path_factory):
    mesh = animal()
    assert trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).body_count == 49
    return saved(tmp_path_factory.mktemp("animal") / "goat.obj", mesh)


def marked(tmp_path, marks):
    path = tmp_path / "marks.json"
    path.write_text(json.dumps(marks))
    return str(path)


def test_an_animal_of_49_pieces_is_refused_with_a_way_out_and_what_was_found(animal_file):
    with pytest.raises(NotFoundError, match="nobody was found") as caught:
        scan(animal_file, ScanSettings(kind="body"))
    assert "--body-landmarks" in caught.value.next_step
    assert "leave out --body-kind body" in caught.value.next_step
    assert any("49 pieces were united" in note for note in caught.value.found.notes)
    assert len(caught.value.found.landmarks) > 10


def test_an_animal_with_landmarks_becomes_a_body_with_a_face(animal_file, tmp_path):
    settings = ScanSettings(units="m", kind="head", landmarks=marked(tmp_path, MARKS))
    body = scan(animal_file, settings)
    solid = trimesh.Trimesh(body.mesh.vertices, body.mesh.faces, process=False)
    assert solid.is_watertight
    assert solid.body_count == 1
    true = np.array([1000.0 * np.linalg.norm(np.subtract(MARKS["sellion"], MARKS["menton"]))])
    ours = np.linalg.norm(body.landmarks["sellion"] - body.landmarks["menton"])
    assert abs(ours - true) < 20
    assert body.landmarks["sellion"][1] < body.landmarks["tragion_left"][1]  # it looks along -y
    assert body.landmarks["tragion_left"][0] > body.landmarks["tragion_right"][0]
    assert any("its shape is nobody's" in note for note in body.notes)
    assert {"pronasale", "glabella", "eye_left"} <= set(body.landmarks)
    down_the_face = ["glabella", "sellion", "pronasale", "stomion", "menton"]
    heights = [body.landmarks[name][2] for name in down_the_face]
    assert heights == sorted(heights, reverse=True)
    for name in ("forehead", "cheekbone_left", "cheekbone_right", "nose_bridge"):  # what a mask rests on
        patch = body.mesh.vertices[body.regions[name].vertex_indices]
        assert len(patch) > 30
        assert (patch[:, 1] < body.landmarks["tragion_left"][1]).all()  # on the face
        assert (patch[:, 2] > body.landmarks["sellion"][2]).all() == (name == "forehead")


@pytest.mark.parametrize(
    ("name", "text", "message", "step"),
    [
        ("a.json", '{"selion": [0, 0, 0]}', "no landmark called 'selion'", "Did you mean sellion"),
        ("a.json", '{"sellion": [0, 0]}', "three finite numbers", "name, x, y, z"),
        ("a.json", '{"sellion": [0, 0, NaN]}', "three finite numbers", "name, x, y, z"),
        ("a.json", "[1, 2]", "a table of names was expected", "name, x, y, z"),
        ("a.json", "{", "cannot be read as JSON", "name, x, y, z"),
        ("a.toml", "sellion = [0.0, 1.0, 2.0]", "lacks menton, tragion_left, tragion_right", "must name"),
        ("a.csv", "sellion, 0, 0, 0\nsellion, 1, 1, 1", "named twice", "name, x, y, z"),
        ("a.txt", "sellion 0 0 0", "no landmark file", "JSON, TOML, CSV"),
        ("a.csv", "", "names no landmark", "name, x, y, z"),
        (
            "a.csv",
            "sellion, 0, 0, 1\nmenton, 0, 0, 1",
            "sellion and menton at the same place",
            "its own place",
        ),
    ],
)
def test_a_wrong_landmark_file_is_refused(head_file, tmp_path, name, text, message, step):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        scan(head_file, ScanSettings(kind="head", landmarks=str(tmp_path / name)))
    assert step in caught.value.next_step


def test_a_landmark_file_that_is_not_there_is_refused(head_file):
    with pytest.raises(InputError, match="no landmark file"):
        scan(head_file, ScanSettings(landmarks="nowhere.json"))


def test_landmarks_outside_of_the_mesh_are_refused(animal_file, tmp_path):
    off = MARKS | {"menton": (0, 0.9, 1.4)}
    with pytest.raises(InputError, match=r"landmark menton lies .* away from its surface") as caught:
        scan(animal_file, ScanSettings(units="m", kind="head", landmarks=marked(tmp_path, off)))
    assert "own unit and frame" in caught.value.next_step


@pytest.mark.parametrize(
    ("settings", "message", "step"),
    [
        (ScanSettings(units="mm"), "looks like metres", "--body-units m"),
        (ScanSettings(units="ell"), "not a unit", "mm, cm, m, in"),
        (ScanSettings(kind="torso"), "'torso' was asked", "head"),
        (ScanSettings(up="w"), "'w' is not an axis", "x, y, z"),
        (ScanSettings(up="y", front="-y"), "along one line", "square"),
        (ScanSettings(units="m", kind="body"), "a whole body has 600 to 2600 mm", "Crop"),
    ],
)
def test_settings_that_cannot_be_are_refused(head_file, settings, message, step):
    with pytest.raises(InputError, match=message) as caught:
        scan(head_file, settings)
    assert step in caught.value.next_step


@pytest.mark.parametrize("settings", [ScanSettings(kind="foot_left"), ScanSettings(kind="head", up="-y")])
def test_settings_that_do_not_suit_the_scan_are_refused_and_named(head_file, settings):
    with pytest.raises(NotFoundError, match="nobody was found") as caught:
        scan(head_file, settings)
    said = f"--body-kind {settings.kind}" if not settings.up else f"--body-up {settings.up}"
    assert said in caught.value.next_step
