"""What files really hold: unwelded, repeated, flipped, torn, soup."""

import numpy as np
import pytest
import trimesh

from fabcraft.errors import SolidError
from fabcraft.geometry.edges import components, edge_uses, split_edges
from fabcraft.mesh import Mesh
from fabcraft.solid.manifolds import try_manifold
from fabcraft.solid.patches import Kind, pieces
from fabcraft.solid.repair import clean, fill_defects, open_share, repair, wrap
from fabcraft.solid.thicken import SolidSettings, solidify


def mesh_of(shape) -> Mesh:
    return Mesh(np.array(shape.vertices), np.array(shape.faces, dtype=np.int32))


BALL = mesh_of(trimesh.creation.icosphere(3, 10.0))


def soup(mesh: Mesh) -> Mesh:
    """Every face with its own three vertices."""
    return Mesh(
        mesh.corners.reshape(-1, 3), np.arange(3 * len(mesh.faces), dtype=np.int32).reshape(-1, 3), "soup"
    )


def test_a_clean_mesh_comes_back_as_it_was():
    result = clean(BALL)
    assert np.array_equal(result.mesh.vertices, BALL.vertices)
    assert np.array_equal(result.mesh.faces, BALL.faces)
    assert result.notes == ()


def test_faces_with_vertices_of_their_own_are_welded():
    result = repair(soup(BALL))
    assert open_share(result.mesh) == 0
    assert len(result.mesh.vertices) == len(BALL.vertices)


def test_repeated_and_degenerate_faces_are_dropped():
    faces = np.concatenate([BALL.faces, BALL.faces[:7], [[0, 0, 5]]]).astype(np.int32)
    result = clean(Mesh(BALL.vertices, faces))
    assert len(result.mesh.faces) == len(BALL.faces)
    assert "8 degenerate or repeated faces dropped" in result.notes


def test_flipped_faces_turn_to_where_the_most_area_looks():
    faces = np.array(BALL.faces)
    faces[::5] = faces[::5, ::-1]
    result = clean(Mesh(BALL.vertices, faces))
    assert result.mesh.volume_mm3 == pytest.approx(BALL.volume_mm3)
    assert f"{len(BALL.faces[::5])} faces turned round" in result.notes


def test_a_sheet_that_looks_down_still_looks_down():
    sheet = BALL.submesh(BALL.corners[:, :, 2].mean(1) > 0)
    down = Mesh(sheet.vertices, sheet.faces[:, ::-1])
    assert np.array_equal(clean(down).mesh.faces, down.faces)


def test_small_holes_of_a_closed_part_are_filled_and_an_opening_is_not():
    torn, holes = fill_defects(BALL.submesh(np.arange(len(BALL.faces)) % 200 != 0))
    assert holes == 7 and open_share(torn) == 0
    bowl = BALL.submesh(BALL.corners[:, :, 2].mean(1) > 0)
    assert fill_defects(bowl)[1] == 0
    assert fill_defects(bowl.submesh(np.arange(len(bowl.faces)) != 5))[1] == 0


def test_scattered_soup_is_wrapped_and_its_clusters_stay_apart():
    rng = np.random.default_rng(3)
    two = mesh_of(
        trimesh.util.concatenate(
            [
                trimesh.creation.icosphere(3, 6.0),
                trimesh.creation.icosphere(3, 6.0).apply_translation([20, 0, 0]),
            ]
        )
    )
    scattered = soup(two)
    scattered = scattered.with_vertices(scattered.vertices + rng.normal(0, 0.08, scattered.vertices.shape))
    result = repair(scattered)
    assert any("wrapped" in note for note in result.notes)
    solid = solidify(scattered, SolidSettings(wall_mm=1.2))
    assert solid.numbers["parts"] == 2
    assert solid.numbers["self_intersections"] == 0
    assert try_manifold(solid.mesh) is not None


def test_a_wrap_is_closed():
    assert try_manifold(wrap(BALL)) is not None


def test_nothing_but_points_is_refused():
    flat = Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32), "flat")
    with pytest.raises(SolidError, match="no face with an area"):
        repair(flat)


def test_a_box_of_six_loose_sides_is_a_solid_when_its_walls_are_near():
    box = trimesh.creation.box([20, 20, 3.0]).subdivide().subdivide()
    box.vertices *= 0.999
    sides = [box.submesh([box.facets[k]], append=True) for k in range(6)]
    # The sides stand a twentieth of a millimetre apart, so that nothing welds.
    for side in sides:
        side.apply_translation(0.08 * side.face_normals[0])
    found = pieces(clean(mesh_of(trimesh.util.concatenate(sides))).mesh, 1.2)
    assert [piece.kind for piece in found] == [Kind.OPEN_SOLID]


def test_an_open_helmet_is_a_sheet_although_it_encloses_most_directions():
    helmet = BALL.submesh(BALL.corners[:, :, 2].mean(1) > -7)
    assert [piece.kind for piece in pieces(helmet, 1.2)] == [Kind.SHEET]


def test_components_are_counted_by_shared_edges():
    two = trimesh.creation.icosphere(1, 1.0), trimesh.creation.icosphere(1, 1.0).apply_translation([5, 0, 0])
    labels = components(mesh_of(trimesh.util.concatenate(two)).faces)
    assert labels.tolist() == [0] * 80 + [1] * 80


def test_every_edge_of_a_closed_mesh_is_used_twice():
    edges, counts = edge_uses(BALL.faces)
    assert (counts == 2).all() and len(counts) == 1.5 * len(BALL.faces) == edges.max() + 1


def test_splitting_edges_keeps_the_surface_closed_and_in_place():
    box = mesh_of(trimesh.creation.box([20, 7, 3]))
    fine = split_edges(box, 1.3)
    ends = fine.vertices[fine.faces]
    assert np.linalg.norm(ends - np.roll(ends, -1, axis=1), axis=2).max() <= 1.3
    assert fine.volume_mm3 == pytest.approx(420) and fine.area_mm2 == pytest.approx(box.area_mm2)
    assert open_share(fine) == 0 and try_manifold(fine) is not None
