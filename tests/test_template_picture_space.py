import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worn import torus

from fabcraft.template.picture_space import PictureSpace
from fabcraft.template.template import MotifFrame

ACROSS, UP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
FLAT = MotifFrame("bezel", np.array([0.0, -10.0, 5.0]), ACROSS, UP, (14.0, 10.0), 3.0)
ROLLED = MotifFrame(
    "band", np.array([0.0, -10.0, 5.0]), ACROSS, UP, (14.0, 10.0), 3.0, axis=(np.array([0.0, 0.0, -20.0]), UP)
)


def test_a_picture_looks_off_the_object():
    np.testing.assert_allclose(FLAT.outward, [0.0, -1.0, 0.0])


@pytest.mark.parametrize("frame", [FLAT, ROLLED], ids=["flat", "rolled"])
@given(scale=st.floats(0.1, 20.0), seed=st.integers(0, 2**16))
def test_going_in_and_out_is_doing_nothing(frame, scale, seed):
    points = np.random.default_rng(seed).uniform(-9.0, 9.0, (20, 3)) + [0.0, -12.0, 0.0]
    space = PictureSpace(frame, scale)
    np.testing.assert_allclose(space.outside(space.inside(points)), points, atol=1e-9)


@pytest.mark.parametrize("frame", [FLAT, ROLLED], ids=["flat", "rolled"])
def test_the_frames_origin_is_the_pictures_and_its_directions_are_right_off_and_up(frame):
    space, step = PictureSpace(frame, 3.0), 1e-6
    np.testing.assert_allclose(space.inside(frame.origin[None]), [[0.0, 0.0, 0.0]], atol=1e-12)
    moved = space.inside(frame.origin + step * np.stack([frame.right, frame.outward, frame.up])) / step
    np.testing.assert_allclose(moved, 3.0 * np.array([[1, 0, 0], [0, -1, 0], [0, 0, 1]]), atol=1e-4)


def test_a_rolled_picture_unrolls_a_ring_into_a_strip():
    ring = torus(9.0, 1.0, around=120, across=24)
    axis = (np.zeros(3), UP)
    frame = MotifFrame("band", np.array([0.0, -10.0, 0.0]), ACROSS, UP, (20.0, 2.0), 0.0, axis=axis)
    strip = PictureSpace(frame, 2.0).seen(ring)
    outer = strip.vertices[np.abs(strip.vertices[:, 1]) < 1e-6]
    assert len(outer) > 80
    np.testing.assert_allclose(outer[:, 2], 0.0, atol=1e-9)  # the crest lies in the picture's middle line
    assert np.ptp(strip.vertices[:, 0]) == pytest.approx(2.0 * 10.0 * 2.0 * np.pi * 0.92, rel=0.05)
