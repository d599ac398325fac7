import numpy as np
import pytest
import trimesh
from masked import drawing, ring, template, two_eyes

from fabcraft.errors import InputError
from fabcraft.geometry.align import axis_rotations
from fabcraft.geometry.contour import inside
from fabcraft.geometry.plane import Plane
from fabcraft.guidance.facing import faced
from fabcraft.guidance.inflate import Relief, inflate, solid_mask
from fabcraft.guidance.placement import PlacementSettings, place
from fabcraft.guidance.target import target_relief
from fabcraft.mesh import Mesh, concatenate

Y_UP_FACING_X = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
SMILE = np.column_stack([np.linspace(230.0, 370.0, 80), 430.0 + 20.0 * np.sin(np.linspace(0.0, np.pi, 80))])


def eared():
    """A round head with two ears, (N, 2) px."""
    angle = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
    radius = 230.0 + sum(90.0 * np.exp(-(((angle - tip) / 0.22) ** 2)) for tip in (4.05, 5.37))
    return np.column_stack([300.0 + radius * np.cos(angle), 330.0 + radius * np.sin(angle)])


@pytest.fixture(scope="module")
def drawn():
    nose = ring(300.0, 345.0, 28.0, 20.0)
    return inflate(place(drawing(eared(), two_eyes(y=270.0), (nose,), (SMILE,)), template()), template())


@pytest.fixture(scope="module")
def sheet(drawn):
    return drawn.mesh(2.0)


def lifted(*given):
    made = target_relief(*given)
    return made.relief, made.notes


def turned(mesh, rotation, scale=1.0):
    return mesh.with_vertices(scale * mesh.vertices @ rotation.T)


def about(axis, degrees):
    return trimesh.transformations.rotation_matrix(np.radians(degrees), axis)[:3, :3]


def thickened(sheet, wall_mm=3.0):
    """A closed double shell."""
    out = sheet.vertex_normals * wall_mm / 2
    count = len(sheet.vertices)
    directed = sheet.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    known = {tuple(edge) for edge in directed.tolist()}
    rim = np.array([edge for edge in directed.tolist() if tuple(edge[::-1]) not in known], dtype=np.int32)
    start, end = rim.T
    sides = [np.stack([end, start, start + count], 1), np.stack([end, start + count, end + count], 1)]
    faces = np.concatenate([sheet.faces, sheet.faces[:, ::-1] + np.int32(count), *sides]).astype(np.int32)
    return Mesh(np.vstack([sheet.vertices + out, sheet.vertices - out]), faces)


def plate(openings, width=160.0, height=190.0, depth=4.0):
    """A solid elliptic plate facing -y with round holes (x, z, radius)."""
    import manifold3d

    def loop(x, z, a, b):
        angle = np.linspace(0.0, 2.0 * np.pi, 90, endpoint=False)
        return np.column_stack([x + a * np.cos(angle), z + b * np.sin(angle)])

    shape = manifold3d.CrossSection([loop(0.0, 0.0, width / 2, height / 2)])
    for x, z, radius in openings:
        shape = shape - manifold3d.CrossSection([loop(x, z, radius, radius)])
    solid = shape.extrude(depth).to_mesh()
    points = np.array(solid.vert_properties[:, :3], dtype=np.float64)
    return Mesh(
        np.column_stack([points[:, 0], -points[:, 2], points[:, 1]]),
        np.array(solid.tri_verts, dtype=np.int32),
    )


EYE_HOLES = ((-32.0, 30.0, 15.0), (32.0, 30.0, 15.0))


def overlap(one: Relief, other: Relief):
    plane = Plane.around(np.vstack([one.outline, other.outline]), 0.5, 4.0)
    a, b = (solid_mask(relief.outline, relief.openings, plane) for relief in (one, other))
    x, z = plane.centres()
    return float((a & b).sum() / (a | b).sum()), np.column_stack([x[a & b], z[a & b]])


def differs(one: Relief, other: Relief):
    """Mean and root mean square (without the mean) of the difference in height, mm."""
    _, xz = overlap(one, other)
    difference = one.height_at(xz) + one.detail_at(xz) - other.height_at(xz) - other.detail_at(xz)
    return float(difference.mean()), float(difference.std())


def assert_sound(relief: Relief):
    """What the fit and print-prep rely on."""
    front = template().front
    x, z = relief.plane.centres()
    xz = np.column_stack([x.ravel(), z.ravel()])
    floor = front.at(np.where(np.isfinite(front.floor), front.floor, -1e3), xz).reshape(x.shape)
    assert np.isfinite(relief.height).all()
    assert (relief.height >= floor - 1e-6).all()
    assert relief.detail.min() >= 0.0
    assert relief.detail.max() <= 3.0
    assert (relief.plane.pixel_mm, relief.fine.pixel_mm) == (1.0, 0.25)
    assert len(relief.openings) == 2
    right, left = relief.openings
    assert right[:, 0].mean() < left[:, 0].mean()
    assert inside(np.vstack(relief.openings), [relief.outline]).all()


@pytest.fixture(scope="module")
def back(sheet):
    """The relief and the notes of the sheet in another scale, up axis and facing."""
    return lifted(turned(sheet, Y_UP_FACING_X, 0.01), template())


def test_a_relief_comes_back_from_another_scale_up_axis_and_facing(drawn, back):
    relief, notes = back
    assert_sound(relief)
    assert overlap(relief, drawn)[0] > 0.985
    mean, spread = differs(relief, drawn)
    assert spread < 0.6
    assert -2.5 < mean <= 0.5  # what does not touch comes nearer to the face
    assert "up is y, its front x" in notes[0]
    assert len(notes) == 1


def test_a_thick_relief_comes_back_too(drawn, sheet):
    relief, _ = lifted(turned(thickened(sheet), Y_UP_FACING_X, 0.01), template())
    assert overlap(relief, drawn)[0] > 0.97
    assert differs(relief, drawn)[1] < 0.8


@pytest.mark.parametrize("index", [1, 10, 15, 23])
def test_every_facing_is_understood(sheet, index):
    rotation = axis_rotations()[index]
    facing = faced(turned(sheet, rotation, 3.0), template())
    assert facing.pose.rotation @ rotation == pytest.approx(np.eye(3), abs=1e-6)


@pytest.mark.parametrize(("axis", "degrees"), [((1.0, 0.0, 0.0), -20.0), ((0.3, 1.0, 0.2), 20.0)])
def test_a_tilted_mask_is_levelled_by_its_eyes(drawn, sheet, axis, degrees):
    relief, _ = lifted(turned(sheet, about(axis, degrees)), template())
    assert overlap(relief, drawn)[0] > 0.97
    assert differs(relief, drawn)[1] < 1.0


def test_the_strokes_of_the_relief_stay_detail(drawn, back):
    relief, _ = back
    xz = overlap(relief, drawn)[1]
    beads, beside = drawn.detail_at(xz) > 0.9, drawn.detail_at(xz) < 0.01
    there = relief.detail_at(xz)
    assert (
        np.median(there[beads]) > 0.12
    )  # of 1.2 mm, sampled with edges of 2 mm, and low waves go into the sheet
    assert np.median(there[beside]) < 0.02


def test_the_settings_scale_and_shift(drawn, sheet):
    moved, _ = lifted(sheet, template(), PlacementSettings(scale=1.1, up_mm=3.0, left_mm=-2.0))
    assert np.ptp(moved.outline, axis=0) == pytest.approx(1.1 * np.ptp(drawn.outline, axis=0), rel=0.01)
    centres = [np.vstack(relief.openings).mean(0) for relief in (drawn, moved)]
    assert centres[1] - centres[0] == pytest.approx([-2.0, 3.0], abs=0.3)
    assert_sound(moved)


@pytest.fixture(scope="module")
def holed():
    """The relief and the notes of a plate with eye holes, a hole that is no eye, and a little one."""
    return lifted(plate((*EYE_HOLES, (0.0, -45.0, 14.0), (30.0, -20.0, 4.0))), template())


def test_a_plate_with_eye_holes_lies_with_them_over_the_eyes_and_stays_flat(holed):
    relief, notes = holed
    assert_sound(relief)
    for opening, eye in zip(relief.openings, ("eye_right", "eye_left"), strict=True):
        assert opening.mean(0) == pytest.approx(template().body.landmarks[eye][[0, 2]], abs=4.0)
    xz = overlap(relief, relief)[1]
    assert np.ptp(relief.height_at(xz)) < 3.0
    assert relief.detail_at(xz).max() < 0.1
    assert any("stands" in note for note in notes)


def test_a_hole_that_is_no_eye_is_closed_and_said(holed):
    relief, notes = holed
    assert_sound(relief)
    (closed,) = [note for note in notes if "closed" in note]
    assert "1, up to" in closed


def test_without_eye_holes_the_openings_are_the_template_s():
    relief, notes = lifted(plate(()), template())
    assert_sound(relief)
    assert all((a == b).all() for a, b in zip(relief.openings, template().openings, strict=True))
    assert any("template's own openings" in note for note in notes)


def test_a_sphere_becomes_a_round_mask_with_the_template_s_openings():
    sphere = trimesh.creation.icosphere(4, 3.0)
    relief, notes = lifted(Mesh(np.array(sphere.vertices), sphere.faces.astype(np.int32)), template())
    assert_sound(relief)
    width, height = np.ptp(relief.outline, axis=0)
    assert width == pytest.approx(height, rel=0.02)
    assert any("template's own openings" in note for note in notes)
    # deepest at the rim, not at the middle
    xz = overlap(relief, relief)[1]
    away = np.linalg.norm(xz - relief.outline.mean(0), axis=1) / (0.5 * width)
    assert relief.height_at(xz)[away < 0.2].mean() > relief.height_at(xz)[away > 0.8].mean() + 20.0


def test_the_back_of_a_helmet_is_not_seen_through_its_eyes():
    sphere = trimesh.creation.icosphere(4, 1.0)
    points = sphere.vertices * [88.0, 100.0, 115.0]
    centres = points[sphere.faces].mean(1)
    hole = np.zeros(len(centres), dtype=bool)
    for side in (-1.0, 1.0):
        hole |= (np.hypot((centres[:, 0] - side * 32.0) / 18.0, (centres[:, 2] - 15.0) / 12.0) < 1) & (
            centres[:, 1] < 0
        )
    relief, notes = lifted(Mesh(points, sphere.faces[~hole].astype(np.int32)), template())
    assert_sound(relief)
    assert not any("template's own openings" in note for note in notes)
    assert relief.height.min() > template().front.base.min() - 60.0


def test_pieces_apart_are_left_out_and_said(sheet, drawn):
    marble = trimesh.creation.icosphere(3, 12.0)
    piece = Mesh(marble.vertices + sheet.vertices.mean(0) + [110.0, 0.0, 80.0], marble.faces.astype(np.int32))
    relief, notes = lifted(concatenate([sheet, piece]), template())
    assert overlap(relief, drawn)[0] > 0.985
    assert any("apart was left out" in note for note in notes)


def test_a_coarse_mesh_will_do(drawn, sheet):
    import fast_simplification

    points, faces = fast_simplification.simplify(
        np.array(sheet.vertices), np.array(sheet.faces), target_count=1000
    )
    relief, _ = lifted(Mesh(points.astype(np.float64), faces.astype(np.int32)), template())
    assert overlap(relief, drawn)[0] > 0.95
    assert differs(relief, drawn)[1] < 1.5


def test_the_same_mesh_gives_the_same_relief(sheet, back):
    one, other = back[0], lifted(turned(sheet, Y_UP_FACING_X, 0.01), template())[0]
    assert one.height.tobytes() == other.height.tobytes()
    assert one.detail.tobytes() == other.detail.tobytes()
    assert one.outline.tobytes() == other.outline.tobytes()


def test_a_mesh_that_resembles_no_mask_is_refused():
    marble = trimesh.creation.icosphere(2, 3.0)
    two = [Mesh(marble.vertices + [x, 0.0, 0.0], marble.faces.astype(np.int32)) for x in (-100.0, 100.0)]
    with pytest.raises(InputError) as caught:
        target_relief(concatenate(two), template())
    assert caught.value.next_step


@pytest.mark.parametrize(
    "points",
    [np.zeros((3, 3)), np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])],
    ids=["a point", "a line"],
)
def test_a_mesh_without_a_surface_is_refused(points):
    with pytest.raises(InputError, match="surface"):
        target_relief(Mesh(points, np.array([[0, 1, 2]], dtype=np.int32)), template())


def test_a_mesh_without_faces_is_refused():
    with pytest.raises(InputError, match="no faces"):
        target_relief(Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32)), template())
