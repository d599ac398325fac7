import functools
from pathlib import Path

import cv2
import numpy as np
import pytest
from drawn import CENTRE, EAR_TIPS, RADIUS, arc, ears, eyes, head, iou, page, whiskers
from PIL import Image

from fabcraft.errors import InputError
from fabcraft.geometry.contour import signed_area
from fabcraft.guidance.edges import understand
from fabcraft.guidance.outline import fill_contour
from fabcraft.guidance.show import picture_of
from fabcraft.read.image_file import read_image

EXAMPLES = Path(__file__).parents[1] / "examples"
OUTER = RADIUS + 5.0  # the outer edge of the ink


@pytest.fixture(scope="module")
def clean():
    return page([head(), *ears(), *eyes(), *whiskers()])


@pytest.fixture(scope="module")
def understood(clean):
    return understand(clean)


@functools.cache
def ring(gap_deg=0.0):
    """The round head with eyes, open by `gap_deg`, understood."""
    return understand(page([head(gap_deg), *eyes()]))


def distances(drawing):
    return np.linalg.norm(drawing.outline - CENTRE, axis=1)


@pytest.mark.parametrize("gap_deg", [0.0, 8.0, 14.0])
def test_a_circle_with_a_gap_keeps_its_area(gap_deg):
    drawing = ring(gap_deg)
    assert signed_area(drawing.outline) == pytest.approx(np.pi * OUTER**2, rel=0.01)
    assert drawing.silhouette.sum() == pytest.approx(np.pi * OUTER**2, rel=0.01)
    assert drawing.outline_closed == (gap_deg == 0)
    across = 2 * RADIUS * np.sin(np.radians(gap_deg / 2)) - 10 if gap_deg else 0.0
    assert drawing.gap_closed_px == pytest.approx(across, abs=6.0)


@pytest.mark.parametrize("gap_deg", [8.0, 14.0])
def test_a_bridged_gap_leaves_no_bite(gap_deg):
    reach = distances(ring(gap_deg))
    assert reach.min() > OUTER - 3.0
    assert reach.max() < OUTER + 3.0


def test_the_circle_is_round_to_half_a_pixel():
    reach = distances(ring())
    assert np.abs(reach - OUTER).max() < 0.6


def test_points_are_evenly_spaced_and_clockwise_on_the_screen(understood):
    step = np.linalg.norm(np.roll(understood.outline, -1, 0) - understood.outline, axis=1)
    assert step.max() < 1.5 * step.min()
    assert signed_area(understood.outline) > 0


def test_the_pair_of_eyes_is_found_left_one_first(understood):
    left, right = understood.eyes
    assert left.mean(0) == pytest.approx([305, 500], abs=1.5)
    assert right.mean(0) == pytest.approx([595, 500], abs=1.5)
    for eye in (left, right):
        assert signed_area(eye) == pytest.approx(
            np.pi * 66 * 42, rel=0.03
        )  # the centre line of the drawn loop


def test_whiskers_across_the_rim_do_not_move_the_outline():
    plain, drawing = ring(), understand(page([head(), *eyes(), *whiskers()]))
    assert np.abs(distances(drawing) - OUTER).max() < 1.0
    assert iou(plain.silhouette, drawing.silhouette) > 0.998
    assert drawing.dropped[0].startswith("6 strokes outside the outline, longest ")
    assert len(drawing.strokes) == 6


def test_whiskers_that_do_not_touch_the_rim_are_left_out_too():
    drawing = understand(page([head(), *eyes(), *whiskers(inner=350)]))
    assert np.abs(distances(drawing) - OUTER).max() < 0.8
    assert drawing.dropped[0].startswith("6 strokes")
    assert drawing.strokes == ()


def test_ear_tips_stay_where_the_ink_ends(understood):
    for tip, outwards in zip(EAR_TIPS, ([-0.29, -0.957], [0.29, -0.957]), strict=True):
        inked = tip + 5 * np.array(outwards)  # the round end of the pen
        assert np.linalg.norm(understood.outline - inked, axis=1).min() < 2.0


def test_ear_tips_are_sharp(understood):
    for tip in EAR_TIPS:
        i = int(np.linalg.norm(understood.outline - tip, axis=1).argmin())
        i += int(understood.outline[i - 6 : i + 7, 1].argmin()) - 6
        a, b = (
            understood.outline[i - 8] - understood.outline[i],
            understood.outline[(i + 8) % len(understood.outline)] - understood.outline[i],
        )
        angle = np.degrees(np.arccos(a @ b / np.linalg.norm(a) / np.linalg.norm(b)))
        assert angle < 76.0  # drawn as 47 degrees with a pen whose round end alone would give 100


def test_a_line_that_overshoots_a_corner_does_not_lengthen_the_tip(understood):
    lines = ears()
    first = np.array(lines[1][0], float)
    way = first[1] - first[2]
    lines.append((np.linspace(first[1], first[1] + way / np.linalg.norm(way) * 40, 20), None))
    drawing = understand(page([head(), *lines, *eyes(), *whiskers()]))
    assert drawing.outline[:, 1].min() > understood.outline[:, 1].min() - 8.0
    assert iou(drawing.silhouette, understood.silhouette) > 0.995


def uneven(rgba):
    y, x = np.mgrid[0 : rgba.shape[0], 0 : rgba.shape[1]] / rgba.shape[0]
    light = (0.95 - 0.45 * x - 0.2 * y) * (1 - 0.3 / (1 + np.exp(-(x + y - 1.3) / 0.03)))
    noise = np.random.default_rng(0).normal(size=rgba.shape[:2])[..., None] * 3
    out = rgba.copy()
    out[..., :3] = np.clip((rgba[..., :3] * 0.6 + 90) * light[..., None] + noise, 0, 255)
    return out


def transparent(rgba, ink=0):
    return np.dstack([np.full((*rgba.shape[:2], 3), ink, np.uint8), 255 - rgba[..., :1]])


def inverted(rgba):
    return np.dstack([255 - rgba[..., :3], rgba[..., 3:]])


VARIANTS = {
    "light on dark": inverted,
    "light on a dark board": lambda a: np.dstack(
        [(25 + 0.75 * (255 - a[..., :3])).astype(np.uint8), a[..., 3:]]
    ),
    "transparent": transparent,
    "white on transparent": lambda a: transparent(a, 255),
    "uneven light": uneven,
    "faint pencil": lambda a: np.dstack([(200 + a[..., :3] / 255 * 50).astype(np.uint8), a[..., 3:]]),
    "yellow pen": lambda a: np.dstack(
        [np.full_like(a[..., :2], 250), np.maximum(a[..., 2:3], 60), a[..., 3:]]
    ),
    "half the size": lambda a: cv2.resize(a, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA),
    "tinted paper": lambda a: (a * np.array([0.98, 0.93, 0.8, 1])).astype(np.uint8),
}


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_variant_of_the_picture_gives_the_same_drawing(variant, clean, understood):
    drawing = understand(VARIANTS[variant](clean))
    scale = understood.width / drawing.width
    again = fill_contour(drawing.outline * scale, understood.silhouette.shape)
    assert iou(again, understood.silhouette) > 0.98
    assert len(drawing.eyes) == 2
    assert drawing.eyes[0].mean(0) * scale == pytest.approx(understood.eyes[0].mean(0), abs=4)


def test_a_photo_is_turned_upright(tmp_path, clean, understood):
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(np.ascontiguousarray(np.rot90(clean[..., :3]))).save(
        tmp_path / "a.jpg", exif=exif, quality=90
    )
    assert iou(understand(read_image(tmp_path / "a.jpg")).silhouette, understood.silhouette) > 0.98


def test_a_filled_silhouette_with_white_eyes_works():
    rgba = page(
        [],
        fills=[arc(CENTRE, RADIUS), [(350, 216), (200, 60), (182, 346)], [(550, 216), (700, 60), (718, 346)]],
    )
    holes = page([], fills=[arc((305, 500), 66, 42), arc((595, 500), 66, 42), arc((450, 640), 40, 30)])
    drawing = understand(np.maximum(rgba, inverted(holes)))
    assert drawing.outline_closed
    assert [e.mean(0)[0] for e in drawing.eyes] == pytest.approx([305, 595], abs=1.5)
    assert signed_area(drawing.eyes[0]) == pytest.approx(np.pi * 66 * 42, rel=0.03)
    assert len(drawing.regions) == 1
    assert drawing.strokes == ()


def test_a_pupil_does_not_hide_the_eye():
    lids = [
        (np.array([(305 + s * 145 * 2, y) for y in (460, 540)], float), 14.0) for s in (0, 1)
    ]  # slits from lid to lid
    drawing = understand(page([head(), *eyes(), *lids]))
    assert len(drawing.eyes) == 2
    assert signed_area(drawing.eyes[0]) == pytest.approx(np.pi * 66 * 42, rel=0.04)
    assert drawing.regions == ()
    assert drawing.strokes == ()


def test_an_eye_that_is_not_quite_closed_is_an_eye():
    lines = [(arc((450 + s * 145, 500), 66, 42, start=4, stop=350), None) for s in (-1, 1)]
    assert len(understand(page([head(), *lines])).eyes) == 2


def test_a_nose_is_a_region_and_a_mouth_a_stroke():
    mouth = arc((450, 640), 90, 60, start=20, stop=160)
    drawing = understand(page([head(), *eyes(), (mouth, None)], fills=[arc((450, 600), 36, 26)]))
    assert len(drawing.regions) == 1
    assert signed_area(drawing.regions[0]) == pytest.approx(np.pi * 36 * 26, rel=0.05)
    (stroke,) = drawing.strokes
    away = np.linalg.norm(stroke[:, None] - mouth[None], axis=2).min(1)
    assert away.max() < 1.5
    assert np.linalg.norm(np.diff(stroke, axis=0), axis=1).sum() == pytest.approx(
        np.linalg.norm(np.diff(mouth, axis=0), axis=1).sum(), abs=12
    )


def test_crossing_strokes_stay_two_lines():
    cross = [
        (np.array([(350, 600), (550, 700)], float), None),
        (np.array([(350, 700), (550, 600)], float), None),
    ]
    drawing = understand(page([head(), *eyes(), *cross]))
    assert len(drawing.strokes) == 2
    for line in drawing.strokes:
        ends = line[-1] - line[0]
        assert np.abs(ends) == pytest.approx([200, 100], abs=14)


def test_loops_in_a_row_are_jewels_not_eyes():
    jewels = [(arc((x, 500), 50, 40), None) for x in (300, 450, 600)]
    drawing = understand(page([head(), *jewels]))
    assert drawing.eyes == ()
    assert len(drawing.regions) == 3


def test_loops_at_different_heights_are_not_eyes():
    drawing = understand(page([head(), (arc((305, 420), 60, 40), None), (arc((595, 600), 60, 40), None)]))
    assert drawing.eyes == ()


def test_the_larger_of_two_drawings_is_used():
    small = arc((780, 120), 90)
    drawing = understand(page([(arc((400, 540), 300), None), (small, None)]))
    assert np.linalg.norm(drawing.outline.mean(0) - [400, 540]) < 2
    assert "2 drawings" in drawing.warnings[0]


def test_the_axis_of_a_turned_drawing_is_found(clean):
    turn = cv2.getRotationMatrix2D((450.0, 450.0), -6.0, 0.9)  # clockwise on the screen
    turned = cv2.warpAffine(clean, turn, (900, 900), flags=cv2.INTER_AREA, borderValue=(255, 255, 255, 255))
    drawing = understand(turned)
    assert drawing.symmetry_tilt_deg == pytest.approx(6.0, abs=0.6)
    assert drawing.symmetry_axis_px == pytest.approx(450, abs=3)
    assert drawing.symmetry_iou > 0.98
    assert len(drawing.eyes) == 2


def test_an_upright_drawing_has_an_upright_axis(understood):
    assert understood.symmetry_tilt_deg == 0.0
    assert understood.symmetry_axis_px == pytest.approx(450, abs=0.7)
    assert understood.symmetry_iou > 0.99


def test_a_blank_page_is_refused():
    rng = np.random.default_rng(1)
    noise = np.clip(240 + 2.5 * rng.normal(size=(500, 500, 4)), 0, 255).astype(np.uint8)
    noise[..., 3] = 255
    for picture in (np.full((400, 400, 4), 255, np.uint8), np.zeros((400, 400, 4), np.uint8), noise):
        with pytest.raises(InputError, match=r"blank|transparent"):
            understand(picture)


@pytest.mark.parametrize(
    "lines", [[head(120)], [head(120), *eyes()], whiskers()], ids=["arc", "arc with eyes", "lines"]
)
def test_an_open_outline_is_refused_with_the_next_step(lines):
    with pytest.raises(InputError) as error:
        understand(page(lines))
    assert "Close the outline" in error.value.next_step


def test_arrays_are_read_only(understood):
    with pytest.raises(ValueError, match="read-only"):
        understood.outline[0] = 0
    with pytest.raises(ValueError, match="read-only"):
        understood.eyes[0][0] = 0


def test_the_same_picture_gives_the_same_drawing(clean, understood):
    again = understand(clean)
    assert np.array_equal(again.outline, understood.outline)
    assert all(np.array_equal(a, b) for a, b in zip(again.strokes, understood.strokes, strict=True))


def test_the_picture_of_a_drawing_has_its_size_and_colours(understood):
    picture = picture_of(understood)
    assert picture.shape == (900, 900, 3)
    x, y = understood.outline[0].astype(int)
    assert picture[y, x, 1] > picture[y, x, 0]
    assert (picture[500, 305] == 255).all()  # an eye is open


def test_paper_photographed_on_a_table_gives_the_same_drawing(clean, understood):
    rng = np.random.default_rng(4)
    table = rng.integers(60, 75, (1200, 1300, 4)).astype(np.uint8)
    table[..., 3] = 255
    table[150:1050, 200:1100, :3] = clean[..., :3] // 2 + 110
    drawing = understand(table)
    assert iou(drawing.silhouette[150:1050, 200:1100], understood.silhouette) > 0.98
    assert len(drawing.eyes) == 2


def test_a_light_shape_on_a_dark_page_is_a_drawing_and_no_sheet_of_paper():
    light = page([], fills=[arc(CENTRE, RADIUS)])
    holes = page([], fills=[arc((305, 500), 66, 42), arc((595, 500), 66, 42)])
    drawing = understand(inverted(np.maximum(light, inverted(holes))))
    assert drawing.silhouette.sum() == pytest.approx(np.pi * RADIUS**2, rel=0.01)
    assert len(drawing.eyes) == 2


def test_searching_pencil_lines_are_one_line(understood):
    rng = np.random.default_rng(7)
    lines = [head(), *ears(), *eyes(), *whiskers()]
    searched = [(np.asarray(p) + rng.normal(size=2) * 2.5, 4.0) for p, _ in lines for _ in range(4)]
    drawing = understand(page(searched))
    assert iou(drawing.silhouette, understood.silhouette) > 0.98
    assert len(drawing.eyes) == 2
    assert len(drawing.strokes) <= len(understood.strokes) + 2


def test_a_drawing_cut_by_the_border_is_closed_along_it():
    drawing = understand(page([head(), *eyes()])[:760].copy())
    below = (760 - CENTRE[1]) / OUTER
    beyond = OUTER**2 * (np.arccos(below) - below * np.sqrt(1 - below**2))
    assert drawing.silhouette.sum() == pytest.approx(np.pi * OUTER**2 - beyond, rel=0.01)
    assert any("border" in warning for warning in drawing.warnings)


def test_an_open_ear_is_left_out_with_a_warning():
    right = np.array(ears()[1][0], float)
    right[0] += 0.55 * (right[1] - right[0])
    drawing = understand(page([head(), ears()[0], (right, None), *eyes()]))
    assert any("close its gaps" in warning for warning in drawing.warnings)


@pytest.mark.parametrize(
    ("name", "eyes_found", "strokes_least"),
    [
        ("cat-mask.png", 2, 12),
        ("cat-photo.jpg", 2, 12),
        ("bunny.png", 2, 4),
        ("crown.png", 0, 1),  # only the band; the rest are jewels
        ("butterfly.png", 2, 3),
        ("owl.png", 2, 15),
        ("fox.png", 2, 5),
    ],
)
def test_the_examples_are_good_masks(name, eyes_found, strokes_least):
    drawing = understand(read_image(EXAMPLES / name))
    assert len(drawing.eyes) == eyes_found
    assert len(drawing.strokes) >= strokes_least
    assert drawing.symmetry_iou > 0.97
    width, height = np.ptp(drawing.outline, axis=0)
    assert 0.65 < width / height < 1.35
    if eyes_found:
        apart = np.linalg.norm(drawing.eyes[1].mean(0) - drawing.eyes[0].mean(0))
        assert 0.40 < apart / width < 0.50


def test_noise_is_refused_instead_of_being_traced_for_minutes() -> None:
    grey = np.random.default_rng(0).integers(0, 256, (500, 500), dtype=np.uint8)
    with pytest.raises(InputError, match="short lines"):
        understand(np.dstack([grey, grey, grey, np.full_like(grey, 255)]))


def test_a_loop_that_passes_its_own_start_is_an_eye():
    turn = np.radians(np.linspace(0, 375, 300))
    grow = np.linspace(1.0, 1.22, 300)  # it ends outside where it began
    lines = [
        (np.column_stack([450 + s * 145 + 66 * grow * np.cos(turn), 500 + 42 * grow * np.sin(turn)]), 4.0)
        for s in (-1, 1)
    ]
    assert len(understand(page([head(), *lines])).eyes) == 2


def test_a_zigzag_is_no_loop():
    zigzag = np.column_stack([np.linspace(330, 570, 9), np.tile([560, 680], 5)[:9]]).astype(float)
    drawing = understand(page([head(), *eyes(y=430), (zigzag, None)]))
    assert drawing.regions == ()


def test_a_thick_marker_keeps_the_size_of_a_small_loop():
    drawing = understand(page([head(), *eyes()], pen=30.0))
    for eye in drawing.eyes:
        assert signed_area(eye) == pytest.approx(np.pi * 66 * 42, rel=0.08)
    assert len(drawing.eyes) == 2


def test_a_filled_ring_has_its_bore():
    bore = page([], fills=[arc(CENTRE, 220)])
    drawing = understand(np.maximum(page([], fills=[arc(CENTRE, RADIUS)]), inverted(bore)))
    (region,) = drawing.regions
    assert signed_area(region) == pytest.approx(np.pi * 220**2, rel=0.02)
