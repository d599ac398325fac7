import numpy as np
import pytest
import trimesh
from masked import assert_clean_sheet, template

from fabcraft.body.body import Body
from fabcraft.body.character import character
from fabcraft.body.human import human
from fabcraft.errors import InputError
from fabcraft.geometry.contour import inside, signed_area
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh
from fabcraft.template.mask import ADULT_FACE_MM, WALL_MM, mask, natural_wall_mm, room_around

PEOPLE = ("man", "woman", "child")


def face_scale(placed):
    landmarks = placed.body.landmarks
    return (landmarks["sellion"][2] - landmarks["menton"][2]) / ADULT_FACE_MM


@pytest.mark.parametrize("name", PEOPLE)
def test_the_sheet_is_one_piece_with_two_openings_facing_the_viewer(name):
    placed = template(name)
    assert_clean_sheet(placed.mesh)
    assert placed.genus == 2
    assert len(placed.rims) == 3


@pytest.mark.parametrize("name", PEOPLE)
def test_the_rims_are_the_boundary_in_order(name):
    placed = template(name)
    edges = np.sort(placed.mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    once, count = np.unique(edges, axis=0, return_counts=True)
    boundary = {tuple(edge) for edge in once[count == 1].tolist()}
    along = {
        tuple(sorted(pair))
        for rim in placed.rims
        for pair in zip(rim.tolist(), np.roll(rim, -1).tolist(), strict=True)
    }
    assert along == boundary
    assert signed_area(placed.outline) > 0
    right, left = placed.openings
    assert right[:, 0].mean() < left[:, 0].mean()
    assert inside(np.vstack([right, left]), [placed.outline]).all()


@pytest.mark.parametrize("name", PEOPLE)
def test_the_template_is_nowhere_below_its_floor(name):
    front = template(name).front
    assert (front.base >= front.floor - 1e-9).all()
    assert front.core.any()
    assert np.isfinite(front.base).all()


@pytest.mark.parametrize("name", PEOPLE)
def test_every_vertex_keeps_its_clearance_to_the_skin(name):
    placed = template(name)
    points = placed.mesh.vertices
    away = SurfaceDistance(placed.body.mesh).signed(points)
    wanted = placed.front.at(placed.front.clearance, points[:, [0, 2]]) + 0.5 * placed.wall_mm
    assert (away - wanted).min() > -0.1


@pytest.mark.parametrize("name", PEOPLE)
def test_the_openings_are_centred_on_the_eyes(name):
    placed = template(name)
    for opening, eye in zip(placed.openings, ("eye_right", "eye_left"), strict=True):
        lower, upper = opening.min(0), opening.max(0)
        assert 0.5 * (lower + upper) == pytest.approx(placed.body.landmarks[eye][[0, 2]], abs=0.3)
        assert upper - lower == pytest.approx(np.array([36.0, 24.0]) * face_scale(placed), rel=0.03)


@pytest.mark.parametrize("name", PEOPLE)
def test_the_outline_reaches_from_above_the_brows_to_under_the_chin(name):
    placed = template(name)
    landmarks, scale = placed.body.landmarks, face_scale(placed)
    assert placed.outline[:, 1].max() == pytest.approx(landmarks["glabella"][2] + 30.0 * scale, abs=0.5)
    assert placed.outline[:, 1].min() == pytest.approx(landmarks["menton"][2] - 5.0 * scale, abs=0.5)


@pytest.mark.parametrize("name", PEOPLE)
def test_edges_are_about_as_long_as_asked(name):
    placed = template(name)
    flat = placed.mesh.vertices[:, [0, 2]]
    edges = np.unique(np.sort(placed.mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    lengths = np.linalg.norm(flat[edges[:, 0]] - flat[edges[:, 1]], axis=1)
    assert np.median(lengths) == pytest.approx(placed.edge_mm, rel=0.15)
    assert lengths.max() < 2.0 * placed.edge_mm


def test_it_rests_where_it_should():
    placed = template("man")
    front = placed.front
    gap = (front.base - front.floor)[front.core & (front.contact > 0.5)]
    assert np.median(gap) < 2.5
    assert gap.min() >= 0.0


def test_a_thicker_wall_stands_further_off():
    placed = mask(human("man"), 4.0)
    thin = template("man")
    core = placed.front.core & thin.front.core
    assert np.median((placed.front.base - thin.front.base)[core]) == pytest.approx(0.8, abs=0.3)


def test_a_child_gets_a_smaller_mask():
    child, man = template("child").mesh, template("man").mesh
    assert child.size_mm[0] < man.size_mm[0]
    assert child.size_mm[2] < man.size_mm[2]


@pytest.mark.parametrize("wall_mm", [1.5, 5.1, -1.0, float("nan")])
def test_a_wall_out_of_range_is_refused(wall_mm):
    with pytest.raises(InputError, match="wall"):
        mask(human("man"), wall_mm)


def test_a_body_without_a_face_is_refused():
    sphere = trimesh.creation.icosphere(2, 80.0)
    body = Body("ball", Mesh(np.array(sphere.vertices), sphere.faces.astype(np.int32)), {}, {}, "character")
    with pytest.raises(InputError, match="landmark"):
        mask(body)


@pytest.mark.parametrize("name", ["frog"])
def test_a_character_gets_a_mask_of_its_own_size_that_its_eyes_look_out_of(name):
    body = character(name)
    placed = mask(body, natural_wall_mm(body))
    head = placed.body
    assert_clean_sheet(placed.mesh)
    assert placed.scale == head.scale < 0.5
    assert WALL_MM[0] <= placed.wall_mm < 2.0
    assert placed.mesh.size_mm[0] < 1.1 * head.mesh.size_mm[0]
    assert placed.resting_mm == 0.4  # a person's 0.3 scaled would be less than printed parts need
    away = SurfaceDistance(head.mesh).signed(placed.mesh.vertices)
    wanted = placed.front.at(placed.front.clearance, placed.mesh.vertices[:, [0, 2]]) + 0.5 * placed.wall_mm
    assert (away - wanted).min() > -0.1 * head.scale
    assert room_around(placed.outline, placed.openings) > 2.3 * placed.wall_mm
    for opening, eye in zip(placed.openings, ("eye_right", "eye_left"), strict=True):
        dome = head.mesh.vertices[head.regions[eye].vertex_indices][:, [0, 2]]
        assert inside(dome, [opening]).all()


def test_a_wall_goes_with_the_size_of_a_characters_head():
    assert natural_wall_mm(human("man")) == 2.4
    assert natural_wall_mm(character("figure", 60.0)) == WALL_MM[0]
    assert natural_wall_mm(character("figure", 2000.0)) == WALL_MM[1]
