"""The baked people: closed skins, landmarks where anatomy has them, measures of the published tables."""

import numpy as np
import pytest
import trimesh

from fabcraft.body.human import PRESETS, human
from fabcraft.body.measures import measured
from fabcraft.body.parts import PARTS
from fabcraft.body.region import RULES
from fabcraft.errors import InputError

PUBLISHED = {
    "man": {
        "height": 1756,
        "head": 574,
        "head_breadth": 154,
        "face_breadth": 143,
        "face_length": 123,
        "pupils": 64.0,
    }
    | {
        "neck": 398,
        "wrist": 176,
        "hand": 212,
        "hand_length": 193,
        "foot": 271,
        "foot_width": 102,
        "foot_girth": 252,
    },
    "woman": {
        "height": 1629,
        "head": 561,
        "head_breadth": 148,
        "face_breadth": 134,
        "face_length": 113,
        "pupils": 61.7,
    }
    | {
        "neck": 330,
        "wrist": 155,
        "hand": 187,
        "hand_length": 181,
        "foot": 246,
        "foot_width": 93,
        "foot_girth": 228,
    },
    "teenager": {"height": 1623},
    "child": {"height": 1334},
    "toddler": {"height": 864, "head": 477},
}
"""ANSUR II means; CDC and WHO medians."""


@pytest.fixture(scope="module")
def people():
    return {name: human(name) for name in PRESETS}


@pytest.fixture(scope="module")
def heads(people):
    return {name: body.part("head") for name, body in people.items()}


def assert_sphere_like(mesh):
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert solid.is_watertight
    assert solid.is_winding_consistent
    assert solid.euler_number == 2
    assert solid.body_count == 1
    assert mesh.volume_mm3 > 0


@pytest.mark.parametrize("name", PRESETS)
def test_the_skin_is_one_closed_surface_of_genus_zero(people, name):
    mesh = people[name].mesh
    assert (len(mesh.vertices), len(mesh.faces)) == (12_411, 24_818)
    assert_sphere_like(mesh)


@pytest.mark.parametrize("name", PRESETS)
def test_the_head_is_closed_fine_and_cut_level_below_the_neck(heads, people, name):
    head = heads[name]
    assert_sphere_like(head.mesh)
    assert len(head.mesh.faces) <= 40_000
    assert head.mesh.bounds[0, 2] == pytest.approx(people[name].joints["neck_root"][2] - 60)
    face = head.regions["nose_tip"].vertex_indices
    edges = trimesh.Trimesh(head.mesh.vertices, head.mesh.faces, process=False).edges_unique
    near = edges[np.isin(edges, face).any(1)]
    lengths = np.linalg.norm(head.mesh.vertices[near[:, 0]] - head.mesh.vertices[near[:, 1]], axis=1)
    assert lengths.mean() < 3.0


@pytest.mark.parametrize("name", PRESETS)
def test_presets_have_the_published_measures(people, name):
    found = measured(people[name], PUBLISHED[name].keys())
    assert found == pytest.approx(PUBLISHED[name], abs=0.1)


def test_presets_differ_in_more_than_size(people):
    share = {
        name: (lambda got: got["head"] / got["height"])(measured(body, ("head", "height")))
        for name, body in people.items()
    }
    assert sorted(share, key=share.get) == ["man", "teenager", "woman", "child", "toddler"]


@pytest.mark.parametrize("name", PRESETS)
def test_landmarks_stand_where_anatomy_has_them(heads, name):
    at = heads[name].landmarks
    down = ["vertex", "glabella", "sellion", "pronasale", "stomion", "menton"]
    assert (np.diff([at[key][2] for key in down]) < 0).all()
    assert all(abs(at[key][0]) < 0.5 for key in [*down, "opisthocranion"])
    assert at["pronasale"][1] == min(point[1] for point in at.values())  # the nose leads
    assert at["opisthocranion"][1] == max(point[1] for point in at.values())
    for key in ("eye", "ear_tip", "tragion", "zygion", "cheilion", "ear_root_top"):
        left, right = at[f"{key}_left"], at[f"{key}_right"]
        assert left[0] > 12
        assert left == pytest.approx(right * [-1, 1, 1], abs=0.5)


@pytest.mark.parametrize("name", PRESETS)
def test_regions_lie_round_their_landmarks(heads, name):
    head = heads[name]
    elsewhere = {
        key for key in RULES if key.startswith(("wrist", "ring", "sole", "instep", "toes", "collar"))
    }
    assert set(head.regions) >= set(RULES) - elsewhere
    nearby = {"nose_bridge": "sellion", "nose_tip": "pronasale", "lips": "stomion", "eye_left": "eye_left"}
    for region, landmark in nearby.items():
        middle = head.mesh.vertices[head.regions[region].vertex_indices].mean(0)
        assert np.linalg.norm((middle - head.landmarks[landmark])[[0, 2]]) < 12, region
    for side in ("left", "right"):
        lid = head.mesh.vertices[head.regions[f"eye_{side}"].vertex_indices]
        assert np.ptp(lid[:, 0]) > 30  # the whole opening with both corners
    for region in head.regions.values():
        assert len(region.vertex_indices) >= 5, region.name
        side = np.sign(head.mesh.vertices[region.vertex_indices, 0])
        if region.name.endswith(("_left", "_right")):
            assert (side == (1 if region.name.endswith("_left") else -1)).all()


OF_PARTS = {
    "head": ({"vertex", "menton"}, {"crown", "temple_left", "ear_root_right", "nose_flank_left", "nape"}),
    "bust": (
        {"jugular_notch", "cervicale", "collarbone_left", "acromion_right"},
        {"collarbone_left", "collarbone_right", "nape_low", "throat"},
    ),
    "hand_*": (
        {"wrist_back_*", "wrist_palm_*", "ring_finger_tip_*", "middle_finger_tip_*", "thumb_tip_*"}
        | {"little_knuckle_*", "index_knuckle_*"},
        {"wrist_*", "ring_finger_*"},
    ),
    "foot_*": (
        {"heel_*", "toe_tip_*", "ball_medial_*", "ball_lateral_*", "instep_*"},
        {"sole_heel_*", "sole_ball_*", "sole_toes_*", "instep_*", "toes_*"},
    ),
}


@pytest.mark.parametrize("name", PARTS)
def test_a_part_is_closed_and_carries_its_places(people, name):
    kind, _, side = name.partition("_")
    landmarks, regions = (
        {key.replace("*", side) for key in names} for names in OF_PARTS[f"{kind}_*" if side else kind]
    )
    for person in ("woman", "child"):
        part = people[person].part(name)
        assert_sphere_like(part.mesh)
        assert set(part.landmarks) >= landmarks
        assert set(part.regions) >= regions
        if side:  # nothing of another limb
            assert set(part.landmarks) == landmarks
            assert set(part.regions) == regions
        for key, point in part.landmarks.items():
            if key not in ("eye_left", "eye_right"):
                assert np.linalg.norm(part.mesh.vertices - point, axis=1).min() < 1e-6, key
        for region in part.regions.values():
            assert part.mesh.vertices[region.vertex_indices].shape == (len(region.emphasis), 3)
            assert (region.emphasis >= 0.2).all()
            assert (region.emphasis <= 1.0).all()


@pytest.mark.parametrize(("kind", "longest_mm"), [("hand", 3.0), ("foot", 3.0)])
def test_the_skin_of_hands_and_feet_is_fine(people, kind, longest_mm):
    mesh = people["man"].part(f"{kind}_left").mesh
    assert (
        np.median(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).edges_unique_length) < longest_mm
    )
    assert len(mesh.faces) < 40_000


@pytest.mark.parametrize("kind", ["hand", "foot"])
def test_the_right_part_mirrors_the_left(people, kind):
    left, right = (people["woman"].part(f"{kind}_{side}") for side in ("left", "right"))
    assert right.mesh.volume_mm3 == pytest.approx(left.mesh.volume_mm3, rel=1e-4)
    for key, point in left.landmarks.items():
        assert right.landmarks[key.replace("left", "right")] == pytest.approx(point * [-1, 1, 1], abs=0.1)
    for key, region in left.regions.items():
        twin = right.regions[key.replace("left", "right")]
        middle, other = (
            np.average(one.mesh.vertices[r.vertex_indices], axis=0, weights=r.emphasis)
            for one, r in ((left, region), (right, twin))
        )
        assert other == pytest.approx(middle * [-1, 1, 1], abs=0.2), key


def test_the_forearm_is_cut_square_120_mm_above_the_wrist(people):
    body = people["man"]
    hand = body.part("hand_left")
    along = body.joints["wrist_left"] - body.joints["lowerarm_left"]
    along /= np.linalg.norm(along)
    height = (hand.mesh.vertices - body.joints["wrist_left"]) @ along
    assert height.min() == pytest.approx(-120, abs=1e-6)
    assert (height < -120 + 1e-6).sum() > 20  # a flat cap


def test_the_palm_counts_more_than_the_back(people):
    hand = people["man"].part("hand_left")
    back = hand.landmarks["wrist_back_left"] - hand.landmarks["wrist_palm_left"]
    for key in ("wrist_left", "ring_finger_left"):
        region = hand.regions[key]
        up = hand.mesh.vertices[region.vertex_indices] @ back
        assert np.corrcoef(up, region.emphasis)[0, 1] < -0.9


def test_a_person_is_the_same_every_time(people):
    again = human("woman")
    assert again.mesh.vertices.tobytes() == people["woman"].mesh.vertices.tobytes()
    assert again.part("head").mesh.vertices.tobytes() == people["woman"].part("head").mesh.vertices.tobytes()


def test_an_unknown_body_names_the_choices():
    with pytest.raises(InputError, match=r"man, woman, teenager, child, toddler; or give the path"):
        human("giant")
    with pytest.raises(InputError, match="did you mean toddler"):
        human("todler")


def test_an_unknown_part_names_the_choices(people):
    with pytest.raises(InputError, match="Parts: head, bust, hand_left"):
        people["man"].part("tail")


def test_a_body_is_read_only(people):
    body = people["man"]
    with pytest.raises(ValueError, match="read-only"):
        body.landmarks["sellion"][0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        body.regions["lips"].vertex_indices[0] = 1
    with pytest.raises(TypeError):
        body.regions["new"] = body.regions["lips"]  # type: ignore[index]
