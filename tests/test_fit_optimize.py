import numpy as np
import pytest

from fabcraft.body.human import human
from fabcraft.errors import InputError
from fabcraft.fit.descend import Stop
from fabcraft.fit.optimize import FitSettings, fit, sheet_clearance
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.operators import boundary_loops
from fabcraft.guidance.inflate import inflate
from fabcraft.guidance.placement import PlacedDrawing
from fabcraft.template.mask import mask

SETTINGS = FitSettings(flat_steps=60, lifted_steps=60, pixels=160)


@pytest.fixture(scope="module")
def worn():
    template = mask(human("woman"))
    return template, SurfaceDistance(template.body.mesh)


def placed(template, ears=0.7):
    middle = 0.5 * (template.outline.min(0) + template.outline.max(0))
    angle = np.linspace(-np.pi / 2, 1.5 * np.pi, 900, endpoint=False)
    bumps = sum(np.exp(-(((angle - at) / 0.2) ** 2)) for at in (np.pi / 3.2, np.pi * (1 - 1 / 3.2)))
    outline = middle + np.stack([70 * np.cos(angle), 85 * np.sin(angle)], 1) * (1 + ears * bumps)[:, None]
    return PlacedDrawing(outline, template.openings, (), (), 2.0, 0.2, False, ())


@pytest.fixture(scope="module")
def design(worn):
    template, distance = worn
    return fit(template, inflate(placed(template), template), SETTINGS, distance)


def test_the_sheet_takes_the_reliefs_height_inside(design):
    points = design.mesh.vertices
    inner = design.relief.room_at(points[:, [0, 2]]) > 6.0
    error = -points[inner, 1] - design.relief.height_at(points[inner][:, [0, 2]])
    assert np.abs(error).mean() < 0.2 and np.abs(error).max() < 1.5


def test_the_sheet_keeps_its_clearance_exactly(worn, design):
    template, distance = worn
    points = np.concatenate([design.mesh.vertices, design.mesh.vertices[design.mesh.faces].mean(1)])
    assert (distance.signed(points) - sheet_clearance(template, points)).min() > -0.15
    assert distance.signed(points).min() > 0.5 * template.wall_mm


def test_topology_is_kept_and_faces_look_at_the_viewer(design):
    assert [len(loop) > 10 for loop in boundary_loops(design.mesh.faces)] == [True] * 3
    assert (design.mesh.face_normals[:, 1] < 0).all()


def test_history_stages_and_baseline_tell_how_it_came_about(design):
    assert design.stopped in (Stop.STEPS, Stop.STILL)
    assert {"flat.contour", "flat.silhouette", "lifted.depth", "lifted.penetration", "lifted.contact"} <= set(
        design.history
    )
    assert design.stages[0][0] == "template" and design.stages[-1][0] == "settled"
    assert len(design.direct.faces) > 1000


def test_an_interrupt_in_either_stage_still_gives_a_design(worn):
    template, distance = worn

    def stop_at(name):
        def watch(stage, step, steps, sheet):
            if stage == name and step >= 5:
                raise KeyboardInterrupt

        return watch

    relief = inflate(placed(template), template)
    for stage in ("outline", "relief"):
        stopped = fit(template, relief, SETTINGS, distance, stop_at(stage))
        assert stopped.stopped is Stop.INTERRUPTED
        assert distance.signed(stopped.mesh.vertices).min() > 0.0


@pytest.mark.parametrize("wrong", [{"flat_steps": 0}, {"lifted_steps": -1}, {"pixels": 8}])
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(InputError):
        FitSettings(**wrong)
