import sys

import numpy as np
import pytest
from drawn import CENTRE, RADIUS, arc, iou
from scipy.ndimage import gaussian_filter

from fabcraft.errors import InputError, MissingError
from fabcraft.guidance.foreground import foreground
from fabcraft.guidance.inflate import InflateSettings
from fabcraft.guidance.outline import fill_contour
from fabcraft.guidance.photograph import read_as, understand_photograph

SIDE = 600
SCALE = SIDE / 900
SHAPE = fill_contour(arc(CENTRE, RADIUS) * SCALE, (SIDE, SIDE))
EYES = [fill_contour(arc((450 + s * 145, 470), 66, 46) * SCALE, (SIDE, SIDE)) for s in (-1, 1)]


def ball(background, alpha=255):
    """An orange ball with two dark eyes, lit from above, before a background of (H, W, 3)."""
    rng = np.random.default_rng(3)
    y, x = np.mgrid[0:SIDE, 0:SIDE]
    height = np.sqrt(np.clip(1 - ((x - 300) ** 2 + (y - 347) ** 2) / 213**2, 0, 1))
    rgb = np.array([235.0, 140.0, 50.0]) * (0.45 + 0.5 * height - 0.15 * (y - 347) / 213)[..., None]
    for eye in EYES:
        rgb[eye] = (40, 40, 60)
    soft = gaussian_filter(SHAPE.astype(float), 0.7)[..., None]
    mixed = rgb * soft + background * (1 - soft) + rng.normal(size=(SIDE, SIDE, 3)) * 3
    return np.dstack(
        [np.clip(mixed, 0, 255).astype(np.uint8), np.broadcast_to(np.uint8(alpha), (SIDE, SIDE))]
    )


def leaves():
    noise = gaussian_filter(np.random.default_rng(1).normal(size=(SIDE, SIDE, 1)), (4, 4, 0))
    return np.clip(np.array([60, 110, 60]) + noise / noise.std() * 25, 0, 255)


PLAIN = np.full((SIDE, SIDE, 3), 235.0)


@pytest.mark.parametrize("background", [PLAIN, leaves()], ids=["plain", "busy"])
def test_an_object_is_told_from_its_background(background):
    drawing = understand_photograph(ball(background))
    assert iou(drawing.silhouette, SHAPE) > 0.97
    assert len(drawing.eyes) == 2
    for eye, truth in zip(drawing.eyes, EYES, strict=True):
        assert iou(fill_contour(eye, (SIDE, SIDE)), truth) > 0.8
    assert "GrabCut" in drawing.told_apart


def test_transparency_is_taken_at_its_word():
    drawing = read_as(ball(leaves(), SHAPE * np.uint8(255)), "auto")
    assert iou(drawing.silhouette, SHAPE) > 0.99
    assert "transparency" in drawing.told_apart


def test_shading_is_lighter_above_than_below_and_nothing_outside():
    drawing = understand_photograph(ball(PLAIN))
    shade = drawing.shade
    assert not shade[~drawing.silhouette].any()
    upper, lower = (
        SHAPE & ~EYES[0] & ~EYES[1] & half
        for half in (np.arange(SIDE)[:, None] < 300, np.arange(SIDE)[:, None] > 400)
    )
    assert shade[upper].mean() > shade[lower].mean()
    assert shade[EYES[0]].mean() < -0.5
    assert shade.min() >= -1
    assert shade.max() <= 1


def test_an_object_of_its_backgrounds_own_colours_is_refused():
    noise = gaussian_filter(np.random.default_rng(5).normal(size=(SIDE, SIDE, 3)), (9, 9, 0))
    everywhere = np.clip(128 + noise / noise.std() * 40, 0, 255).astype(np.uint8)
    with pytest.raises(InputError, match="cannot be told apart") as error:
        foreground(np.dstack([everywhere, np.full((SIDE, SIDE), 255, np.uint8)]), "grabcut")
    assert "--foreground rembg" in error.value.next_step


def test_one_even_colour_is_refused():
    with pytest.raises(InputError, match="even colour"):
        foreground(np.full((300, 300, 4), 255, np.uint8), "grabcut")


def test_an_opaque_picture_has_no_alpha_to_go_by():
    with pytest.raises(InputError, match="no transparent part"):
        foreground(ball(PLAIN), "alpha")


def test_an_absent_network_says_how_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "rembg", None)
    with pytest.raises(MissingError, match="rembg is not installed") as error:
        foreground(ball(PLAIN), "rembg")
    assert "pip install 'fabcraft[rembg]'" in error.value.next_step
    assert error.value.exit_code == 3


def test_the_networks_mask_is_used(monkeypatch):
    class Rembg:
        @staticmethod
        def remove(picture, only_mask):
            assert picture.shape == (SIDE, SIDE, 3)
            assert only_mask
            return SHAPE.astype(np.uint8) * 255

    monkeypatch.setitem(sys.modules, "rembg", Rembg)
    assert np.array_equal(foreground(ball(leaves()), "rembg").mask, SHAPE)


def test_shade_height_is_held_to_its_range():
    with pytest.raises(InputError, match="shade_height_mm"):
        InflateSettings(shade_height_mm=9.0)
