"""Plain solid templates on real bodies, built once, and what every one of them has to keep."""

from functools import cache

import numpy as np
from scipy.spatial import ConvexHull

from fabcraft.body.body import Body
from fabcraft.check.thickness import measure_thickness
from fabcraft.check.topology import inspect_topology
from fabcraft.check.wear import Donning, measure_path
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.passage import passage
from fabcraft.mesh import Mesh
from fabcraft.template.kinds import kind_of
from fabcraft.template.template import Template
from fabcraft.wearer import find_body

ROUND_MM = 0.5
"""Least radius of an edge that meets skin."""


@cache
def wearer(name: str) -> Body:
    return find_body(name)


@cache
def built(kind: str, body: str, **settings: float | str) -> Template:
    return kind_of(kind).build(wearer(body), settings)


@cache
def skin(kind: str, body: str, **settings: float | str) -> SurfaceDistance:
    return SurfaceDistance(built(kind, body, **settings).body.mesh)


def taken_off(template: Template, mesh: Mesh) -> Donning:
    """Another mesh in the template's place, taken off along its path."""
    path = template.path
    return measure_path(
        mesh, SurfaceDistance(path.through or template.body.mesh), path.poses, path.allowed_mm
    )


def pressed_mm(template: Template) -> float:
    """How deep it presses on its way off."""
    passed = SurfaceDistance(template.path.through or template.body.mesh)
    return float(passage(_some(template), template.path.poses, passed).depth_mm.max())


def assert_comes_off(template: Template) -> None:
    """Nothing presses deeper than its path allows, and the path ends off the body."""
    poses = template.path.poses
    assert len(poses) >= 30
    np.testing.assert_allclose(poses[0], np.eye(4), atol=1e-9)
    assert pressed_mm(template) <= template.path.allowed_mm
    away = _some(template) @ poses[-1, :3, :3].T + poses[-1, :3, 3]
    assert SurfaceDistance(template.path.through or template.body.mesh).signed(away).min() > 0.0


def _some(template: Template) -> np.ndarray:
    """Vertices spread over the object."""
    return template.mesh.vertices[:: max(1, len(template.mesh.vertices) // 800)]


def assert_walled(template: Template) -> None:
    """Nowhere thinner than listed, less 5 %."""
    least = 0.95 * template.wall_mm
    assert measure_thickness(template.mesh, least, limit_mm=1.2 * template.wall_mm).min_mm >= least


def assert_sound(template: Template) -> None:
    """Closed, of the expected genus, crossing itself nowhere, in triangles of the listed size."""
    found = inspect_topology(template.mesh)
    assert found.solid and found.parts == template.parts and found.genus == template.genus
    assert not found.self_intersections
    corners = template.mesh.corners
    lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    assert 0.7 * template.edge_mm < np.median(lengths) < 1.3 * template.edge_mm


def assert_seated(template: Template, surface: SurfaceDistance) -> None:
    """Nowhere nearer to the skin than listed."""
    nearest = float(surface.signed(template.mesh.vertices).min())
    assert nearest > max(0.0, template.listed_mm[0] - 0.05)


def assert_frames_look_outward(template: Template, surface: SurfaceDistance) -> None:
    """Every picture plane lies before the object, upright and square, and looks away from object and wearer."""
    own = SurfaceDistance(template.mesh)
    assert template.motifs
    for frame in (one for one in template.motifs if one.reading == "motif"):
        np.testing.assert_allclose(np.stack([frame.right, frame.up]) @ frame.right, [1.0, 0.0], atol=1e-9)
        assert abs(np.linalg.norm(frame.up) - 1.0) < 1e-9 and min(frame.size_mm) > 0.0 < frame.reach_mm
        before = frame.origin + np.array([[0.0], [1.0], [3.0]]) * frame.outward
        assert -0.5 * template.wall_mm < own.signed(before[:1])[0] < 0.5 * max(frame.size_mm)
        assert (np.diff(own.signed(before)) > 0.0).all() and (np.diff(surface.signed(before)) > 0.0).all()


def sharpest_mm(template: Template, within_mm: float, surface: SurfaceDistance) -> float:
    """Least radius over which the object is bent outward where it is that near to the skin.

    A row of facets, `h` broad, that turns by t from one to the next lies on a circle of radius h / (2 tan(t / 2)).
    """
    mesh = template.mesh
    normals, areas = mesh.face_normals, mesh.face_areas
    ends = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(ends.T)
    pairs, owner = ends[order][::2], (order // 3).reshape(-1, 2)
    near = surface.signed(mesh.vertices[pairs].mean(1)) < within_mm
    pairs, owner = pairs[near], owner[near]
    towards = mesh.corners[owner[:, 1]].mean(1) - mesh.corners[owner[:, 0]].mean(1)
    convex = np.einsum("ij,ij->i", normals[owner[:, 0]], towards) < 0.0
    turn = np.arccos(np.clip(np.einsum("ij,ij->i", normals[owner[:, 0]], normals[owner[:, 1]]), -1.0, 1.0))
    across = areas[owner].sum(1) / np.linalg.norm(np.diff(mesh.vertices[pairs], axis=1)[:, 0], axis=1)
    bent = convex & (turn > np.radians(10.0))
    return float((across[bent] / (2.0 * np.tan(0.5 * turn[bent]))).min(initial=np.inf))


def inner_girth_mm(template: Template, axis: np.ndarray) -> float:
    """Round the middle of a band's inner side, mm."""
    inner = template.mesh.vertices[np.unique(template.mesh.faces[template.locked])]
    along = inner @ axis
    middle = 0.5 * (along.min() + along.max())
    points = inner[np.abs(along - middle) < 0.1 * np.ptp(along)]
    basis = np.linalg.svd(axis[None])[2][1:]
    hull = ConvexHull(points @ basis.T)
    return float(hull.area)  # of a plane hull, its circumference


def narrowed(mesh: Mesh, axis: np.ndarray, share: float) -> Mesh:
    """The mesh made smaller square to the axis through its middle."""
    away = mesh.vertices - mesh.vertices.mean(0)
    along = np.outer(away @ axis, axis)
    return mesh.with_vertices(mesh.vertices.mean(0) + along + share * (away - along))
