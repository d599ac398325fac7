"""A mesh of one's own as a template: placed by transform, landmarks or likeness, and refused with a reason."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from worn import limb

from fabcraft.body.body import Body
from fabcraft.body.contacts import Contact, with_contacts
from fabcraft.body.region import Region
from fabcraft.cli.make import Flags, recipe_from
from fabcraft.cli.own import OwnFlags
from fabcraft.errors import InputError
from fabcraft.geometry.align import fit_similarity
from fabcraft.mesh import Mesh
from fabcraft.read.mesh_file import read_mesh
from fabcraft.recipe import Recipe, read_recipe, recipe_toml
from fabcraft.road.base import built
from fabcraft.solid.slots import with_straps
from fabcraft.template.catalogue import Kind
from fabcraft.template.own import OwnSettings
from fabcraft.template.template import MotifFrame, StrapHole, Template

MARKS = {
    "wrist": np.array([0.0, -8.0, -20.0]),
    "knuckle": np.array([8.0, 0.0, 10.0]),
    "tip": np.array([0.0, 0.0, 30.0]),
    "pad": np.array([0.0, 8.0, 15.0]),
}
MOVE = np.eye(4)
MOVE[:3, :3] = Rotation.from_euler("xyz", [70, 20, -130], degrees=True).as_matrix()
MOVE[:3, 3] = [300, -200, 900]


@pytest.fixture(autouse=True)
def coarse_walls(monkeypatch):
    """The walls here are 3 mm: there is no need to look for finer ones."""
    monkeypatch.setattr("fabcraft.road.base._WALL_MM", 2.5)
    monkeypatch.setattr("fabcraft.road.base._WALL_LIMIT_MM", 4.0)


@cache
def finger():
    mesh = limb(8.0, 8.0)
    around = np.flatnonzero(np.abs(mesh.vertices[:, 2]) < 40.0)
    return Body("finger", mesh, MARKS, {"skin": Region("skin", around, 1.0, 1.0, 0.0)}, "human")


@cache
def signet():
    """A ring on the finger with a plate in front of it, a little to one side."""
    turn = trimesh.creation.torus(10.5, 1.8, major_sections=48, minor_sections=16)
    plate = trimesh.creation.box([9.0, 3.0, 7.0])
    plate.apply_translation([2.0, -12.0, 0.5])
    shape = trimesh.boolean.union([turn, plate])
    return Mesh(np.array(shape.vertices), np.array(shape.faces, dtype=np.int32), "ring")


def build(body, settings):
    shape = trimesh.Trimesh(signet().vertices, signet().faces).subdivide_to_size(1.5)
    mesh = Mesh(np.array(shape.vertices), np.array(shape.faces, dtype=np.int32), "ring")
    frame = MotifFrame("bezel", np.array([2.0, -15.0, 0.5]), np.eye(3)[0], np.eye(3)[2], (8.0, 6.0), 2.0)
    return Template(
        "ring",
        body,
        mesh,
        (),
        None,
        1.8,
        1,
        ("skin",),
        0.6,
        (0.0, 0.0, 1.0),
        motifs=(frame,),
        listed_mm=(0.2, 0.7),
    )


@pytest.fixture
def known_ring(monkeypatch):
    monkeypatch.setattr("fabcraft.road.base.kind_of", lambda name: Kind("ring", build, ()))


def saved(path, mesh, matrix=None):
    moved = mesh if matrix is None else mesh.transformed(matrix)
    trimesh.Trimesh(moved.vertices, moved.faces, process=False).export(path)
    return str(path)


def off(template, path, matrix):
    """(largest distance, mm, turn, deg) of a template from where its file's mesh came from."""
    source = read_mesh(path).vertices
    wanted = (source - matrix[:3, 3]) @ np.linalg.inv(matrix[:3, :3]).T
    turn = fit_similarity(wanted, template.mesh.vertices, (1.0, 1.0)).rotation
    angle = np.degrees(np.linalg.norm(Rotation.from_matrix(turn).as_rotvec()))
    return float(np.linalg.norm(template.mesh.vertices - wanted, axis=1).max()), float(angle)


def marks(matrix, **changed):
    moved = {name: (matrix[:3, :3] @ point + matrix[:3, 3]).tolist() for name, point in MARKS.items()}
    return json.dumps(moved | changed)


def test_a_mesh_in_the_bodys_space_stays_there_and_is_measured(tmp_path):
    path = saved(tmp_path / "a.stl", signet())
    made = built(path, finger(), {}, OwnSettings(donning="up", facing="front"))
    assert off(made, path, np.eye(4)) == pytest.approx((0.0, 0.0), abs=1e-4)
    assert made.name == "object" and made.genus == 1 and made.contacts == () and made.kind == "solid"
    assert made.wall_mm == pytest.approx(3.0, abs=0.4)
    assert made.donning == (0.0, 0.0, 1.0) and made.path is None
    middles = made.mesh.corners.mean(1)
    radius = np.hypot(middles[:, 0], middles[:, 1])
    behind = middles[:, 1] > 0.0  # where the plate is not
    assert made.locked[radius < 9.0].all() and radius[made.locked & behind].max() < 10.6


def test_the_place_for_a_motif_is_the_largest_patch_that_faces_the_way_asked(tmp_path):
    path = saved(tmp_path / "a.stl", signet())
    (frame,) = built(path, finger(), {}, OwnSettings(facing="front")).motifs
    np.testing.assert_allclose(frame.origin, [2.0, -13.5, 0.5], atol=0.4)
    np.testing.assert_allclose(frame.outward, [0.0, -1.0, 0.0], atol=0.05)
    np.testing.assert_allclose(frame.up, [0.0, 0.0, 1.0], atol=0.05)
    assert frame.name == "front" and frame.size_mm == pytest.approx((9.0, 7.0), abs=1.0)


def test_contacts_are_what_the_wearers_file_asks(tmp_path):
    path = saved(tmp_path / "a.stl", signet())
    body = with_contacts(finger(), [Contact(region="skin")])
    assert built(path, body, {}).contacts == ("skin",)


def test_a_transform_and_landmarks_bring_it_back_to_the_body(tmp_path):
    path = saved(tmp_path / "a.stl", signet(), MOVE)
    (tmp_path / "t.json").write_text(json.dumps(np.linalg.inv(MOVE).tolist()))
    (tmp_path / "m.json").write_text(marks(MOVE))
    for settings in ({"transform": str(tmp_path / "t.json")}, {"landmarks": str(tmp_path / "m.json")}):
        distance, angle = off(built(path, finger(), {}, OwnSettings(**settings)), path, MOVE)
        assert distance < 0.01 and angle < 0.01


def test_a_scale_is_found_where_it_is_allowed_and_refused_where_it_is_not(tmp_path):
    grown = MOVE.copy()
    grown[:3, :3] *= 3.0
    path = saved(tmp_path / "a.stl", signet(), grown)
    (tmp_path / "m.json").write_text(marks(grown))
    with pytest.raises(InputError, match=r"miss those of the body by .* mm") as refused:
        built(path, finger(), {}, OwnSettings(landmarks=str(tmp_path / "m.json")))
    assert "--template-scale" in refused.value.next_step
    made = built(path, finger(), {}, OwnSettings(landmarks=str(tmp_path / "m.json"), scale=True))
    assert off(made, path, grown)[0] < 0.01 and made.wall_mm == pytest.approx(3.0, abs=0.4)


def test_it_is_found_again_by_its_likeness_to_a_built_in_template(tmp_path, known_ring):
    path = saved(tmp_path / "a.stl", signet(), MOVE)
    made = built(path, finger(), {}, OwnSettings(like="ring"))
    distance, angle = off(made, path, MOVE)
    assert distance < 0.5 and angle < 1.0
    assert made.name == "ring" and made.contacts == ("skin",) and made.listed_mm == (0.2, 0.7)
    (frame,) = made.motifs  # the built-in one's, on the plate of the own mesh
    np.testing.assert_allclose(frame.origin, [2.0, -13.5, 0.5], atol=0.3)


def test_the_strap_slots_of_its_like_go_where_it_has_a_wall(tmp_path, monkeypatch):
    def banded(body, settings):
        hole = StrapHole(np.array([0.0, -12.0, 0.0]), np.eye(3)[2], -np.eye(3)[1], 4.0, 1.5, 8.0)
        return replace(build(body, settings), straps=(hole,))

    monkeypatch.setattr("fabcraft.road.base.kind_of", lambda name: Kind("ring", banded, ()))
    (tmp_path / "here.toml").write_text(f"transform = {np.eye(4).tolist()}")
    told = OwnSettings(like="ring", transform=str(tmp_path / "here.toml"))
    bore = trimesh.creation.cylinder(9.0, 40.0)
    for radius, held in ((10.5, 1), (20.5, 0)):  # a wall, and one that a slot does not go through
        band = trimesh.boolean.difference([trimesh.creation.cylinder(radius, 10.0), bore])
        path = saved(tmp_path / f"{held}.stl", Mesh(np.array(band.vertices), band.faces.astype(np.int32)))
        made = built(path, finger(), {}, told)
        assert len(made.straps) == held
        assert any("no strap slots" in note for note in made.notes) == (not made.straps)
        if made.straps:
            assert made.straps[0].centre[1] == pytest.approx(-0.5 * (9.0 + radius), abs=0.1)
            cut = with_straps(made.mesh, made.straps)
            assert cut.volume_mm3 < made.mesh.volume_mm3 - 5.0


def test_a_mesh_unlike_the_built_in_template_is_refused(tmp_path, known_ring):
    rod = trimesh.creation.box([3.0, 3.0, 200.0])
    rod.export(tmp_path / "rod.stl")
    with pytest.raises(InputError, match="the template resembles the ring too little"):
        built(str(tmp_path / "rod.stl"), finger(), {}, OwnSettings(like="ring"))


def test_spheres_lock_what_they_hold_in_the_meshs_own_frame(tmp_path):
    path = saved(tmp_path / "a.stl", signet(), MOVE)
    (tmp_path / "t.json").write_text(json.dumps({"transform": np.linalg.inv(MOVE).tolist()}))
    middle = (MOVE[:3, :3] @ [2.0, -13.5, 0.5] + MOVE[:3, 3]).tolist()
    (tmp_path / "l.toml").write_text(f"inside_mm = 0\n[[sphere]]\npoint = {middle}\nradius_mm = 6\n")
    settings = OwnSettings(transform=str(tmp_path / "t.json"), locked=str(tmp_path / "l.toml"))
    made = built(path, finger(), {}, settings)
    away = np.linalg.norm(made.mesh.corners.mean(1) - [2.0, -13.5, 0.5], axis=1)
    np.testing.assert_array_equal(made.locked, away <= 6.0)
    assert made.locked.any()


def test_a_mesh_with_a_hole_and_an_inside_out_one_are_made_sound(tmp_path):
    mesh = signet()
    torn = Mesh(mesh.vertices, mesh.faces[1:], "a")
    turned = Mesh(mesh.vertices, mesh.faces[:, ::-1].copy(), "a")
    for number, broken in enumerate((torn, turned)):
        made = built(saved(tmp_path / f"{number}.stl", broken), finger(), {})
        assert made.mesh.volume_mm3 == pytest.approx(mesh.volume_mm3, rel=0.03) and made.genus == 1
        assert "repaired" in made.notes[0]


@pytest.mark.parametrize(
    "text, said",
    [
        ("[[1, 0], [0, 1]]", "no 4 x 4 matrix"),
        ('{"transform": "turn"}', "no 4 x 4 matrix"),
        ("[[1,0,0,0],[0,1,0,0],[0,0,-1,0],[0,0,0,1]]", "mirrors"),
        ("[[1,1,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]", "shears"),
        ("[[1", "not valid JSON"),
    ],
)
def test_a_wrong_transform_is_refused(tmp_path, text, said):
    (tmp_path / "t.json").write_text(text)
    with pytest.raises(InputError, match=said):
        built(
            saved(tmp_path / "a.stl", signet()), finger(), {}, OwnSettings(transform=str(tmp_path / "t.json"))
        )


@pytest.mark.parametrize(
    "text, said",
    [
        ('{"wrist": [0, 0, 0], "tip": [0, 0, 50]}', "names 2 landmarks"),
        ('{"wrist": [0, 0, 0], "tip": [0, 0, 50], "pad": [0, 0, 20]}', "on one line"),
        ('{"wirst": [0, 0, 0]}', "no landmark called 'wirst'"),
        ('{"wrist": [0, 0, "x"]}', "three finite numbers"),
    ],
)
def test_wrong_landmarks_are_refused(tmp_path, text, said):
    (tmp_path / "m.json").write_text(text)
    with pytest.raises(InputError, match=said):
        built(
            saved(tmp_path / "a.stl", signet()), finger(), {}, OwnSettings(landmarks=str(tmp_path / "m.json"))
        )


@pytest.mark.parametrize(
    "text, said",
    [
        ("spheres = []", "something else"),
        ("inside_mm = -1", "inside_mm is -1"),
        ("[[sphere]]\npoint = [1, 2]\nradius_mm = 3", "sphere 1 is not a point"),
        ("[[sphere]]\npoint = [1, 2, nan]\nradius_mm = 3", "sphere 1: point is nan"),
        ("[[sphere]]\npoint = [1, 2, 3]\nradius_mm = 0", "radius_mm is 0"),
    ],
)
def test_a_wrong_file_of_locked_faces_is_refused(tmp_path, text, said):
    (tmp_path / "l.toml").write_text(text)
    with pytest.raises(InputError, match=said):
        built(saved(tmp_path / "a.stl", signet()), finger(), {}, OwnSettings(locked=str(tmp_path / "l.toml")))


def test_a_mesh_in_the_wrong_place_of_the_wrong_size_or_in_pieces_is_refused(tmp_path):
    far = np.eye(4)
    far[:3, 3] = [0.0, -500.0, 0.0]
    with pytest.raises(InputError, match=r"48\d mm away from the finger"):
        built(saved(tmp_path / "far.stl", signet(), far), finger(), {})
    with pytest.raises(InputError, match=r"mm long|100% of its vertices inside"):
        built(saved(tmp_path / "tiny.stl", signet(), np.diag([0.05, 0.05, 0.05, 1.0])), finger(), {})
    shifted = signet().vertices + [0.0, 0.0, 10.0]
    two = Mesh(
        np.concatenate([signet().vertices, shifted]),
        np.concatenate([signet().faces, signet().faces + np.int32(len(shifted))]),
    )
    with pytest.raises(InputError, match=r"two.stl has 2 separate parts"):
        built(saved(tmp_path / "two.stl", two), finger(), {})


def test_what_is_said_of_own_templates_is_checked():
    for wrong, said in (
        ({"like": "rnig"}, "did you mean ring"),
        ({"donning": "sideways"}, "no direction"),
        ({"facing": "0,0,0"}, "no direction"),
        ({"units": "km"}, "units 'km'"),
        ({"transform": "a.json", "landmarks": "b.json"}, "both a transform and landmarks"),
    ):
        with pytest.raises(InputError, match=said):
            OwnSettings(**wrong)
    with pytest.raises(InputError, match="like was given for the ring, which is a built-in"):
        Recipe(template="ring", own=OwnSettings(like="ring"))
    with pytest.raises(InputError, match="no parameters"):
        built("a.stl", finger(), {"width": 5.0})


def test_flags_and_a_recipe_say_the_same_with_files_beside_the_recipe(tmp_path):
    for name in ("mine.stl", "m.json"):
        (tmp_path / name).write_text("x")
    (tmp_path / "r.toml").write_text('template = "mine.stl"\n[own]\nlike = "visor"\nlandmarks = "m.json"\n')
    recipe = read_recipe(tmp_path / "r.toml")
    assert recipe.template == str(tmp_path / "mine.stl")
    assert recipe.own == OwnSettings(like="visor", landmarks=str(tmp_path / "m.json"))
    flags = OwnFlags(like="visor", template_landmarks=str(tmp_path / "m.json"))
    assert recipe_from(recipe.template, Flags(), flags).own == recipe.own
    assert recipe_from(str(tmp_path / "r.toml"), Flags(), OwnFlags(like="helmet")).own.like == "helmet"
    assert str(tmp_path) not in recipe_toml(recipe)
    assert 'landmarks = "m.json"' in recipe_toml(recipe)
