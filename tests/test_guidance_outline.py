import numpy as np
import pytest
from drawn import arc
from scipy import ndimage

from fabcraft.geometry.contour import inside, resample, signed_area
from fabcraft.guidance.curves import corners, smooth_closed, smooth_open
from fabcraft.guidance.gaps import close_gaps, fill
from fabcraft.guidance.outline import fill_contour, outline_of, trim
from fabcraft.guidance.strokes import skeleton_graph, trace_strokes
from fabcraft.guidance.symmetry import mirror_axis


def test_smoothing_keeps_a_straight_line_and_its_ends():
    line = np.linspace([3.0, 4.0], [90.0, -20.0], 60)
    assert smooth_open(line, 20.0) == pytest.approx(line, abs=1e-6)


@pytest.mark.parametrize(("waves", "kept"), [(2, 0.98), (10, 0.5), (50, 0.003)])
def test_smoothing_halves_a_wave_of_the_given_length(waves, kept):
    t = np.arange(400) / 400
    wave = np.stack([400 * t, np.sin(2 * np.pi * waves * t)], 1)
    smooth = smooth_open(wave, 40.0)[100:300, 1]
    assert np.ptp(smooth) / 2 == pytest.approx(kept, abs=0.05)


def test_a_closed_contour_has_no_seam():
    circle = arc((0, 0), 100.0, n=401)[:-1] + np.random.default_rng(0).normal(size=(400, 2)) * 0.2
    turned = np.roll(smooth_closed(np.roll(circle, 131, 0), 40.0), -131, 0)
    assert turned == pytest.approx(smooth_closed(circle, 40.0), abs=0.01)


def test_a_square_has_four_corners_and_an_ellipse_none():
    square = resample(np.array([[0, 0], [100, 0], [100, 100], [0, 100]], float), 2.0)
    assert [tuple(p) for p in square[corners(square, 12, 46.0)].round().tolist()] == [
        (0, 0),
        (100, 0),
        (100, 100),
        (0, 100),
    ]
    assert len(corners(resample(arc((0, 0), 66, 42), 2.0), 11, 46.0)) == 0


def test_a_filled_contour_holds_the_pixels_whose_centre_is_inside():
    rng = np.random.default_rng(5)
    t = np.sort(rng.uniform(0, 2 * np.pi, 40))
    star = (
        np.array([30.0, 26.0]) + (rng.uniform(6, 40, 40) * np.array([np.cos(t), np.sin(t)])).T
    )  # leaves the image
    centres = np.stack(np.meshgrid(np.arange(60) + 0.5, np.arange(50) + 0.5), 2).reshape(-1, 2)
    assert np.array_equal(fill_contour(star, (50, 60)).ravel(), inside(centres, [star]))


def test_a_hair_is_cut_flush_and_a_wedge_keeps_its_tip():
    shape = np.zeros((300, 400), bool)
    shape[100:250, 50:350] = True
    shape[40:100, 198:204] = True  # a hair of 6 px
    rows = np.arange(100)[:, None]
    shape[100:200] |= (np.arange(400) >= 349) & (np.arange(400) < 349 + 40 - np.abs(rows - 40)) & (rows < 81)
    outline = outline_of(trim(shape, 10.0), 10.0)
    assert outline[:, 1].min() > 98.0
    assert outline[:, 0].max() == pytest.approx(389, abs=2.0)


def test_strokes_are_centre_lines_of_their_length():
    mask = fill_contour(np.array([[20, 40], [180, 40], [180, 50], [20, 50]], float), (100, 200))
    (line,) = trace_strokes(mask, 10.0)
    assert line[:, 1] == pytest.approx(45.0, abs=0.6)
    assert np.ptp(line[:, 0]) == pytest.approx(150, abs=8)


def test_a_ring_is_one_branch():
    ring = fill_contour(arc((60, 60), 45), (120, 120)) & ~fill_contour(arc((60, 60), 35), (120, 120))
    (branch,) = skeleton_graph(ring, 10.0)
    assert branch.ring
    assert abs(signed_area(branch.points)) == pytest.approx(np.pi * 40**2, rel=0.03)


def test_only_gaps_that_leave_something_open_are_bridged():
    ring = fill_contour(arc((150, 150), 105), (300, 300)) & ~fill_contour(arc((150, 150), 95), (300, 300))
    ring[148:152, 100:140] = True  # a stroke inside that looks at the rim
    whole = close_gaps(ring, 10.0)
    assert whole.bridges == ()
    ring[140:156, 240:260] = False
    closed = close_gaps(ring, 10.0)
    assert len(closed.bridges) == 1
    assert closed.bridges[0].gap_px == pytest.approx(16, abs=5)
    assert fill(ring).sum() < 0.5 * closed.filled.sum()


@pytest.mark.parametrize("tilt", [-9.0, 0.0, 5.0])
def test_the_mirror_axis_of_a_turned_shape(tilt):
    shape = np.zeros((400, 400), bool)
    shape[80:330, 150:290] = True
    shape[80:140, 110:330] = True
    turned = ndimage.rotate(shape.astype(float), -tilt, reshape=False, order=1) > 0.5
    axis = mirror_axis(turned)
    assert axis.tilt_deg == pytest.approx(tilt, abs=0.5)
    assert axis.iou > 0.97
    assert axis.column_px == pytest.approx(200 + 20 / np.cos(np.radians(tilt)), abs=1.5)
