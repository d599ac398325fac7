"""Frames in which a drawing shows the whole object: along the finger, from the side, from above.

Each looks at a finished template: its box there is the box of the drawing, its bore stays the bore.
"""

import manifold3d
import numpy as np
from jaxtyping import Bool, Float64
from scipy.ndimage import gaussian_filter1d, minimum_filter1d

from fabcraft.mesh import Mesh
from fabcraft.template.template import MotifFrame

PROUD_MM = 0.3
"""How far a drawn object stands out of the template's flat sides: faces in one plane would leave slivers."""
_TURNS, _SECTORS = 240, 11
_OVER, _UPRIGHT = 1.0, 0.8
"""Length of a crest over the shell's, and its height over its length."""
_BESIDE = np.array([1.5, 1.06])
"""Width and length of a drawn sole over the shoe's."""
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
    origin = middle + centre[0] * right + centre[1] * up + (float(ends.max()) + PROUD_MM) * axis
    bore = _bore(flat, centre) + _WIDER * wall_mm
    turn = np.linspace(0.0, 2.0 * np.pi, _TURNS, endpoint=False)
    opening = bore[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    width, height = (upper - lower).tolist()
    depth = float(np.ptp(ends)) + 2.0 * PROUD_MM
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
    # edges are longer than a sector is wide: the least of its neighbours, and no steps between
    least = minimum_filter1d(least, _SECTORS, mode="wrap")
    known = np.flatnonzero(np.isfinite(least))
    even = np.interp(np.arange(_TURNS), known, least[known], period=_TURNS)
    return gaussian_filter1d(even, 0.5 * _SECTORS, mode="wrap")


def crest(mesh: Mesh, inside: Bool[np.ndarray, " F"], depth_mm: float, reach_mm: float) -> MotifFrame:
    """A shell seen from the wearer's left: the drawing stands upright on its middle, from rim to rim and over the crown.

    inside : its faces towards the head; what they enclose, and what is below, stays free.
    """
    lower, upper = mesh.bounds
    width = _OVER * float(upper[1] - lower[1])
    height = _UPRIGHT * width
    ground = float(np.mean([end[1] for end in _rim_ends(mesh, width)]))
    origin = np.array([0.5 * depth_mm, 0.5 * (lower[1] + upper[1]), ground + 0.5 * height])
    back, up = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    points = mesh.vertices[np.unique(mesh.faces[inside])]
    hollow = manifold3d.Manifold.hull_points(np.vstack([points, points - [0.0, 0.0, height]]))
    hollow = (hollow + _below_the_rim(mesh, width)).to_mesh64()
    free = Mesh(hollow.vert_properties[:, :3].astype(np.float64), hollow.tri_verts.astype(np.int32), "hollow")
    return MotifFrame("crest", origin, back, up, (width, height), reach_mm, depth_mm=depth_mm, free=free)


def _rim_ends(mesh: Mesh, width: float) -> tuple[Float64[np.ndarray, "2"], Float64[np.ndarray, "2"]]:
    """(y, z) of the rim's front and of its lowest place behind, in the middle of a shell."""
    middle = mesh.vertices[np.abs(mesh.vertices[:, 0]) < 0.05 * width]
    return middle[middle[:, 1].argmin(), 1:], middle[middle[:, 2].argmin(), 1:]


def _below_the_rim(mesh: Mesh, width: float) -> manifold3d.Manifold:
    """All that is under the line from the front of the rim to its back."""
    first, last = _rim_ends(mesh, width)
    along = (last - first) / (last[0] - first[0])
    ends = [first - width * along, first + 2.0 * width * along]
    corners = [
        [side, y, z - down] for side in (-width, width) for y, z in ends for down in (0.0, 2.0 * width)
    ]
    return manifold3d.Manifold.hull_points(np.array(corners))


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
    width, height = (_BESIDE * (upper - lower)).tolist()
    return MotifFrame("sole", origin, right, up, (width, height), reach_mm, depth_mm=top_mm + PROUD_MM)
