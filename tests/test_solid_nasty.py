"""A choice of the nasty meshes at one wall; all of them, at three, are measured by benchmarks/solid_table.py."""

import numpy as np
import pytest
from nasty import all_nasty, box, soup, t_junctions, torus

from fabcraft.check.thickness import measure_thickness
from fabcraft.check.topology import inspect_topology
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.solid.patches import Kind, pieces
from fabcraft.solid.repair import repair
from fabcraft.solid.stitch import without_t_junctions
from fabcraft.solid.thicken import SolidSettings, solidify

WALL_MM = 1.2
CHOSEN = (
    "T-junctions", "boxes on one face", "an inner wall", "a fin on an edge", "flat on itself", "gap 0.3", "slot 0.3",
    "knife edge", "thin ring", "crumbs", "soup, noise 0.02", "hook",
)  # fmt: skip


@pytest.mark.parametrize("name", CHOSEN)
def test_what_is_nasty_becomes_sound_and_keeps_what_it_has_to(name):
    case = all_nasty()[name]()
    made = solidify(case.mesh, SolidSettings(wall_mm=WALL_MM)).mesh
    state = inspect_topology(made)
    assert state.solid and state.self_intersections == 0 and state.manifold_status == "NoError"
    assert case.parts is None or state.parts == case.parts
    assert case.genus is None or state.genus == case.genus
    assert measure_thickness(made, 0.97 * WALL_MM).ok_share > 0.995
    surface = SurfaceDistance(made)
    assert not case.empty or not surface.inside(np.array(case.empty)).any()
    assert not case.full or surface.inside(np.array(case.full)).all()
    if case.truth is not None:
        thick = measure_thickness(case.truth, 1.3 * WALL_MM)
        off = surface.closest(thick.points[~thick.thin]).distances
        assert np.percentile(off, 99) <= 0.05 and off.max() <= 0.1


def test_corners_on_a_neighbours_edge_are_put_into_it():
    closed, put_in = without_t_junctions(repair(t_junctions()).mesh)
    assert put_in == 0 and inspect_topology(closed).open_edges == 0
    assert closed.area_mm2 == pytest.approx(6 * 400, rel=1e-9)
    assert without_t_junctions(box(20, 20, 20))[1] == 0


def test_soup_with_noise_is_welded_into_one_closed_surface():
    mended = repair(soup(torus(), 0.02)).mesh
    state = inspect_topology(mended)
    assert (state.open_edges, state.parts, state.genus) == (0, 1, 1)
    assert SurfaceDistance(torus()).closest(mended.vertices).distances.max() < 0.06


def test_a_fin_is_a_sheet_and_its_block_a_solid():
    found = pieces(all_nasty()["a fin on an edge"]().mesh, WALL_MM)
    assert [(piece.kind, len(piece.mesh.faces)) for piece in found] == [(Kind.SOLID, 12), (Kind.SHEET, 2)]
