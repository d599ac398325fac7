"""The characters: clean meshes, places where they should be, and everything growing with the height."""

from functools import cache

import numpy as np
import pytest
import trimesh

from fabcraft.body.body import LEAST_CLEARANCE_MM
from fabcraft.body.character import CHARACTERS, HEIGHT_MM, character
from fabcraft.body.parts import PARTS
from fabcraft.body.region import RULES
from fabcraft.errors import InputError
from fabcraft.geometry.distance import SurfaceDistance

TEMPLATES = {"mask", "glasses", "helmet", "visor", "necklace", "ring", "bangle", "slippers"}
HEAD = "forehead nose_bridge nose_tip lips chin crown nape cheekbone_left eye_left nose_flank_left ear_root_left temple_left"
LANDMARKS = (
    "vertex glabella sellion pronasale menton opisthocranion jugular_notch cervicale euryon_left zygion_left "
    "ear_root_top_left ear_tip_left ear_outermost_left tragion_left ear_root_back_left ear_root_low_left eye_left "
    "collarbone_left wrist_back_left wrist_palm_left ring_finger_tip_left heel_left toe_tip_left ball_medial_left "
    "ball_lateral_left instep_left"
)
JOINTS = "neck_root head lowerarm_left wrist_left metacarpal4_left finger2_1_left finger5_1_left foot_left toe1_1_left"
MIRROR = np.array([-1.0, 1.0, 1.0])
every = pytest.mark.parametrize("name", CHARACTERS)


@cache
def made(name):
    return character(name)


@cache
def skin(name):
    return SurfaceDistance(made(name).mesh)


@cache
def part(name, which):
    return made(name).part(which)


def other(name):
    return name.replace("_left", "_right")


@every
def test_the_skin_is_one_closed_piece_without_handles_and_even(name):
    mesh = made(name).mesh
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert solid.is_watertight and solid.is_winding_consistent and solid.volume > 0
    assert (solid.body_count, solid.euler_number) == (1, 2)
    angles = np.degrees(solid.face_angles.min(1))
    assert angles.min() > 5.0
    assert np.percentile(angles, 1) > 30.0
    lengths = solid.edges_unique_length
    assert lengths.max() < 3.0 * np.median(lengths)
    assert 15_000 < len(mesh.faces) < 50_000


@every
def test_it_stands_on_the_ground_at_its_height_and_is_its_own_mirror_image(name):
    mesh = made(name).mesh
    assert mesh.bounds[0, 2] == pytest.approx(0.0, abs=0.05)
    assert mesh.size_mm[2] == pytest.approx(CHARACTERS[name].height_mm)
    there = {tuple(point) for point in (mesh.vertices + 0.0).tolist()}
    assert there == {(-x + 0.0, y, z) for x, y, z in there}


@every
def test_every_landmark_is_there_on_the_skin_and_mirrored(name):
    body = made(name)
    for key in LANDMARKS.split():
        assert key in body.landmarks
        if key.endswith("_left"):
            assert body.landmarks[key][0] > 0.0
            assert body.landmarks[other(key)] == pytest.approx(body.landmarks[key] * MIRROR)
    points = np.stack([point for key, point in body.landmarks.items() if not key.startswith("eye")])
    assert skin(name).closest(points).distances.max() < 0.1
    eyes = np.stack([body.landmarks["eye_left"], body.landmarks["eye_right"]])
    assert skin(name).inside(eyes).all()


@every
def test_landmarks_are_where_their_names_say(name):
    at, mesh = made(name).landmarks, made(name).mesh
    heights = [
        at[key][2] for key in ("vertex", "glabella", "sellion", "pronasale", "menton", "jugular_notch")
    ]
    assert heights == sorted(heights, reverse=True)
    assert at["pronasale"][1] < at["opisthocranion"][1] - 40.0
    assert at["euryon_left"][0] > at["eye_left"][0]
    assert at["toe_tip_left"][1] < at["ball_medial_left"][1] < at["heel_left"][1]
    assert at["ball_medial_left"][0] < at["toe_tip_left"][0] < at["ball_lateral_left"][0]
    assert (
        max(at[key][2] for key in ("heel_left", "toe_tip_left", "ball_medial_left")) < 0.15 * mesh.size_mm[2]
    )
    assert at["jugular_notch"][1] < at["cervicale"][1]


@every
def test_every_joint_is_inside(name):
    joints = dict(made(name).joints)
    assert set(JOINTS.split()) <= set(joints)
    toes = {key: joints.pop(key) for key in list(joints) if key.startswith("toe")}
    assert skin(name).inside(np.stack(list(joints.values()))).all()
    assert all(point[2] > 0.0 for point in toes.values())
    assert ("finger4_1_left" in joints) == ("ring" not in made(name).unwearable)


@every
def test_regions_are_there_on_their_side_and_mirrored(name):
    body = made(name)
    expected = set(RULES)
    if CHARACTERS[name].head.ear is None:
        expected -= {"ear_left", "ear_right"}
    if "ring" in body.unwearable:
        expected -= {"ring_finger_left", "ring_finger_right"}
    assert set(body.regions) == expected
    for key, region in body.regions.items():
        points = body.mesh.vertices[region.vertex_indices]
        assert len(points) > 2, key
        if key.endswith("_left"):
            assert (points[:, 0] > 0.0).all(), key
            mirrored = body.mesh.vertices[body.regions[other(key)].vertex_indices]
            assert {tuple(p) for p in (mirrored * MIRROR).tolist()} == {tuple(p) for p in points.tolist()}
    assert (
        body.mesh.vertices[body.regions["sole_heel_left"].vertex_indices, 2].max()
        < 0.05 * body.mesh.size_mm[2]
    )
    eye = body.mesh.vertices[body.regions["eye_left"].vertex_indices].mean(0)
    assert np.linalg.norm(eye - body.landmarks["eye_left"]) < 0.08 * body.mesh.size_mm[2]


@every
def test_its_parts_are_closed_and_hold_what_is_worn_there(name):
    body = made(name)
    held = {"head": HEAD.split(), "bust": ["collarbone_left", "nape_low", "throat", "forehead"]}
    held |= {"hand_left": ["wrist_left"], "hand_right": ["wrist_right"]}
    of_foot = ("sole_heel", "sole_ball", "toes", "instep")
    held |= {f"foot_{side}": [f"{key}_{side}" for key in of_foot] for side in ("left", "right")}
    for which in PARTS:
        piece = part(name, which)
        solid = trimesh.Trimesh(piece.mesh.vertices, piece.mesh.faces, process=False)
        assert solid.is_watertight and (solid.body_count, solid.euler_number) == (1, 2), which
        assert set(held[which]) <= set(piece.regions), which
        assert 0.1 < piece.scale < 1.0
        assert len(piece.mesh.faces) < 0.75 * len(body.mesh.faces)
        for key, region in piece.regions.items():
            whole = body.mesh.vertices[body.regions[key].vertex_indices]
            assert piece.mesh.vertices[region.vertex_indices].mean(0) == pytest.approx(whole.mean(0), abs=0.3)


def test_twice_the_height_is_twice_of_everything_to_the_last_bit():
    small, large = made("figure"), character("figure", 2.0 * CHARACTERS["figure"].height_mm)
    assert (large.mesh.vertices == 2.0 * small.mesh.vertices).all()
    assert (large.mesh.faces == small.mesh.faces).all()
    for key in small.landmarks:
        assert large.landmarks[key] == pytest.approx(2.0 * small.landmarks[key])
    for key in small.joints:
        assert large.joints[key] == pytest.approx(2.0 * small.joints[key])
    for key in small.regions:
        assert (large.regions[key].vertex_indices == small.regions[key].vertex_indices).all()
    assert large.part("head").scale == pytest.approx(2.0 * small.part("head").scale)


def test_distances_of_the_rules_grow_with_the_part_from_a_floor_on():
    for key, region in made("bear").regions.items():
        if RULES[key][2] > 0.0:
            assert region.never_closer_mm >= LEAST_CLEARANCE_MM
        else:
            assert region.never_closer_mm == 0.0  # it does not give
    head = part("bear", "head")
    assert head.regions["ear_left"].never_closer_mm == pytest.approx(5.0 * head.scale)
    assert head.clearance_mm(2.0) == pytest.approx(2.0 * head.scale)
    assert head.clearance_mm(0.3) == LEAST_CLEARANCE_MM


@every
def test_what_it_cannot_wear_has_a_reason(name):
    reasons = made(name).unwearable
    assert set(reasons) <= TEMPLATES - {"mask"}
    assert all(len(reason.split()) > 3 for reason in reasons.values())


def test_an_unknown_character_is_refused():
    with pytest.raises(InputError, match="no character called 'unicorn'"):
        character("unicorn")


@pytest.mark.parametrize("height", [HEIGHT_MM[0] - 1, HEIGHT_MM[1] + 1, -5.0, float("nan"), float("inf")])
def test_a_height_out_of_range_is_refused(height):
    with pytest.raises(InputError, match="height"):
        character("dog", height)
