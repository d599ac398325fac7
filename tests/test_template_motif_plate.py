import numpy as np
import pytest
import trimesh
from worn import limb

from fabcraft.body.body import Body
from fabcraft.errors import InputError
from fabcraft.mesh import Mesh
from fabcraft.template.motif_plate import SIZE, THICKNESS, plate
from fabcraft.template.template import MotifFrame, Template

FRAME = MotifFrame(
    "bezel",
    np.array([0.0, -10.6, 0.0]),
    np.array([1.0, 0.0, 0.0]),
    np.array([0.0, 0.0, 1.0]),
    (14.0, 10.0),
    4.0,
)


def ring():
    shape = trimesh.creation.annulus(8.6, 10.6, 7.0, sections=96).subdivide()
    mesh = Mesh(np.array(shape.vertices), np.array(shape.faces, dtype=np.int32), "ring")
    finger = Body("finger", limb(8.0, 8.0), {}, {}, "human")
    return Template("ring", finger, mesh, (), None, 1.8, 1, (), 0.6, motifs=(FRAME,))


def test_the_plate_has_the_frames_proportions_at_the_size_of_a_mask():
    sheet, space = plate(ring(), FRAME)
    np.testing.assert_allclose(np.ptp(sheet.outline, axis=0), [SIZE, SIZE * 10 / 14], rtol=0.02)
    assert space.scale == pytest.approx(SIZE / 14.0)
    assert sheet.kind == "sheet" and len(sheet.rims) == 1


def test_the_plate_lies_on_the_ring_and_goes_on_beyond_it():
    sheet, _ = plate(ring(), FRAME)
    height = sheet.front.base_at(np.array([[0.0, 0.0], [0.0, 0.48 * SIZE]]))
    assert 0.5 * THICKNESS <= height[0] <= 1.2 * THICKNESS
    assert abs(height[1] - height[0]) < 6.0  # beyond the ring's rim it neither drops nor flies off
    known = np.isfinite(sheet.front.floor)
    assert (sheet.front.base[known] >= sheet.front.floor[known] - 1e-6).all()


def test_a_motif_that_has_no_room_is_refused():
    with pytest.raises(InputError, match=r"40 mm.*bezel of the ring"):
        plate(ring(), FRAME, 40.0)


def test_a_frame_beside_the_object_is_refused():
    beside = MotifFrame("bezel", np.array([90.0, 0.0, 0.0]), FRAME.right, FRAME.up, (14.0, 10.0), 4.0)
    with pytest.raises(InputError, match="nothing of the template"):
        plate(ring(), beside)
