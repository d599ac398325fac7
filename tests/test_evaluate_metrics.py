import numpy as np
import pytest
import tiny_clip
import trimesh

from fabcraft.evaluate.layers import bounds_of, layer_picture, read_layers
from fabcraft.evaluate.metrics import clip_metrics, fit_metrics, fixed_views, likeness_metrics, overlap
from fabcraft.evaluate.reference import Picture, Reference
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh, concatenate
from fabcraft.template.template import MotifFrame
from fabcraft.write.camera import View


def ball(radius, centre=(0.0, 0.0, 0.0), level=4):
    made = trimesh.creation.icosphere(level, radius)
    return Mesh(made.vertices + np.array(centre), made.faces.astype(np.int32), "ball")


def held_against(body, contacts=None, gaps=0.0, goal=None):
    return Reference(SurfaceDistance(body), contacts, gaps, goal or body)


def test_a_ball_inside_a_ball_is_as_deep_and_as_large_as_geometry_says():
    body = ball(20.0)
    found = fit_metrics(ball(5.0, (12.0, 0.0, 0.0)), held_against(body))
    assert found["pen_max_mm"] == pytest.approx(13.0, abs=0.05)
    assert found["pen_area_pct"] == 100.0
    assert found["pen_volume_mm3"] == pytest.approx(4.0 / 3.0 * np.pi * 5.0**3, rel=0.02)
    # depth over the small sphere: E[(20 - |p|)^2] with |p|^2 = 144 + 25 + 120 u, u even in -1..1
    u = (np.arange(20000) + 0.5) / 10000 - 1.0
    assert found["pen_rms_mm"] == pytest.approx(
        np.sqrt(((20 - np.sqrt(169 + 120 * u)) ** 2).mean()), rel=0.01
    )


def test_a_ball_half_inside_a_large_one_is_half_inside():
    found = fit_metrics(ball(1.0, (0.0, 0.0, 1000.0)), held_against(ball(1000.0, level=6)))
    assert found["pen_max_mm"] == pytest.approx(1.0, abs=0.2)
    clear = fit_metrics(ball(1.0, (0.0, 0.0, 1002.0)), held_against(ball(1000.0, level=6)))
    assert clear["pen_volume_mm3"] == clear["pen_area_pct"] == clear["pen_max_mm"] == clear["paper_Dp"] == 0.0


def test_the_papers_units_are_half_the_body_and_squared():
    body, small = ball(20.0), ball(5.0)
    contacts = np.array([[20.0, 0.0, 0.0]])
    found = fit_metrics(small, held_against(body, contacts))
    assert found["paper_Dc"] == pytest.approx((15.0 / 20.0) ** 2, rel=1e-3)
    assert found["paper_Dp"] == pytest.approx(len(small.vertices) * 0.75**2, rel=0.01)


def test_contacts_within_a_millimetre_are_counted_against_their_gaps():
    contacts = np.array([[10.5, 0.0, 0.0], [0.0, 12.0, 0.0], [0.0, 0.0, 13.0], [-10.0, 0.0, 0.0]])
    gaps = np.array([0.0, 0.0, 3.0, 0.0])
    found = fit_metrics(ball(10.0), held_against(ball(9.0), contacts, gaps))
    assert found["contact_within_1mm_pct"] == 75.0
    assert found["contact_p95_mm"] < 2.05
    assert "contact_rms_mm" not in fit_metrics(ball(10.0), held_against(ball(9.0)))


def test_likeness_is_perfect_to_itself_and_known_for_concentric_balls():
    same = likeness_metrics(ball(10.0, level=4), ball(10.0, level=4))
    assert same["silhouette_iou"] == 1.0 and same["chamfer_mm"] < 1e-6
    other = likeness_metrics(ball(10.0, level=4), ball(8.0, level=4))
    assert other["chamfer_mm"] == pytest.approx(2.0, abs=0.03)
    assert other["silhouette_iou"] == pytest.approx(0.64, abs=0.01)


def test_the_views_are_24_and_what_is_apart_does_not_overlap():
    assert len(set(fixed_views())) == 24

    def seen_from_the_front(away):
        pair = ball(1.0, level=3), ball(1.0, away, 3)
        return overlap(*pair, Picture.whole(View(0.0), *pair))

    assert seen_from_the_front((5.0, 0.0, 0.0)) == 0.0
    assert seen_from_the_front((0.0, 5.0, 0.0)) == 1.0


def frame(size_mm, reach_mm=0.0, origin=(0.0, 0.0, 0.0)):
    return MotifFrame(
        "front", np.array(origin), np.array([1.0, 0, 0]), np.array([0.0, 0, 1.0]), size_mm, reach_mm
    )


def test_the_drawings_picture_sees_the_design_and_nothing_beside_it():
    # a temple that another wearer's ear asks for: 40 mm behind the picture, and one beside it
    alike, other = ball(10.0), ball(10.0)
    mesh = concatenate([alike, ball(3.0, (0.0, 40.0, 0.0)), ball(5.0, (30.0, 0.0, 0.0))], "worn")
    inside = likeness_metrics(mesh, other, Picture.within(frame((20.0, 20.0), 2.0)))
    assert inside["drawing_iou"] == 1.0 and inside["silhouette_iou"] < 0.9
    # with a reach up to the one beside it, that counts too: 100 pi / 125 pi
    wider = likeness_metrics(mesh, other, Picture.within(frame((20.0, 20.0), 30.0)))
    assert wider["drawing_iou"] == pytest.approx(100.0 / 125.0, abs=0.02)


def test_the_drawings_picture_is_cut_where_a_drawing_may_reach():
    # the left half of two balls, one of which stands 20 mm to the right
    cut = Picture.within(frame((4.0, 20.0), 3.0, (-5.0, 0.0, 0.0)))
    assert cut.size_mm == pytest.approx([10.0, 26.0])
    assert overlap(ball(10.0), concatenate([ball(10.0), ball(5.0, (20.0, 0.0, 0.0))], "two"), cut) == 1.0


def test_a_picture_with_nothing_in_it_is_not_measured():
    far = Picture.within(frame((4.0, 4.0), 0.0, (500.0, 0.0, 0.0)))
    assert set(likeness_metrics(ball(10.0), ball(10.0), far)) == {"silhouette_iou", "chamfer_mm"}


def test_the_score_of_an_encoder_is_a_cosine_and_repeats(tmp_path):
    from fabcraft.guidance.clip import load_clip

    model = load_clip(tiny_clip.save(tmp_path))
    found = [clip_metrics(ball(3.0, (100.0, 0.0, 0.0), 2), "a ball", model) for _ in range(2)]
    assert found[0] == found[1]
    assert -1.0 <= found[0]["clip_cos"] <= 1.0 and found[0]["clip_cos_std"] >= 0.0
    # where it stands and how large it is does not matter
    moved = clip_metrics(ball(30.0, (0.0, 7.0, 0.0), 2), "a ball", model)
    assert moved["clip_cos"] == pytest.approx(found[0]["clip_cos"], abs=1e-3)


GCODE = """M82
G92 E0
;TYPE:Skirt/Brim
G1 X0 Y0 Z0.2
G1 X99 Y0 E1
;TYPE:External perimeter
G1 X10 Y10
G1 X20 Y10 E2
G1 X20 Y30 E3
;TYPE:Support material
G1 X20 Y40 E4
G1 E3 ; pulled back
G1 Z0.4
G1 X0 Y0
G92 E0
;TYPE:Solid infill
G1 X5 Y0 E1
"""


def test_layers_are_what_the_moves_lay_down():
    layers = read_layers(GCODE.splitlines())
    assert [layer.z_mm for layer in layers] == [0.2, 0.4]
    assert layers[0].moves == (
        (10.0, 10.0, 20.0, 10.0, "perimeter"),
        (20.0, 10.0, 20.0, 30.0, "perimeter"),
        (20.0, 30.0, 20.0, 40.0, "support"),
    )
    assert layers[1].moves == ((0.0, 0.0, 5.0, 0.0, "infill"),)
    relative = GCODE.replace("M82", "M83").replace("E2", "E1").replace("E3 ;", "E-1 ;")
    assert [layer.z_mm for layer in read_layers(relative.splitlines())] == [0.2, 0.4]
    assert bounds_of(layers) == (0.0, 0.0, 20.0, 30.0)
    picture = layer_picture(layers[0], bounds_of(layers), (120, 160), 0.45)
    assert picture.shape == (160, 120, 3) and len(np.unique(picture.reshape(-1, 3), axis=0)) > 3
