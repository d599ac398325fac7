"""Pictures: what is where, which colour it has, and that equal input gives equal bytes."""

import io

import numpy as np
import pytest
import trimesh
from PIL import Image

from fabcraft.mesh import Mesh
from fabcraft.write.camera import VIEWS, View, camera_for
from fabcraft.write.colours import distance_colours, rounded_up, thickness_colours, to_linear, to_srgb
from fabcraft.write.maps import evolution_strip, penetration_map, thickness_map
from fabcraft.write.normals import corner_normals, split_at_creases
from fabcraft.write.picture import Item, png_bytes, scene_picture
from fabcraft.write.sheet import contact_sheet, labelled

RED, BLUE = (0.85, 0.1, 0.1), (0.1, 0.2, 0.85)


def made(shape: trimesh.Trimesh, at: tuple[float, float, float] = (0, 0, 0)) -> Mesh:
    return Mesh(np.array(shape.vertices) + at, np.array(shape.faces, dtype=np.int32))


def ball(at: tuple[float, float, float] = (0, 0, 0), radius: float = 10.0) -> Mesh:
    return made(trimesh.creation.icosphere(3, radius), at)


def box(*sides: float) -> Mesh:
    return made(trimesh.creation.box(sides))


def reddish(image: np.ndarray) -> np.ndarray:
    return (image[..., 0].astype(int) - image[..., 2]) > 25


def bluish(image: np.ndarray) -> np.ndarray:
    return (image[..., 2].astype(int) - image[..., 0]) > 25


def centre(mask: np.ndarray) -> np.ndarray:
    return np.argwhere(mask).mean(0)[::-1]


def test_front_view_shows_plus_x_right_and_plus_z_up() -> None:
    items = [Item(ball((-20, 0, 20)), RED), Item(ball((20, 0, -20)), BLUE)]
    picture = scene_picture(items, VIEWS["front"], (160, 160))
    assert (centre(reddish(picture)) < 80).all()
    assert (centre(bluish(picture)) > 80).all()


@pytest.mark.parametrize(
    ("name", "near", "far"),
    [
        ("front", (0, -30, 0), (0, 30, 0)),
        ("back", (0, 30, 0), (0, -30, 0)),
        ("side", (30, 0, 0), (-30, 0, 0)),
        ("top", (0, 0, 30), (0, 0, -30)),
    ],
)
def test_the_nearer_object_hides_the_farther(
    name: str, near: tuple[float, float, float], far: tuple[float, float, float]
) -> None:
    picture = scene_picture([Item(ball(near), RED), Item(ball(far), BLUE)], VIEWS[name], (120, 120))
    assert reddish(picture).sum() > 1000
    assert bluish(picture).sum() < 20


def test_the_covered_area_is_that_of_the_silhouette() -> None:
    view = View(0.0, 0.0, 0.0, 0.1)
    picture = scene_picture([Item(ball(radius=10.0), RED)], view, (200, 200))
    # margin 0.1 leaves a disc of 160 pixels across
    assert reddish(picture).sum() == pytest.approx(np.pi * 80**2, rel=0.03)


def test_the_object_fills_the_picture_but_for_the_margin() -> None:
    for view in VIEWS.values():
        mesh = box(10, 30, 20)
        camera = camera_for(view, mesh.vertices, (300, 200))
        pixels = camera.project(mesh.vertices)[:, :2]
        lower, upper = pixels.min(0), pixels.max(0)
        assert (lower >= [300 * 0.06 - 1e-6, 200 * 0.06 - 1e-6]).all()
        assert (upper <= [300 * 0.94 + 1e-6, 200 * 0.94 + 1e-6]).all()
        assert max((upper - lower) / [300, 200]) == pytest.approx(0.88)


def test_a_ray_through_a_projected_point_meets_the_point() -> None:
    points = np.random.default_rng(0).normal(size=(20, 3)) * 30
    for view in (View(25.0, 40.0), View(25.0, 40.0, 0.0)):
        camera = camera_for(view, points, (300, 200))
        pixels = camera.project(points)
        start, direction = camera.rays(pixels[:, 0], pixels[:, 1])
        assert np.allclose(np.cross(points - start, direction), 0, atol=1e-6 * np.linalg.norm(direction))


def test_equal_input_gives_equal_png_bytes() -> None:
    items = [Item(ball(), RED), Item(ball((12, 0, 0)), BLUE)]
    first, again = (png_bytes(scene_picture(items, size=(96, 96))) for _ in range(2))
    assert first == again
    image = Image.open(io.BytesIO(first))
    assert image.size == (96, 96)
    assert not image.info


def test_a_picture_of_nothing_is_the_backdrop() -> None:
    picture = scene_picture([], size=(40, 30))
    assert picture.shape == (30, 40, 3)
    assert picture.min() > 200


def test_light_comes_from_above_and_shadows_fall() -> None:
    lit = scene_picture([Item(ball(), (0.7, 0.7, 0.7))], VIEWS["front"], (120, 120)).astype(float)
    assert lit[30, 60].mean() > lit[95, 60].mean() + 20
    plate = box(60, 1, 60)
    alone = scene_picture([Item(plate)], VIEWS["front"], (160, 160))
    under = scene_picture(
        [Item(plate), Item(ball((0, -20, 0), 5))], VIEWS["front"], (160, 160), frame_on=plate
    )
    # the key light comes from the upper left, so that the shadow lies to the lower right of the ball
    assert under[110, 110].mean() < alone[110, 110].mean() - 10


def test_an_open_sheet_is_lit_from_both_sides() -> None:
    square = Mesh(
        np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]]),
        np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32),
    )
    front = scene_picture([Item(square, RED)], VIEWS["front"], (60, 60))
    turned = Mesh(square.vertices, square.faces[:, ::-1])
    assert np.abs(front.astype(int) - scene_picture([Item(turned, RED)], VIEWS["front"], (60, 60))).max() <= 1


def test_vertex_colours_are_seen_where_they_are() -> None:
    mesh = ball()
    colours = np.where(mesh.vertices[:, :1] > 0, RED, BLUE)
    picture = scene_picture([Item(mesh, vertex_colours=colours)], VIEWS["front"], (120, 120))
    assert centre(reddish(picture))[0] > 70
    assert centre(bluish(picture))[0] < 50


def test_a_box_keeps_its_edges_and_a_ball_is_smooth() -> None:
    source, faces, normals = split_at_creases(box(1, 2, 3))
    assert len(source) == 24
    assert np.allclose(np.sort(np.abs(normals), 1), [0, 0, 1])
    assert faces.shape == (12, 3)
    mesh = ball()
    source, _, normals = split_at_creases(mesh)
    assert len(source) == len(mesh.vertices)
    assert np.allclose(normals, mesh.vertices[source] / 10.0, atol=0.01)


def test_normals_do_not_depend_on_how_a_flat_face_is_cut() -> None:
    mesh = box(2, 2, 2)
    smooth, groups = corner_normals(mesh, mesh.faces.astype(np.int64))
    assert groups.shape == (12, 3)
    assert np.allclose(smooth, mesh.vertices / np.sqrt(3))


def test_colours_of_the_maps_are_those_of_the_paper() -> None:
    red, white, blue = distance_colours(np.array([-1.0, 0.0, 1.0]), 1.0)
    assert red[0] > red[2] + 0.3
    assert white.min() > 0.9
    assert blue[2] > blue[0] + 0.3
    assert np.array_equal(distance_colours(np.array([-9.0, 9.0]), 1.0), [red, blue])
    assert np.allclose(thickness_colours(np.array([np.nan]), 0.0, 1.0), 0.6)
    values = np.linspace(0, 1, 11)[:, None].repeat(3, 1)
    assert np.allclose(to_srgb(to_linear(values)), values)


@pytest.mark.parametrize(
    ("value", "end"), [(0.0, 0.1), (0.1, 0.1), (0.13, 0.2), (0.9, 1.0), (2.0, 2.0), (7.0, 10.0)]
)
def test_a_scale_ends_at_a_round_number(value: float, end: float) -> None:
    assert rounded_up(value) == pytest.approx(end)


def test_a_penetration_map_is_blue_outside_and_red_inside_with_a_bar() -> None:
    mesh = ball()
    picture = penetration_map(mesh, mesh.vertices[:, 2], VIEWS["front"], (200, 200), limit_mm=5.0)
    assert picture.shape[0] == 200
    assert picture.shape[1] > 200
    ball_part, bar = picture[:, :200], picture[:, 200:]
    for part in (ball_part, bar):
        assert centre(bluish(part))[1] < 90
        assert centre(reddish(part))[1] > 110


def test_a_thickness_map_is_red_where_thin() -> None:
    mesh = ball()
    wall = np.where(mesh.vertices[:, 0] > 0, 0.1, 3.0)
    picture = thickness_map(mesh, wall, 1.2, VIEWS["front"], (160, 160))[:, :160]
    assert centre(reddish(picture))[0] > 85


def test_labels_and_sheets_have_room_for_everything() -> None:
    pictures = [np.full((40, 60, 3), shade, np.uint8) for shade in (10, 120, 240)]
    assert labelled(pictures[0], "front").shape == (60, 60, 3)
    sheet = contact_sheet(pictures, ["a", "b" * 200, "ü <>"], columns=3, gap=4)
    assert sheet.shape == (4 + 60 + 4, 4 + 3 * 64, 3)
    assert (sheet[4:44, 4:64] == 10).all()
    assert (sheet[4:44, 132:192] == 240).all()
    assert contact_sheet([]).shape == (1, 1, 3)


def test_an_evolution_strip_shows_every_step_in_the_same_frame() -> None:
    strip = evolution_strip([ball(radius=4.0), ball(radius=10.0)], ["0", "50"], size=(100, 100))
    assert strip.shape[1] == 6 + 2 * 106
    small, large = bluish(strip[6:106, 6:106]), bluish(strip[6:106, 112:212])
    assert 4 * small.sum() < large.sum()
