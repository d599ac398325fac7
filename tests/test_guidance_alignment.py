import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from worn import ball, horned, torus

from fabcraft.errors import InputError
from fabcraft.guidance.alignment import aligned
from fabcraft.mesh import Mesh


def turned(mesh, seed, scale):
    turn = Rotation.random(random_state=seed).as_matrix()
    return mesh.with_vertices(scale * mesh.vertices @ turn.T + [300.0, -20.0, 7.0])


@pytest.mark.parametrize(("seed", "scale"), [(1, 0.01), (2, 30.0), (3, 1.0)])
def test_a_mesh_of_any_scale_and_turn_comes_back_onto_itself(seed, scale):
    onto = horned()
    found = aligned(turned(onto, seed, scale), onto)
    assert found.residual < 0.04
    assert found.scaled == pytest.approx(1.0 / scale, rel=0.05)
    tips = onto.vertices[np.argsort(onto.vertices[:, 2])[-5:]]
    away = np.linalg.norm(found.mesh.vertices[:, None] - tips[None], axis=2).min(0)
    assert away.max() < 2.0


def test_what_resembles_nothing_is_refused_unless_forced():
    stick = trimesh.creation.cylinder(0.5, 60.0)
    stick = Mesh(np.array(stick.vertices), np.array(stick.faces, dtype=np.int32), "stick")
    with pytest.raises(InputError, match="resembles the ring too little"):
        aligned(stick, torus(10.0, 2.0))
    assert aligned(stick, torus(10.0, 2.0), force=True).residual > 0.1


def test_a_mesh_without_a_surface_is_refused():
    with pytest.raises(InputError, match="no surface"):
        aligned(Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32)), ball())
