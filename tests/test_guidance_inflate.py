import numpy as np
import pytest
from masked import assert_clean_sheet, drawing, ring, template, two_eyes

from fabcraft.errors import InputError
from fabcraft.geometry.contour import signed_area
from fabcraft.geometry.plane import Plane
from fabcraft.guidance.inflate import InflateSettings, _membrane, inflate, solid_mask
from fabcraft.guidance.placement import place

SMILE = np.column_stack([np.linspace(230.0, 370.0, 80), 430.0 + 20.0 * np.sin(np.linspace(0.0, np.pi, 80))])


@pytest.fixture(scope="module")
def placed():
    nose = ring(300.0, 345.0, 28.0, 20.0)
    return place(drawing(eyes=two_eyes(), regions=(nose,), strokes=(SMILE,)), template())


@pytest.fixture(scope="module")
def relief(placed):
    return inflate(placed, template())


def grid(plane):
    x, z = plane.centres()
    return np.column_stack([x.ravel(), z.ravel()]), x.shape


def test_the_membrane_over_a_disc_is_the_closed_form():
    plane = Plane(-45.0, 45.0, 1.0, 90, 90)
    radius = np.hypot(*plane.centres())
    domain = radius < 40.0
    u = _membrane(domain, np.zeros_like(radius), 1.0)
    exact = 0.25 * (40.0**2 - radius**2)
    assert u[domain] == pytest.approx(exact[domain], abs=0.03 * exact.max())
    # the membrane is held at the centres of the next pixels: its disc is up to half a pixel larger
    assert u[radius < 2] == pytest.approx(exact[radius < 2], rel=0.025)
    assert (u[~domain] == 0.0).all()


def test_the_membrane_does_not_depend_on_the_pixel():
    coarse, fine = (Plane(-45.0, 45.0, p, round(90 / p), round(90 / p)) for p in (2.0, 1.0))
    tops = [
        _membrane(np.hypot(*p.centres()) < 40.0, np.zeros((p.height, p.width)), p.pixel_mm).max()
        for p in (coarse, fine)
    ]
    assert tops[0] == pytest.approx(tops[1], rel=0.03)


def test_a_symmetric_drawing_gives_a_symmetric_relief(relief):
    axis = 0.5 * (relief.outline[:, 0].min() + relief.outline[:, 0].max())
    xz, _ = grid(relief.plane)
    xz = xz[relief.room_at(xz) > 4.0]
    mirrored = np.column_stack([2.0 * axis - xz[:, 0], xz[:, 1]])
    front = template().front
    swell, other = (relief.height_at(p) - front.base_at(p) for p in (xz, mirrored))
    assert np.sqrt(np.mean((swell - other) ** 2)) < 0.25
    assert relief.detail_at(xz) == pytest.approx(relief.detail_at(mirrored), abs=0.35)


def test_a_stroke_becomes_a_bead_of_the_asked_height(placed):
    for height_mm in (0.8, 1.2, 2.0):
        made = inflate(placed, template(), InflateSettings(stroke_height_mm=height_mm, region_height_mm=0.0))
        along = made.detail_at(placed.strokes[0][10:-10])
        assert along == pytest.approx(np.full(len(along), height_mm), rel=0.1)
        beside = made.detail_at(placed.strokes[0][10:-10] + [0.0, 6.0])
        assert np.abs(beside).max() < 0.05


def test_a_region_becomes_a_cushion(placed, relief):
    assert relief.detail_at(placed.regions[0].mean(0)[None])[0] == pytest.approx(
        InflateSettings().region_height_mm, rel=0.15
    )


def test_the_rim_carries_a_bead_and_without_one_it_is_flat(placed, relief):
    plain = inflate(placed, template(), InflateSettings(rim_height_mm=0.0))
    inward = relief.outline + 2.4 * _inward(relief.outline)
    assert np.median(relief.detail_at(inward)) == pytest.approx(0.8, abs=0.1)
    assert np.median(plain.detail_at(inward)) < 0.05


def _inward(outline):
    along = np.roll(outline, -1, 0) - np.roll(outline, 1, 0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return np.column_stack([-along[:, 1], along[:, 0]])


def test_the_relief_only_adds_and_stays_above_the_floor(relief):
    front = template().front
    xz, shape = grid(relief.plane)
    floor = front.at(np.where(np.isfinite(front.floor), front.floor, -1e3), xz).reshape(shape)
    assert relief.detail.min() >= 0.0
    assert (relief.height >= floor - 1e-9).all()
    assert np.isfinite(relief.height).all()
    assert relief.plane.pixel_mm == 1.0
    assert relief.fine.pixel_mm == 0.25


def test_without_swell_the_sheet_is_the_template(placed):
    flat = inflate(placed, template(), InflateSettings(swell=0.0))
    xz, shape = grid(flat.plane)
    front = template().front
    floor = front.at(np.where(np.isfinite(front.floor), front.floor, -1e3), xz)
    assert flat.height == pytest.approx(np.maximum(front.base_at(xz), floor).reshape(shape), abs=1e-6)


def test_the_swell_stays_under_its_limit(placed):
    xz, shape = grid(inflate(placed, template()).plane)
    base = template().front.base_at(xz).reshape(shape)
    tame = inflate(placed, template(), InflateSettings(swell=0.8, swell_limit_mm=5.0))
    wild = inflate(placed, template(), InflateSettings(swell=0.8, swell_limit_mm=20.0))
    front = template().front
    floor = front.at(np.where(np.isfinite(front.floor), front.floor, -1e3), xz).reshape(shape)
    free = base >= floor
    assert (tame.height - base)[free].max() < 5.2
    assert (wild.height - base)[free].max() > 6.0


def test_what_the_object_covers_is_the_outline_without_the_openings(relief):
    plane = Plane.around(relief.outline, 0.25, 2.0)
    solid = solid_mask(relief.outline, relief.openings, plane)
    area = signed_area(relief.outline) - sum(abs(signed_area(opening)) for opening in relief.openings)
    assert solid.sum() * 0.25**2 == pytest.approx(area, rel=0.003)
    room = relief.room_at(np.vstack([relief.outline, *relief.openings]))
    assert np.abs(room).max() < 1.1  # the grid of the room is 1 mm


def test_the_mesh_of_a_relief_is_a_clean_sheet_at_its_height(relief):
    mesh = relief.mesh()
    assert_clean_sheet(mesh)
    xz = mesh.vertices[:, [0, 2]]
    assert -mesh.vertices[:, 1] == pytest.approx(relief.height_at(xz) + relief.detail_at(xz))


def test_the_same_drawing_gives_the_same_relief(placed, relief):
    again = inflate(placed, template())
    assert again.height.tobytes() == relief.height.tobytes()
    assert again.detail.tobytes() == relief.detail.tobytes()


@pytest.mark.parametrize(
    "wrong", [{"swell": -0.1}, {"stroke_height_mm": 50.0}, {"stroke_width_mm": float("nan")}]
)
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        InflateSettings(**wrong)
