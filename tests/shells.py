"""Helmets, visors and slippers, built once for many tests."""

from functools import cache

import numpy as np

from fabcraft.body.body import Body
from fabcraft.check.thickness import measure_thickness
from fabcraft.check.topology import inspect_topology
from fabcraft.check.wear import measure_path
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh
from fabcraft.template.kinds import kind_of
from fabcraft.template.template import Template
from fabcraft.wearer import find_body

SLACK_MM = 0.05
"""What a clearance may fall short of its list, as `try_on` allows."""


@cache
def wearer(name: str) -> Body:
    return find_body(name)


@cache
def built(kind: str, body: str, **settings: float | str) -> Template:
    return kind_of(kind).build(wearer(body), settings)


@cache
def skin(kind: str, body: str) -> SurfaceDistance:
    return SurfaceDistance(built(kind, body).body.mesh)


def assert_clean_solid(template: Template) -> None:
    """Closed, of the promised genus, no face through another, about as even as promised."""
    found = inspect_topology(template.mesh)
    assert found.solid
    assert found.genus == template.genus
    assert found.self_intersections == 0
    edges = np.linalg.norm(template.mesh.corners - np.roll(template.mesh.corners, 1, axis=1), axis=2)
    assert 0.6 * template.edge_mm < edges.mean() < 1.1 * template.edge_mm


def assert_fits(kind: str, body: str) -> None:
    """Off the skin by what is listed, a wall as thick as listed, and off the body without pressing."""
    template = built(kind, body)
    signed = skin(kind, body).signed(template.mesh.vertices)
    assert signed.min() > 0.0
    assert signed.min() > template.listed_mm[0] - SLACK_MM
    assert signed.min() < template.listed_mm[0] + 0.6  # it touches somewhere
    thickness = measure_thickness(template.mesh, 0.95 * template.wall_mm, limit_mm=1.2 * template.wall_mm)
    assert thickness.min_mm > 0.95 * template.wall_mm
    donning = measure_path(template.mesh, skin(kind, body), template.path.poses, template.path.allowed_mm)
    assert donning.poses >= 30
    assert donning.donnable


def assert_mirrored(mesh: Mesh) -> None:
    """Every vertex has its mirror image at -x."""
    places = {tuple(row) for row in np.round(mesh.vertices + 0.0, 6)}
    assert {(0.0 - x, y, z) for x, y, z in places} == places


def assert_motifs_outside(template: Template, *names: str) -> None:
    """Frames of these names, right-handed, on the outer surface, facing away from the body."""
    frames = [frame for frame in template.motifs if frame.reading == "motif"]
    assert tuple(frame.name for frame in frames) == names
    surface = SurfaceDistance(template.mesh)
    for motif in frames:
        axes = np.stack([motif.right, motif.up, motif.outward])
        assert np.abs(axes @ axes.T - np.eye(3)).max() < 1e-6
        assert abs(surface.signed(motif.origin[None])[0]) < 0.15 * template.wall_mm
        before = motif.origin + 2.0 * template.wall_mm * motif.outward
        behind = motif.origin - 0.5 * template.wall_mm * motif.outward
        assert surface.signed(before[None])[0] > 0.0
        assert surface.signed(behind[None])[0] < 0.0
