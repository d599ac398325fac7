"""Frames in which a drawing shows the whole object: along the finger, from the side, from above.

Each looks at a finished template: its box there is the box of the drawing, its bore stays the bore.
"""

import manifold3d
import numpy as np
from jaxtyping import Float64

from fabcraft.mesh import Mesh
from fabcraft.template.template import MotifFrame

_TURNS = 240
_WIDER = 0.6
"""A drawn ring's own hole is wider than the band's by this share of the wall: skin meets the band alone."""


def profile(
    mesh: Mesh,
    middle: Float64[np.ndarray, "3"],
    axis: Float64[np.ndarray, "3"],
    top: Float64[np.ndarray, "3"],
    wall_mm: float,
    reach_mm: float,
) -> MotifFrame:
    """A band seen along its axis, from where that points; the drawing goes through all of its width.

    middle : a point of the axis.  top : direction that is up in the picture, across the axis.  mm.
    """
    up = top - (top @ axis) * axis
    up = up / np.linalg.norm(up)
    right = np.cross(up, axis)
    away = mesh.vertices - middle
    flat = np.column_stack([away @ right, away @ up])
    lower, upper = flat.min(0), flat.max(0)
    centre = 0.5 * (lower + upper)
    ends = away @ axis
    origin = middle + centre[0] * right + centre[1] * up + float(ends.max()) * axis
    bore = _bore(flat, centre) + _WIDER * wall_mm
    turn = np.linspace(0.0, 2.0 * np.pi, _TURNS, endpoint=False)
    opening = bore[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    width, height = (upper - lower).tolist()
    depth = float(np.ptp(ends))
    return MotifFrame(
        "profile", origin, right, up, (width, height), reach_mm, openings=(opening,), depth_mm=depth
    )


def _bore(flat: Float64[np.ndarray, "N 2"], centre: Float64[np.ndarray, "2"]) -> Float64[np.ndarray, " T"]:
    """Radius of the hole round `centre` by direction; across the gap of a cuff it goes on evenly."""
    local = flat - centre
    radius, angle = np.hypot(*local.T), np.arctan2(local[:, 1], local[:, 0])
    sector = np.round(angle / (2.0 * np.pi) * _TURNS).astype(int) % _TURNS
    least = np.full(_TURNS, np.inf)
    np.minimum.at(least, sector, radius)
    known = np.flatnonzero(np.isfinite(least))
    return np.interp(np.arange(_TURNS), known, least[known], period=_TURNS)


def crest(mesh: Mesh, depth_mm: float, reach_mm: float) -> MotifFrame:
    """A shell seen from the wearer's left: the drawing stands upright on its middle, the hollow stays free."""
    lower, upper = mesh.bounds
    middle = 0.5 * (lower + upper)
    origin = np.array([0.5 * depth_mm, middle[1], middle[2]])
    size = (float(upper[1] - lower[1]), float(upper[2] - lower[2]))
    back, up = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    return MotifFrame(
        "crest", origin, back, up, size, reach_mm, depth_mm=depth_mm, free=_hollow(mesh, reach_mm)
    )


def _hollow(mesh: Mesh, below_mm: float) -> Mesh:
    """What is inside a shell that is open below, and straight down from there."""
    solid = manifold3d.Manifold(manifold3d.Mesh64(np.array(mesh.vertices), mesh.faces.astype(np.uint64)))
    hull = solid.hull()
    inner = max((hull - solid).decompose(), key=lambda one: one.volume())
    # the hull of the hollow, carried down: whoever wears it comes from there
    deep = manifold3d.Manifold.batch_hull([inner, inner.translate((0.0, 0.0, -below_mm))])
    found = (deep - solid).to_mesh64()
    return Mesh(found.vert_properties[:, :3].astype(np.float64), found.tri_verts.astype(np.int32), "hollow")


def sole(mesh: Mesh, ahead: Float64[np.ndarray, "3"], top_mm: float, reach_mm: float) -> MotifFrame:
    """A shoe seen from above, its toes up in the picture: the drawing is its sole, `top_mm` thick.

    ahead : horizontal direction of the toes.
    """
    up = ahead / np.linalg.norm(ahead)
    right = np.cross(up, [0.0, 0.0, 1.0])
    flat = np.column_stack([mesh.vertices @ right, mesh.vertices @ up])
    lower, upper = flat.min(0), flat.max(0)
    centre, ground = 0.5 * (lower + upper), float(mesh.bounds[0, 2])
    origin = centre[0] * right + centre[1] * up + (ground + top_mm) * np.array([0.0, 0.0, 1.0])
    width, height = (upper - lower).tolist()
    return MotifFrame("sole", origin, right, up, (width, height), reach_mm, depth_mm=top_mm)
