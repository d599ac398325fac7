"""Counts on shapes whose topology is known, and on planted defects."""

import numpy as np
import pytest
import trimesh

from fabcraft.check.topology import inspect_topology, topology_findings
from fabcraft.mesh import Mesh, concatenate


def mesh_of(shape) -> Mesh:
    return Mesh(np.array(shape.vertices), np.array(shape.faces).astype(np.int32))


def moved(mesh: Mesh, *by: float) -> Mesh:
    return mesh.with_vertices(mesh.vertices + np.array(by))


def severities(mesh: Mesh) -> dict[str, str]:
    return {finding.check: finding.severity for finding in topology_findings(inspect_topology(mesh))}


@pytest.fixture(scope="module")
def box() -> Mesh:
    return mesh_of(trimesh.creation.box((10, 10, 10)))


@pytest.fixture(scope="module")
def torus() -> Mesh:
    return mesh_of(trimesh.creation.torus(30, 5, major_sections=40, minor_sections=20))


def test_a_box_is_one_closed_part_of_genus_zero(box):
    found = inspect_topology(box)
    assert (found.parts, found.genus, found.open_edges, found.facets_reversed) == (1, 0, 0, 0)
    assert found.manifold_status == "NoError"
    assert found.closed and found.solid
    assert not found.problem_faces.any()
    assert topology_findings(found) == []


def test_tori_have_one_handle_each(torus):
    assert inspect_topology(torus).genus == 1
    both = inspect_topology(concatenate([torus, moved(torus, 100, 0, 0)]))
    assert (both.parts, both.genus) == (2, 2)


def test_triangles_without_shared_vertices_are_joined_where_they_meet(box):
    soup = Mesh(box.corners.reshape(-1, 3), np.arange(36, dtype=np.int32).reshape(-1, 3))
    found = inspect_topology(soup)
    assert (found.open_edges, found.parts, found.genus) == (0, 1, 0)


def test_a_missing_face_leaves_three_open_edges_and_says_where(box):
    found = inspect_topology(box.submesh(np.arange(1, 12)))
    assert found.open_edges == 3
    assert found.genus is None
    finding = topology_findings(found)[0]
    assert (finding.check, finding.severity, finding.value) == ("open_edges", "fail", 3)
    gap = box.corners[0]
    assert gap.min() <= min(finding.where[0]) and max(finding.where[0]) <= gap.max()
    assert found.problem_faces.sum() == 3


def test_two_holes_are_two_places_the_longer_first(torus):
    keep = np.ones(len(torus.faces), dtype=bool)
    keep[[0, 400, 401]] = False
    found = inspect_topology(torus.submesh(keep))
    assert len(found.open_places) == 2
    assert found.parts == 1


def test_a_flipped_facet_is_found(box):
    faces = box.faces.copy()
    faces[3] = faces[3][::-1]
    found = inspect_topology(Mesh(box.vertices, faces))
    assert (found.facets_reversed, found.open_edges) == (1, 0)
    assert np.flatnonzero(found.problem_faces).tolist() == [3]
    assert not found.solid


def test_most_facets_flipped_are_the_wrong_ones_all_the_same(torus):
    faces = torus.faces.copy()
    faces[:1200] = faces[:1200, ::-1]
    assert inspect_topology(Mesh(torus.vertices, faces)).facets_reversed == 1200


def test_an_inside_out_box_is_all_reversed(box):
    assert inspect_topology(Mesh(box.vertices, box.faces[:, ::-1])).facets_reversed == 12


def test_a_hollow_that_looks_inward_is_a_cavity_not_an_error(box):
    found = inspect_topology(concatenate([box, Mesh(box.vertices / 2, box.faces[:, ::-1])]))
    assert (found.cavities, found.facets_reversed, found.parts) == (1, 0, 2)
    assert found.solid
    assert severities(concatenate([box, Mesh(box.vertices / 2, box.faces[:, ::-1])])) == {"cavities": "warn"}


def test_boxes_that_run_through_each_other_are_found(box):
    both = concatenate([box, moved(box, 5.1, 5.2, 5.3)])
    found = inspect_topology(both)
    assert found.self_intersections is not None and found.self_intersections > 0
    assert found.crossing_area_mm2 > 1
    assert severities(both)["self_intersections"] == "fail"


def test_boxes_that_share_an_edge_touch_but_keep_an_inside(box):
    found = inspect_topology(concatenate([box, moved(box, 10, 10, 0)]))
    assert (found.touching_edges, found.branching_edges, found.parts) == (1, 0, 2)
    assert found.genus is None
    assert severities(concatenate([box, moved(box, 10, 10, 0)]))["touching_edges"] == "warn"


def test_boxes_that_share_a_corner_keep_their_genus(box):
    found = inspect_topology(concatenate([box, moved(box, 10, 10, 10)]))
    assert (found.parts, found.genus) == (2, 0)


def test_a_fin_on_an_edge_is_not_manifold(box):
    tip = len(box.vertices)
    fin = np.array([[box.faces[0][0], box.faces[0][1], tip]], dtype=np.int32)
    both = Mesh(np.concatenate([box.vertices, [[30.0, 30, 30]]]), np.concatenate([box.faces, fin]))
    found = inspect_topology(both)
    assert (found.branching_edges, found.open_edges) == (1, 2)
    assert severities(both)["non_manifold_edges"] == "fail"


def test_faces_without_area_are_counted_and_change_nothing_else(box):
    flat = np.concatenate([box.faces, [[0, 0, 1]]]).astype(np.int32)
    found = inspect_topology(Mesh(box.vertices, flat))
    assert (found.degenerate_faces, found.parts, found.genus, found.open_edges) == (1, 1, 0, 0)
    assert found.part_of_face[-1] == -1


def test_a_mesh_without_faces_fails():
    empty = Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32))
    assert severities(empty) == {"faces": "fail"}


def test_parts_are_held_against_how_many_there_are_to_be(box):
    two = inspect_topology(concatenate([box, moved(box, 20, 0, 0)]))
    found = {parts: [one.severity for one in topology_findings(two, parts)] for parts in (1, 2, 3)}
    assert found == {1: ["note"], 2: [], 3: ["warn"]}
