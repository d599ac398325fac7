"""Labels: legible, of the depth asked, along the surface, and never through the wall."""

from dataclasses import replace

import numpy as np
import pytest
from plated import box, tube

from fabcraft.check.topology import inspect_topology
from fabcraft.errors import InputError
from fabcraft.mesh import Mesh
from fabcraft.profile import load_profile
from fabcraft.solid.label import label
from fabcraft.solid.letters import GLYPHS, outline, strokes, width_mm

MK4, FORM4 = load_profile("prusa-mk4"), load_profile("form4")


def underside(mesh: Mesh) -> np.ndarray:
    return mesh.face_normals[:, 2] < -0.9


def inside(mesh: Mesh) -> np.ndarray:
    middles = mesh.corners.mean(1)
    return (mesh.face_normals[:, :2] * middles[:, :2]).sum(1) < -0.9 * np.linalg.norm(middles[:, :2], axis=1)


def test_every_glyph_lies_on_its_grid_and_no_two_are_alike() -> None:
    for letter, drawn in GLYPHS.items():
        assert all(0 <= int(one) <= 6 for one in drawn.replace(" ", ""))
        assert all(len(stroke) % 2 == 0 for stroke in drawn.split()), letter
    shapes = [tuple(sorted(drawn.split())) for drawn in GLYPHS.values()]
    assert len(set(shapes)) == len(shapes)


def test_the_width_of_a_text_is_that_of_its_strokes() -> None:
    bounds = outline(strokes("NN", 6.0), 0.5).bounds()
    assert bounds[2] - bounds[0] == pytest.approx(width_mm("NN", 6.0) + 0.5, abs=0.05)
    assert bounds[3] - bounds[1] == pytest.approx(6.5, abs=0.05)


def test_the_underside_of_a_plate_is_engraved_to_the_depth() -> None:
    plate = box(70.0, 40.0, 3.0)
    made = label(plate, "m 42 l", MK4, underside(plate))
    assert made.done
    found = inspect_topology(made.mesh)
    assert (found.open_edges, found.parts, found.genus, found.self_intersections) == (0, 1, 0, 0)
    new = made.mesh.vertices[~(np.abs(made.mesh.vertices[:, 2]) > 1.49)]
    assert new[:, 2].max() == pytest.approx(-1.5 + MK4.min_engrave_mm, abs=0.01)
    area = outline(strokes("M 42 L", made.height_mm), made.height_mm / 8.0).area()
    assert plate.volume_mm3 - made.mesh.volume_mm3 == pytest.approx(area * MK4.min_engrave_mm, rel=0.03)
    assert made.wall_mm == pytest.approx(3.0 - MK4.min_engrave_mm, abs=0.01)


def test_a_text_reads_from_left_to_right_seen_from_outside() -> None:
    plate = box(40.0, 20.0, 4.0)
    made = label(plate, "L.", MK4, underside(plate))
    new = made.mesh.vertices[np.abs(made.mesh.vertices[:, 2] + 2.0 - MK4.min_engrave_mm) < 0.01]
    # the L's foot is the only long line along the text; seen from below, its stem is on the left of it
    middle = 0.5 * (new.min(0) + new.max(0))
    ends = new - middle
    along = np.array([1.0, 0.0]) if np.ptp(ends[:, 0]) > np.ptp(ends[:, 1]) else np.array([0.0, 1.0])
    up = np.array([-along[1], along[0]])
    stem = ends[np.abs(ends[:, :2] @ up) > 0.35 * np.ptp(ends[:, :2] @ up)]
    top = stem[np.argsort(np.abs(stem[:, :2] @ along))][-4:, :2].mean(0)
    dot_side = -np.sign(top @ along)  # the full stop is at the other end than the stem
    upwards = np.sign(_sparse_side(ends[:, :2] @ along * dot_side, ends[:, :2] @ up))
    # right x up = out of the face, which looks down
    right = along * dot_side
    out = right[0] * (up * upwards)[1] - right[1] * (up * upwards)[0]
    assert out < 0.0


def _sparse_side(along: np.ndarray, up: np.ndarray) -> float:
    """Which side the stem's free end is on: the foot and the full stop lie on the other."""
    right_end = along > 0.5 * along.max()
    return -float(up[right_end].mean())


def test_inside_a_ring_the_text_follows_the_curve() -> None:
    ring = tube(11.0, 9.0, 6.0)
    made = label(ring, "US 7", FORM4, inside(ring))
    assert made.done
    found = inspect_topology(made.mesh)
    assert (found.open_edges, found.parts, found.genus, found.self_intersections) == (0, 1, 1, 0)
    radius = np.linalg.norm(made.mesh.vertices[:, :2], axis=1)
    assert radius.max() <= 11.0 + 1e-6
    floor = radius[(radius > 9.05) & (radius < 10.9)]
    assert floor.max() == pytest.approx(9.0 + FORM4.min_engrave_mm, abs=0.06)
    assert made.wall_mm >= FORM4.min_wall_mm


def test_a_wall_too_thin_for_the_engraving_is_told_with_both_numbers() -> None:
    plate = box(70.0, 40.0, 1.4)
    made = label(plate, "42", MK4, underside(plate))
    assert not made.done
    assert made.mesh is plate
    assert "1.4 mm" in made.said and "1.5 mm" in made.said
    assert label(plate, "42", replace(MK4, min_wall_mm=0.8, min_wall_supported_mm=0.8), underside(plate)).done


def test_no_room_is_told() -> None:
    cube = box(5.0, 5.0, 5.0)
    made = label(cube, "A LONG LABEL", MK4, underside(cube))
    assert not made.done and "smooth enough" in made.said


@pytest.mark.parametrize("text", ["", "   ", "größe", "x" * 25])
def test_a_text_that_cannot_be_engraved_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="label"):
        label(box(70.0, 40.0, 3.0), text, MK4, underside(box(70.0, 40.0, 3.0)))
