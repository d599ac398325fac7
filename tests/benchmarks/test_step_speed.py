"""A whole step of the lifted mask fit at the `draft` preset, and where its time goes."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from measure import Row, take_turns

from fabcraft.body.human import human
from fabcraft.fit import lift
from fabcraft.fit.descend import Descent, State, Variables, descend, rest_restriction
from fabcraft.fit.optimize import PRESETS
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.triangulate import triangulate
from fabcraft.guidance.inflate import inflate
from fabcraft.guidance.placement import PlacedDrawing
from fabcraft.mesh import Mesh
from fabcraft.template.mask import mask

PARTS = {
    "render": ("depth", "normal", "silhouette"),
    "body": ("penetration", "contact"),
    "other losses": ("chamfer", "rim", "jacobian", "smoothness", "collapse", "consistency", "ripple"),
}
STEPS = 20


def worn_mask():
    """The template of a man's mask, the distance to his head, and the relief of a plain drawn shape."""
    template = mask(human("man"))
    middle = 0.5 * (template.outline.min(0) + template.outline.max(0))
    angle = np.linspace(-np.pi / 2, 1.5 * np.pi, 900, endpoint=False)
    outline = middle + np.stack([75 * np.cos(angle), 90 * np.sin(angle)], 1)
    drawn = PlacedDrawing(outline, template.openings, (), (), 2.0, 0.2, False, ())
    return template, SurfaceDistance(template.body.mesh), inflate(drawn, template)


@pytest.fixture(scope="module")
def worn():
    return worn_mask()


def sheet_of(template, faces):
    """The template's own outline and openings, triangulated finer until there are about that many faces."""
    edge_mm = template.edge_mm
    for _ in range(4):
        rims = [template.outline, *template.openings]
        flat = triangulate(rims, edge_mm)
        edge_mm *= np.sqrt(len(flat.faces) / faces)
    height = template.front.base_at(flat.points)
    return Mesh(np.column_stack([flat.points[:, 0], -height, flat.points[:, 1]]), flat.faces), flat.loops


def problem(worn, faces, monkeypatch):
    """System and terms of the fit, as it hands them to its optimiser."""
    template, distance, relief = worn
    sheet, loops = sheet_of(template, faces)
    caught = {}

    class Caught(Exception):  # noqa: N818
        pass

    def catch(system, terms, *_):
        caught.update(system=system, terms=terms)
        raise Caught

    monkeypatch.setattr(lift, "descend", catch)
    with pytest.raises(Caught):
        lift.fit_lifted(
            sheet, loops, lift.LiftTargets(relief, distance, template), STEPS, PRESETS["draft"].pixels
        )
    return caught["system"], caught["terms"]


@pytest.mark.parametrize(("faces", "aim"), [(6000, ""), (10000, "<= 30 ms")])
def test_a_draft_step(rows, worn, faces, aim, monkeypatch):
    system, terms = problem(worn, faces, monkeypatch)
    count = len(system.faces)
    start = Variables.rest(count, 3)
    restricted = rest_restriction(system, 3).requires_grad_(True)
    positions = system.vertices_of_restricted(restricted).detach().requires_grad_(True)
    offset = torch.zeros_like(restricted).requires_grad_(True)
    adam = torch.optim.Adam([offset])
    names = {term.name for term in terms}
    assert names <= {name for part in PARTS.values() for name in part}

    def poisson():
        system.vertices_of_restricted(restricted).backward(torch.ones_like(positions))

    def moment():
        offset.grad = restricted.detach()
        adam.step()

    def losses(part):
        chosen = [term for term in terms if term.name in PARTS[part]]
        state = State(system, positions, restricted, 0)
        # matched points are looked up in every tenth step only
        sum(term.function(state) for term in chosen).backward()

        def function():
            state = State(system, positions.detach().requires_grad_(True), restricted, 1)
            torch.stack([term.weight * term.function(state) for term in chosen]).sum().backward()

        return function

    def whole():
        descend(system, terms, replace(Descent(STEPS, 1.2e-2, 4e-3, final_share=0.08), still=0.0), start)

    before = torch.are_deterministic_algorithms_enabled()
    torch.use_deterministic_algorithms(True)  # as in a run
    try:
        parts = {part: losses(part) for part in PARTS} | {"Poisson": poisson, "Adam": moment}
        times = take_turns({"whole": whole, **parts}, rounds=7, warm=1)
    finally:
        torch.use_deterministic_algorithms(before)
    step = times["whole"].ms / STEPS
    note = f"draft preset, one view of {PRESETS['draft'].pixels} px; CPU {times['whole'].cpu / STEPS:.1f} ms"
    rows.append(Row(f"step of the lifted fit, {count} faces", None, aim, ours_ms=step, note=note))
    for part in parts:
        rows.append(Row(f"  of which {part}", times[part].ms / step, "", "whole step", times[part].ms, step))
    rest = step - sum(times[part].ms for part in parts)
    rows.append(Row("  of which the loop itself", rest / step, "", "whole step", rest, step))
