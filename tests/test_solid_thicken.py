"""Objects from surfaces, held against volumes, thicknesses and distances that are known."""

import numpy as np
import pytest
import trimesh
from nasty import box
from scipy.spatial import cKDTree

from fabcraft.check.sharp import measure_sharp_edges
from fabcraft.errors import InputError, SolidError
from fabcraft.geometry.crossing import self_intersecting_faces
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.edges import split_edges
from fabcraft.geometry.voxels import samples
from fabcraft.mesh import Mesh
from fabcraft.solid.manifolds import try_manifold
from fabcraft.solid.sheet import SheetSide
from fabcraft.solid.thicken import SolidSettings, solidify

WALL = SolidSettings(wall_mm=2.0)


def mesh_of(shape) -> Mesh:
    return Mesh(np.array(shape.vertices), np.array(shape.faces, dtype=np.int32))


def plate(width=30.0, depth=30.0, step=2.0, keep=None, height=lambda x, y: 0.0 * x) -> Mesh:
    """A sheet z = height(x, y) around the origin, faces up, without the cells where `keep` says no."""
    x, y = np.meshgrid(
        np.linspace(-width / 2, width / 2, int(width / step) + 1),
        np.linspace(-depth / 2, depth / 2, int(depth / step) + 1),
        indexing="ij",
    )
    index = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    faces = np.stack([np.stack([a, b, c], 1), np.stack([a, c, d], 1)], 1).reshape(-1, 3).astype(np.int32)
    mesh = Mesh(np.stack([x.ravel(), y.ravel(), height(x, y).ravel()], 1), faces)
    if keep is None:
        return mesh
    centre = mesh.corners.mean(1)
    return mesh.submesh(keep(centre[:, 0], centre[:, 1]))


def mask_sheet() -> Mesh:
    """A bent sheet with two eye holes."""
    return plate(
        60, 70, 2.0,
        lambda x, y: (np.abs(np.abs(x) - 14) > 7) | (np.abs(y - 8) > 4),
        lambda x, y: 42.0 - (x**2 + y**2) / 90,
    )  # fmt: skip


def share_thick_enough(mesh: Mesh, wall_mm: float) -> float:
    """Share of the surface that a ball of 0.95 wall inside the solid comes near to (0.37 of its diameter)."""
    size = 0.95 * wall_mm
    fine = split_edges(mesh, 0.6)
    points, areas, distance = fine.corners.mean(1), fine.face_areas, SurfaceDistance(fine)
    centres = points - 0.5 * size * fine.face_normals
    centres = centres[distance.signed(centres) <= 0.01 - 0.5 * size]
    return float(areas[cKDTree(centres).query(points)[0] <= 0.87 * size].sum() / areas.sum())


def assert_sound(mesh: Mesh) -> None:
    assert try_manifold(mesh) is not None
    assert len(self_intersecting_faces(mesh)) == 0


def test_a_square_sheet_becomes_a_plate_with_a_round_rim():
    side, t = 30.0, 2.0
    result = solidify(plate(side, side), WALL)
    # Steiner: area t + half a tube along the perimeter + the four quarter balls at the corners.
    wanted = side**2 * t + 4 * side * np.pi * (t / 2) ** 2 / 2 + 4 / 3 * np.pi * (t / 2) ** 3
    assert result.mesh.volume_mm3 == pytest.approx(wanted, rel=0.01)
    # A cell of 0.67 mm cuts the round rim of radius 1 short by about cell² / 8 on each side.
    assert np.allclose(result.mesh.size_mm, [32, 32, 2], atol=0.15)
    assert result.mesh.size_mm[2] == pytest.approx(2.0, abs=0.01)
    assert result.numbers["parts"] == 1 and result.numbers["genus"] == 0
    assert_sound(result.mesh)


def test_an_open_hemisphere_becomes_a_bowl_and_is_not_filled():
    ball = mesh_of(trimesh.creation.icosphere(4, 15.0))
    bowl = ball.submesh(ball.corners[:, :, 2].mean(1) > 0)
    result = solidify(bowl, WALL)
    shell = 2 / 3 * np.pi * (16**3 - 14**3)
    rim = 2 * np.pi * 15 * np.pi * 1.0**2 / 2
    assert result.mesh.volume_mm3 == pytest.approx(shell + rim, rel=0.03)
    assert share_thick_enough(result.mesh, 2.0) > 0.995


def test_a_thick_cube_passes_through_unchanged():
    cube = mesh_of(trimesh.creation.box([20, 20, 20]))
    result = solidify(cube, WALL)
    assert result.mesh.volume_mm3 == pytest.approx(8000, rel=1e-9)
    assert np.abs(SurfaceDistance(cube).signed(result.mesh.vertices)).max() < 1e-6


def test_a_cube_with_ten_percent_of_its_faces_flipped_is_the_cube():
    shape = trimesh.creation.box([20, 20, 20]).subdivide().subdivide()
    cube = mesh_of(shape)
    faces = np.array(cube.faces)
    faces[::10] = faces[::10, ::-1]
    result = solidify(Mesh(cube.vertices, faces), WALL)
    assert result.mesh.volume_mm3 == pytest.approx(8000, rel=1e-6)
    assert any("turned round" in note for note in result.notes)


def test_an_inside_out_ball_is_turned_and_a_real_cavity_stays():
    outer, inner = trimesh.creation.icosphere(3, 10.0), trimesh.creation.icosphere(3, 5.0)
    inside_out = mesh_of(outer)
    turned = solidify(Mesh(inside_out.vertices, inside_out.faces[:, ::-1]), WALL).mesh
    assert turned.volume_mm3 == pytest.approx(outer.volume, rel=0.01)
    inner.invert()
    hollow = solidify(mesh_of(trimesh.util.concatenate([outer, inner])), WALL)
    assert hollow.mesh.volume_mm3 == pytest.approx(outer.volume + inner.volume, rel=0.01)
    assert hollow.numbers["parts"] == 1


def test_two_interlinked_rings_stay_two_parts():
    one = trimesh.creation.torus(10.0, 2.0, major_sections=48, minor_sections=24)
    two = one.copy()
    two.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    two.apply_translation([10.0, 0, 0])
    result = solidify(mesh_of(trimesh.util.concatenate([one, two])), WALL)
    assert result.numbers["parts"] == 2 and result.numbers["genus"] == 2
    assert result.mesh.volume_mm3 == pytest.approx(2 * one.volume, rel=0.005)


def test_overlapping_solids_become_one_part_without_inner_walls():
    one = trimesh.creation.box([20, 20, 20])
    two = one.copy().apply_translation([10, 3, 2])
    result = solidify(mesh_of(trimesh.util.concatenate([one, two])), WALL)
    assert result.numbers["parts"] == 1
    assert result.mesh.volume_mm3 == pytest.approx(16000 - 10 * 17 * 18, rel=1e-6)
    assert_sound(result.mesh)


def test_a_mask_keeps_its_eye_holes():
    result = solidify(mask_sheet(), WALL)
    assert result.numbers["genus"] == 2 and result.numbers["parts"] == 1
    assert share_thick_enough(result.mesh, 2.0) > 0.995
    assert_sound(result.mesh)


def test_a_small_strap_hole_in_a_sheet_is_not_a_defect():
    sheet = plate(40, 40, 1.0, lambda x, y: np.hypot(x - 10, y) > 2.2)
    assert solidify(sheet, SolidSettings(wall_mm=1.2)).numbers["genus"] == 1


def test_a_pinhole_in_a_closed_ball_is_closed():
    ball = mesh_of(trimesh.creation.icosphere(3, 20.0))
    result = solidify(ball.submesh(np.arange(1, len(ball.faces))), WALL)
    assert result.mesh.volume_mm3 == pytest.approx(ball.volume_mm3, rel=0.01)
    assert any("small holes" in note for note in result.notes)


def test_only_the_thin_part_of_a_solid_grows():
    block = trimesh.creation.box([20, 20, 10])
    rib = trimesh.creation.box([20, 0.8, 10]).apply_translation([0, 0, 8])
    shape = trimesh.boolean.union([block, rib], engine="manifold")
    result = solidify(mesh_of(shape), WALL)
    section = result.mesh.vertices[result.mesh.vertices[:, 2] > 8]
    assert np.ptp(section[:, 1]) == pytest.approx(2.0, abs=0.1)
    low = result.mesh.vertices[result.mesh.vertices[:, 2] < 3]
    assert np.abs(np.abs(low) - [10, 10, 5]).min(1).max() < 0.05
    assert result.numbers["thin_area_mm2"] > 200
    assert share_thick_enough(result.mesh, 2.0) > 0.995
    assert_sound(result.mesh)


def test_a_sharp_wedge_is_rounded_to_the_wall_without_crossings():
    corners = [[0, 0, 0], [30, 0, -3], [30, 0, 3], [0, 20, 0], [30, 20, -3], [30, 20, 3]]
    faces = [[0, 1, 2], [3, 5, 4], [0, 3, 4], [0, 4, 1], [1, 4, 5], [1, 5, 2], [2, 5, 3], [2, 3, 0]]
    result = solidify(Mesh(np.array(corners, float), np.array(faces, np.int32)), SolidSettings(wall_mm=1.2))
    assert share_thick_enough(result.mesh, 1.2) > 0.995
    assert result.mesh.bounds[1][0] == pytest.approx(30, abs=0.01)
    assert result.numbers["simplify_mm"] > 0
    assert_sound(result.mesh)


def test_a_double_wall_with_open_rims_thinner_than_a_cell_gets_its_wall():
    outer, inner = trimesh.creation.icosphere(4, 20.0), trimesh.creation.icosphere(4, 19.7)
    inner.invert()
    double = mesh_of(trimesh.util.concatenate([outer, inner]))
    helmet = double.submesh(double.corners[:, :, 2].mean(1) > -5)
    result = solidify(helmet, WALL)
    assert result.numbers["parts"] == 1 and result.numbers["genus"] == 0
    assert share_thick_enough(result.mesh, 2.0) > 0.995
    points, _ = samples(result.mesh.corners, 0.3)
    top = points[np.linalg.norm(points[:, :2], axis=1) < 1]
    assert np.ptp(top[:, 2]) == pytest.approx(2.0, abs=0.1)
    assert_sound(result.mesh)


def test_the_wall_keeps_its_clearance_and_its_thickness_over_a_head():
    head = mesh_of(trimesh.creation.icosphere(5, 1.0)).transformed(np.diag([45.0, 50.0, 41.5, 1.0]))
    body = SurfaceDistance(head)
    sheet = mask_sheet()
    assert body.signed(sheet.vertices).min() < 1.0
    result = solidify(sheet, SolidSettings(wall_mm=2.0, clearance_mm=0.8), body)
    points, _ = samples(result.mesh.corners, 0.5)
    assert body.signed(points).min() >= 0.8 - 0.02
    assert share_thick_enough(result.mesh, 2.0) > 0.995
    assert result.numbers["genus"] == 2
    assert result.numbers["clearance_slack_mm"] > -0.02
    assert_sound(result.mesh)


def test_the_clearance_may_change_from_place_to_place():
    body = SurfaceDistance(mesh_of(trimesh.creation.box([100, 100, 20])))
    sheet = plate(40, 20, 2.0, height=lambda x, y: 0 * x + 10.5)
    result = solidify(sheet, WALL, body, clearance_mm=lambda points: np.where(points[:, 0] > 0, 2.0, 0.5))
    height = body.signed(samples(result.mesh.corners, 0.5)[0])
    x = samples(result.mesh.corners, 0.5)[0][:, 0]
    assert height[x > 0.6].min() >= 1.98
    assert 0.48 <= height[x < -4].min() < 0.7


def test_a_solid_that_reaches_into_the_body_is_carved():
    body = SurfaceDistance(mesh_of(trimesh.creation.icosphere(5, 30.0)))
    block = mesh_of(trimesh.creation.box([20, 20, 20]).apply_translation([0, 0, 35]))
    result = solidify(block, SolidSettings(wall_mm=2.0, clearance_mm=0.5), body)
    assert body.signed(samples(result.mesh.corners, 0.5)[0]).min() >= 0.48
    assert result.mesh.bounds[1][2] == pytest.approx(45, abs=0.01)
    assert any("carved" in note for note in result.notes)
    assert_sound(result.mesh)


def test_an_object_inside_the_body_is_refused():
    body = SurfaceDistance(mesh_of(trimesh.creation.icosphere(4, 30.0)))
    with pytest.raises(SolidError, match="nothing"):
        solidify(mesh_of(trimesh.creation.box([5, 5, 5])), WALL, body)


def test_a_ridge_on_the_outer_side_stands_at_its_height():
    side = SheetSide(outer_mm=lambda points: np.where(np.abs(points[:, 0]) < 1.5, 1.5, 0.0))
    result = solidify(plate(), WALL, side=side)
    points, _ = samples(result.mesh.corners, 0.3)
    ridge = points[np.abs(points[:, 0]) < 0.8]
    assert ridge[:, 2].max() == pytest.approx(1.0 + 1.5, abs=0.05)
    assert ridge[:, 2].min() == pytest.approx(-1.0, abs=0.02)
    flat = points[np.abs(points[:, 0]) > 2.5]
    assert np.abs(flat[:, 2]).max() < 1.02
    assert_sound(result.mesh)


def test_a_tall_cone_on_the_inner_side_is_followed_to_its_tip():
    side = SheetSide(inner_mm=lambda points: np.maximum(0, 12 - 2 * np.hypot(points[:, 0], points[:, 1])))
    result = solidify(plate(), SolidSettings(wall_mm=2.0, cell_mm=0.4), side=side)
    assert -13.0 <= result.mesh.bounds[0][2] <= -12.2
    assert result.mesh.bounds[1][2] == pytest.approx(1.0, abs=0.02)
    assert result.numbers["parts"] == 1
    assert_sound(result.mesh)


def test_what_is_added_up_to_the_body_gets_a_round_edge_there():
    floor = trimesh.creation.box(
        [60, 60, 4], transform=trimesh.transformations.translation_matrix([0, 0, -7])
    )
    body, settings = SurfaceDistance(mesh_of(floor)), SolidSettings(wall_mm=2.0, cell_mm=0.4)

    def pad(points):
        return np.clip(26.0 - 4.0 * np.hypot(points[:, 0], points[:, 1]), 0.0, 6.0)

    made = [
        solidify(plate(), settings, body, SheetSide(inner_mm=pad, inner_edge_mm=edge)) for edge in (0.0, 1.5)
    ]
    square, rounded = (measure_sharp_edges(one.mesh, body).length_mm for one in made)
    assert square > 15.0 and rounded < 3.0
    low = [one.mesh.bounds[0][2] for one in made]
    assert low == pytest.approx([-4.5, -4.5], abs=0.1)  # it still reaches as far


def test_heights_are_asked_at_the_place_where_the_sheet_was_given():
    asked = []

    def outer(points):
        asked.append(points)
        return np.zeros(len(points))

    body = SurfaceDistance(mesh_of(trimesh.creation.box([60, 60, 4])))
    solidify(plate(), WALL, body, SheetSide(outer_mm=outer))
    assert np.abs(np.concatenate(asked)[:, 2]).max() < 1e-9


def test_heights_out_of_range_are_refused():
    for height in (80.0, -1.0, np.nan):
        side = SheetSide(outer_mm=lambda points, h=height: np.full(len(points), h))
        with pytest.raises(InputError, match="heights"):
            solidify(plate(), WALL, side=side)


def test_settings_that_cannot_work_are_refused():
    for wrong in ({"wall_mm": 0.0}, {"wall_mm": 2.0, "cell_mm": 1.5}, {"clearance_mm": -1.0}):
        with pytest.raises(InputError):
            SolidSettings(**wrong)


def test_a_wall_too_fine_for_the_size_is_refused_with_one_that_works():
    huge = plate(3000, 3000, 500.0, height=lambda x, y: (x + y) / 4)
    with pytest.raises(SolidError, match="too fine") as caught:
        solidify(huge, SolidSettings(wall_mm=0.4))
    assert "mm or more" in caught.value.next_step


def test_the_same_surface_gives_the_same_bytes():
    first, second = solidify(mask_sheet(), WALL).mesh, solidify(mask_sheet(), WALL).mesh
    assert first.vertices.tobytes() == second.vertices.tobytes()
    assert first.faces.tobytes() == second.faces.tobytes()


def test_a_wall_that_is_inside_out_in_places_is_no_less_material():
    plate = split_edges(box(40.0, 40.0, 2.0), 2.0)
    top = (plate.vertices[:, 2] > 0.5) & (np.linalg.norm(plate.vertices[:, :2], axis=1) < 10.0)
    crossed = plate.with_vertices(plate.vertices - np.outer(4.0 * top, [0.0, 0.0, 1.0]))
    made = solidify(crossed, SolidSettings(wall_mm=1.2)).mesh
    asked = np.array([[0.0, 0.0, -2.0], [15.0, 15.0, 0.0], [0.0, 0.0, 0.5]])
    assert SurfaceDistance(made).inside(asked).tolist() == [True, True, False]
    assert len(self_intersecting_faces(made)) == 0


def test_cells_grow_with_the_surface_and_never_past_what_fits_in_memory():
    settings = SolidSettings(wall_mm=1.2)
    small, large = np.array([[0.0] * 3, [50.0] * 3]), np.array([[0.0] * 3, [250.0] * 3])
    assert settings.cell_for(small, 1_000.0) == pytest.approx(0.4)
    assert settings.cell_for(small, 50_000.0) == pytest.approx(0.5)
    assert settings.cell_for(small, 1e6) == pytest.approx(0.6)
    assert settings.finer(0.4, small) == pytest.approx(0.2)
    assert 0.2 < settings.finer(0.6, large) <= 0.6
    assert (250.0 + 4.8) ** 3 / settings.finer(0.6, large) ** 3 <= 120e6 * 1.001
