"""Opening thickness on shapes whose wall is known: the acceptance shapes of the definition."""

import manifold3d
import numpy as np
import pytest
import trimesh

from fabcraft.check.thickness import measure_thickness
from fabcraft.geometry.rays import Rays
from fabcraft.mesh import Mesh, concatenate


def mesh_of(shape) -> Mesh:
    return Mesh(np.array(shape.vertices), np.array(shape.faces).astype(np.int32))


def box(*size: float) -> Mesh:
    return mesh_of(trimesh.creation.box(size))


def solid_mesh(solid) -> Mesh:
    found = solid.to_mesh64()
    return Mesh(np.array(found.vert_properties)[:, :3], np.array(found.tri_verts).astype(np.int32))


def cube(*size: float) -> manifold3d.Manifold:
    return manifold3d.Manifold.cube(size, True)


def test_a_plate_is_as_thick_as_it_is_up_to_its_border():
    found = measure_thickness(box(30, 30, 1.2), 1.2)
    assert found.min_mm == pytest.approx(1.2, rel=0.015)
    assert found.ok_share == 1.0
    assert found.regions == ()
    assert found.ray_min_mm == pytest.approx(1.2, rel=1e-4)


def test_a_plate_under_the_minimum_is_one_region_with_a_free_border():
    found = measure_thickness(box(30, 30, 0.6), 0.9)
    assert found.ok_share == 0.0
    assert found.min_mm == pytest.approx(0.6, rel=0.015)
    (region,) = found.regions
    assert region.free
    assert region.thinnest_mm == pytest.approx(0.6, rel=0.015)
    assert region.area_mm2 == pytest.approx(2 * 900 + 4 * 30 * 0.6, rel=1e-6)


def hollow_sphere(wall: float) -> Mesh:
    inner = trimesh.creation.icosphere(4, 10 - wall)
    inner.invert()
    return concatenate([mesh_of(trimesh.creation.icosphere(4, 10)), mesh_of(inner)])


def test_a_hollow_sphere_has_its_wall_everywhere():
    found = measure_thickness(hollow_sphere(1.0), 1.0)
    assert found.min_mm == pytest.approx(1.0, rel=0.01)
    assert found.ok_share == 1.0


def test_a_thin_hollow_sphere_is_thin_everywhere_but_has_no_free_border():
    found = measure_thickness(hollow_sphere(0.7), 0.9, 0.8)
    assert found.ok_share == 0.0
    assert len(found.regions) == 2
    assert not any(region.free for region in found.regions)
    assert measure_thickness(hollow_sphere(0.7), 0.9, 0.6).ok_share == 1.0


def test_facets_of_a_torus_are_not_edges():
    torus = mesh_of(trimesh.creation.torus(12, 1.5, major_sections=128, minor_sections=48))
    found = measure_thickness(torus, 3.0, limit_mm=4.0)
    assert found.min_mm == pytest.approx(3.0, rel=0.02)
    assert found.ok_share == 1.0


def test_right_angles_of_a_cube_are_not_thin():
    found = measure_thickness(box(20, 20, 20), 3.0)
    assert found.regions == ()
    assert found.ok_share > 0.999
    assert found.min_mm > 3.0


def test_a_pin_is_as_thick_as_its_diameter():
    pin = mesh_of(trimesh.creation.cylinder(0.6, 20, sections=64))
    assert measure_thickness(pin, 1.2).ok_share == 1.0
    assert measure_thickness(pin, 1.2).min_mm == pytest.approx(1.2, rel=0.02)
    assert measure_thickness(pin, 1.3).ok_share == 0.0


def test_a_wedge_is_thin_up_to_where_the_ball_comes_near():
    corners = [
        [x, y, z] for x, half in ((0.0, 0.005), (30.0, 3.0)) for y in (0.0, 20.0) for z in (-half, half)
    ]
    found = measure_thickness(mesh_of(trimesh.convex.convex_hull(np.array(corners))), 1.2)
    middle = (found.points[:, 1] > 3) & (found.points[:, 1] < 17)
    x = found.points[:, 0]
    # A ball of 1.2 fits from x = 6.06 and vouches 0.37 * 1.2 further: 5.2, within half a wall.
    assert x[middle & found.thin].max() == pytest.approx(5.2, abs=0.6)
    assert x[middle & ~found.thin].min() == pytest.approx(5.2, abs=0.6)


def test_a_rib_does_not_borrow_the_thickness_of_its_block():
    rib = solid_mesh(cube(20, 20, 8) + cube(0.8, 20, 8).translate((0, 0, 6)))
    found = measure_thickness(rib, 1.0)
    z = found.points[:, 2]
    assert found.thin[z > 4 + 0.6].all()
    assert not found.thin[z <= 4].any()
    assert found.regions[0].free


def test_a_low_rib_is_found_by_the_smaller_balls():
    """At 1.2 the block's ball reaches the whole rib; only a ball of the rib's own size tells."""
    rib = solid_mesh(cube(20, 20, 8) + cube(0.3, 20, 0.9).translate((0, 0, 4)))
    found = measure_thickness(rib, 1.2)
    z = found.points[:, 2]
    assert found.thin[z > 4.42].all()
    assert found.thin[z <= 4].mean() < 0.001


def test_a_membrane_in_a_frame_is_held_against_the_supported_minimum():
    frame = cube(24, 24, 6) - cube(16, 16, 4).translate((0, 0, 2.2)) - cube(16, 16, 4).translate((0, 0, -2.2))
    assert measure_thickness(solid_mesh(frame), 0.8, 0.3).ok_share == 1.0
    found = measure_thickness(solid_mesh(frame), 0.8, 0.6)
    assert len(found.regions) == 2
    assert not any(region.free for region in found.regions)
    assert found.regions[0].area_mm2 == pytest.approx(16 * 16, rel=0.1)
    assert found.regions[0].thinnest_mm == pytest.approx(0.4, rel=0.02)


def test_the_rim_of_a_coarse_bowl_is_not_thin():
    bowl = manifold3d.Manifold.sphere(20, 48) - manifold3d.Manifold.sphere(18, 48)
    found = measure_thickness(solid_mesh(bowl.trim_by_plane((0, 1, 0), 3.0)), 0.9)
    assert found.regions == ()


def test_maps_have_a_value_for_every_face_and_vertex():
    plate = box(30, 30, 0.6).transformed(np.eye(4))
    found = measure_thickness(plate, 0.9)
    assert found.face_values(plate) == pytest.approx(np.full(12, 0.6), rel=0.03)
    assert found.vertex_values(plate) == pytest.approx(np.full(8, 0.6), rel=0.03)


def test_samples_share_the_surface_exactly_and_repeat():
    shape = mesh_of(trimesh.creation.cylinder(5, 20, sections=9))
    one, other = measure_thickness(shape, 0.9), measure_thickness(shape, 0.9)
    assert one.areas.sum() == pytest.approx(shape.area_mm2, rel=1e-9)
    assert np.array_equal(one.values_mm, other.values_mm)


def test_a_patch_smaller_than_the_filter_is_not_listed():
    needle = solid_mesh(cube(10, 10, 10) + cube(0.3, 0.3, 1.2).translate((0, 0, 5.4)))
    assert measure_thickness(needle, 0.9, smallest_mm2=5.0).regions == ()
    assert len(measure_thickness(needle, 0.9, smallest_mm2=0.3).regions) == 1


def test_rays_tell_distance_and_face():
    rays = Rays(box(10, 10, 10))
    origins, up = np.array([[1.0, 2.0, 0.0], [20.0, 0.0, 0.0]]), np.array([[0.0, 0, 1], [0.0, 0, 1]])
    assert rays.distances(origins, up).tolist() == pytest.approx([5.0, np.inf])
    assert rays.faces(origins, up)[1] == -1
    assert box(10, 10, 10).face_normals[rays.faces(origins, up)[0]] == pytest.approx([0, 0, 1])


def test_right_angles_of_a_large_block_are_not_thin_and_a_rib_on_it_is():
    block, rib = trimesh.creation.box((300, 120, 80)), trimesh.creation.box((40, 0.6, 10))
    rib.apply_translation([0, 0, 44])
    plain = measure_thickness(mesh_of(block), 0.9)
    assert plain.ok_share == 1.0 and plain.min_mm >= 0.9 * 0.98
    ribbed = measure_thickness(mesh_of(trimesh.boolean.union([block, rib], engine="manifold")), 0.9)
    assert len(ribbed.regions) == 1
    assert ribbed.regions[0].thinnest_mm == pytest.approx(0.6, rel=0.05)
    assert ribbed.regions[0].area_mm2 == pytest.approx(2 * 40 * 9, rel=0.15)
