"""Frames in which a drawing is the whole object, on shapes whose measures are known."""

import manifold3d
import numpy as np
import pytest
import trimesh

from fabcraft.mesh import Mesh
from fabcraft.template.whole import PROUD_MM, crest, profile, sole

UP = np.array([0.0, 0.0, 1.0])


def meshed(shape, name="object"):
    return Mesh(np.array(shape.vertices, dtype=np.float64), np.array(shape.faces, dtype=np.int32), name)


@pytest.mark.parametrize("turn_deg", [0.0, 35.0])
def test_a_band_is_seen_along_its_axis_with_its_bore(turn_deg):
    turn = trimesh.transformations.rotation_matrix(np.radians(turn_deg), [1.0, 0.0, 0.0])
    shape = trimesh.creation.annulus(9.0, 11.0, 6.0, sections=160).apply_transform(turn)
    axis = turn[:3, :3] @ UP
    frame = profile(meshed(shape), np.zeros(3), axis, np.array([0.0, -1.0, 0.2]), 2.0, 5.0)
    assert frame.reading == "object"
    np.testing.assert_allclose(frame.outward, axis, atol=1e-9)
    np.testing.assert_allclose(frame.origin, (3.0 + PROUD_MM) * axis, atol=1e-6)
    np.testing.assert_allclose(frame.size_mm, 22.0, atol=0.1)
    assert frame.depth_mm == pytest.approx(6.0 + 2.0 * PROUD_MM)
    bore = np.hypot(*frame.openings[0].T)
    np.testing.assert_allclose(bore, 9.0 + 0.6 * 2.0, atol=0.02)  # skin meets the band alone


def test_the_bore_goes_on_across_the_gap_of_a_cuff():
    ring = trimesh.creation.annulus(30.0, 33.0, 12.0, sections=160).subdivide()
    keep = ring.triangles_center[:, 1] > -25.0
    cuff = Mesh(np.array(ring.vertices), np.array(ring.faces[keep], dtype=np.int32), "cuff")
    frame = profile(cuff, np.zeros(3), UP, np.array([0.0, -1.0, 0.0]), 3.0, 5.0)
    centre = frame.origin[:2]
    away = frame.openings[0] @ np.stack([frame.right[:2], frame.up[:2]]) + centre
    np.testing.assert_allclose(np.hypot(*away.T), 31.8, atol=1.2)


def bowl():
    """A half ball of radius 100 and wall 4, open below."""
    outer, inner = manifold3d.Manifold.sphere(100.0, 96), manifold3d.Manifold.sphere(96.0, 96)
    made = (outer - inner).trim_by_plane((0.0, 0.0, 1.0), 0.0).to_mesh64()
    mesh = Mesh(made.vert_properties[:, :3].astype(np.float64), made.tri_verts.astype(np.int32), "bowl")
    return mesh, np.linalg.norm(mesh.corners.mean(1), axis=1) < 96.5


def test_a_crest_stands_on_the_shell_and_leaves_its_hollow_free():
    mesh, inside = bowl()
    frame = crest(mesh, inside, 8.0, 40.0)
    np.testing.assert_allclose(frame.outward, [1.0, 0.0, 0.0])
    assert frame.origin[0] == 4.0 and frame.depth_mm == 8.0
    assert frame.size_mm[0] == pytest.approx(200.0, rel=0.01)
    assert frame.origin[2] - 0.5 * frame.size_mm[1] == pytest.approx(0.0, abs=0.1)  # it begins at the rim
    free = trimesh.Trimesh(frame.free.vertices, frame.free.faces, process=False)
    within = np.array([[0.0, 0.0, 90.0], [0.0, 0.0, -50.0], [0.0, -150.0, -10.0], [60.0, 0.0, 60.0]])
    beyond = np.array([[0.0, 0.0, 101.0], [0.0, -110.0, 20.0]])
    assert free.contains(within).all() and not free.contains(beyond).any()


def test_a_sole_is_seen_from_above_with_the_toes_up():
    box = meshed(trimesh.creation.box((80.0, 240.0, 60.0)).apply_translation([100.0, 20.0, 30.0]))
    frame = sole(box, np.array([0.0, -2.0, 0.0]), 6.0, 20.0)
    np.testing.assert_allclose(frame.outward, UP)
    np.testing.assert_allclose(frame.up, [0.0, -1.0, 0.0])
    np.testing.assert_allclose(frame.origin, [100.0, 20.0, 6.0])
    assert frame.size_mm[0] > 80.0 and frame.size_mm[1] > 240.0
    assert frame.depth_mm == pytest.approx(6.0 + PROUD_MM)  # down to a little below the ground
