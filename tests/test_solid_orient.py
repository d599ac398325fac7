import numpy as np
import pytest
import trimesh

from fabcraft.mesh import Mesh
from fabcraft.profile import load_profile
from fabcraft.solid.orient import onto_bed


def box(*size):
    shape = trimesh.creation.box(size)
    return Mesh(np.array(shape.vertices) + [5.0, -140.0, 800.0], np.array(shape.faces, dtype=np.int32), "box")


@pytest.mark.parametrize(
    ("size", "words"),
    [
        ((160.0, 60.0, 160.0), "as it is worn"),
        ((160.0, 60.0, 235.0), "turned by"),
        ((160.0, 60.0, 205.0), "as it is worn"),
        ((240.0, 80.0, 200.0), "as it is worn"),
        ((150.0, 230.0, 80.0), "turned by 90 degrees"),
        ((100.0, 30.0, 208.0 + 13.0), "on its back"),
    ],
)
def test_the_object_lies_in_the_build_volume(size, words):
    profile = load_profile("prusa-mk4")
    placed = onto_bed(box(*size), profile)
    laid, said = placed.mesh, placed.words
    assert words in said
    lower, upper = laid.bounds
    assert (lower >= -1e-9).all() and (upper <= np.array(profile.build_mm) + 1e-9).all()
    assert lower[2] == pytest.approx(0.0)
    np.testing.assert_allclose(0.5 * (lower + upper)[:2], np.array(profile.build_mm)[:2] / 2)
    assert laid.volume_mm3 == pytest.approx(np.prod(size))


def test_the_front_looks_up_when_it_lies_on_its_back():
    profile = load_profile("prusa-mk4")
    tall = box(100.0, 30.0, 221.0 - 13.0 + 12.5)
    front = tall.vertices[:, 1] == tall.vertices[:, 1].min()
    placed = onto_bed(tall, profile)
    laid, said = placed.mesh, placed.words
    assert "back" in said
    assert laid.vertices[front][:, 2].min() > laid.vertices[~front][:, 2].max()


def test_an_object_that_fits_nowhere_stays_as_worn_and_says_so():
    placed = onto_bed(box(400.0, 400.0, 400.0), load_profile("prusa-mk4"))
    laid, said = placed.mesh, placed.words
    assert "larger than the build volume" in said
    np.testing.assert_allclose(laid.size_mm, 400.0)
