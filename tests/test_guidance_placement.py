import numpy as np
import pytest
from masked import drawing, ring, template, two_eyes

from fabcraft.errors import InputError
from fabcraft.geometry.contour import inside, signed_area
from fabcraft.guidance.placement import PlacementSettings, place


def real_eyes(placed_on):
    return np.stack([placed_on.body.landmarks[name][[0, 2]] for name in ("eye_right", "eye_left")])


def middle(contour):
    return 0.5 * (contour.min(0) + contour.max(0))


@pytest.mark.parametrize("name", ["man", "child"])
@pytest.mark.parametrize("apart", [150.0, 190.0, 230.0])
def test_drawn_eyes_land_on_the_eyes(name, apart):
    on = template(name)
    placed = place(drawing(eyes=two_eyes(apart=apart)), on)
    eyes = real_eyes(on)
    distance = np.linalg.norm(eyes[1] - eyes[0])
    assert placed.by_eyes
    for opening, eye in zip(placed.openings, eyes, strict=True):
        assert np.linalg.norm(middle(opening) - eye) < 0.1 * distance


def test_a_drawing_is_laid_the_right_way_round():
    eyes = two_eyes()
    mole = ring(400.0, 400.0, 12.0)
    placed = place(drawing(eyes=eyes, regions=(mole,), strokes=(mole[:60],)), template())
    assert placed.openings[0][:, 0].mean() < placed.openings[1][:, 0].mean()
    assert placed.regions[0][:, 0].mean() > placed.outline[:, 0].mean()  # right in the picture: +x
    assert placed.regions[0][:, 1].mean() < placed.openings[0][:, 1].mean()  # lower in the picture: lower
    assert placed.strokes[0].shape == (60, 2)
    assert signed_area(placed.outline) > 0


def test_the_settings_scale_and_shift():
    on, one = template(), drawing(eyes=two_eyes())
    plain = place(one, on)
    larger = place(one, on, PlacementSettings(scale=1.25))
    moved = place(one, on, PlacementSettings(up_mm=7.0, left_mm=-4.0))
    assert np.ptp(larger.outline, axis=0) == pytest.approx(1.25 * np.ptp(plain.outline, axis=0))
    assert larger.pixel_mm == pytest.approx(1.25 * plain.pixel_mm)
    assert middle(np.vstack(larger.openings)) == pytest.approx(middle(np.vstack(plain.openings)), abs=1e-6)
    assert moved.outline - plain.outline == pytest.approx(np.tile([-4.0, 7.0], (len(plain.outline), 1)))
    assert moved.openings[0].mean(0) - plain.openings[0].mean(0) == pytest.approx([-4.0, 7.0])


def test_a_drawing_without_eyes_takes_the_openings_and_the_size_of_the_template():
    on = template()
    placed = place(drawing(), on)
    assert not placed.by_eyes
    assert all((a == b).all() for a, b in zip(placed.openings, on.openings, strict=True))
    drawn, wanted = np.ptp(placed.outline, axis=0), np.ptp(on.outline, axis=0)
    assert np.sqrt(drawn.prod() / wanted.prod()) == pytest.approx(1.06, abs=0.06)
    assert placed.outline[:, 0].mean() == pytest.approx(on.outline[:, 0].mean(), abs=1.5)


def test_a_drawing_without_eyes_is_moved_until_there_is_room():
    on = template()
    # a pear: narrow above, where the eyes would be
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    width = 220.0 * (1.0 + 0.32 * np.sin(angle))
    pear = np.column_stack([300.0 + width * np.cos(angle), 300.0 + 270.0 * np.sin(angle)])
    placed = place(drawing(pear), on)
    room = margin_of(placed)
    assert room >= 2.5 * on.wall_mm - 1e-6
    assert any("moved" in note for note in placed.notes)


def margin_of(placed):
    points = np.vstack(placed.openings)
    assert inside(points, [placed.outline]).all()
    dense = np.vstack([placed.outline, 0.5 * (placed.outline + np.roll(placed.outline, -1, 0))])
    return np.linalg.norm(points[:, None] - dense[None], axis=2).min()


def test_without_room_for_the_eyes_there_is_an_error_with_advice():
    tight = drawing(eyes=two_eyes(y=70.0, apart=150.0))
    with pytest.raises(InputError, match="eye openings") as caught:
        place(tight, template())
    assert "--scale" in caught.value.next_step
    bar = drawing(ring(300.0, 300.0, 280.0, 25.0))
    with pytest.raises(InputError, match="eye openings"):
        place(bar, template(), PlacementSettings(scale=0.5))


def test_small_drawn_eyes_are_made_large_enough_to_look_through():
    on = template()
    placed = place(drawing(eyes=two_eyes(a=12.0, b=8.0)), on)
    least = 0.7 * np.ptp(on.openings[0], axis=0)
    for opening in placed.openings:
        assert (np.ptp(opening, axis=0) >= least - 1e-6).all()
    assert any("enlarged" in note for note in placed.notes)


def test_a_half_mask_without_eyes_lies_over_the_eyes():
    on = template()
    placed = place(drawing(ring(300.0, 300.0, 280.0, 150.0)), on)
    lower, upper = placed.outline.min(0), placed.outline.max(0)
    assert (lower[1] < real_eyes(on)[:, 1]).all()
    assert (real_eyes(on)[:, 1] < upper[1]).all()
    assert margin_of(placed) >= 2.5 * on.wall_mm - 1e-6


@pytest.mark.parametrize("bad", [{"scale": 0.4}, {"scale": 2.1}, {"up_mm": 101.0}, {"left_mm": -101.0}])
def test_settings_out_of_range_are_refused(bad):
    with pytest.raises(InputError):
        PlacementSettings(**bad)
