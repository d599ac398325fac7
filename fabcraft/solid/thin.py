"""Where a closed solid is thinner than the wall, and the medial triangles that would thicken it there.

Thickness by opening: a point is thick enough when, for every level s up to t, a ball of diameter s that
lies in the solid comes within 0.37 s of it. 0.37 = (sqrt 3 - 1)/2 is the gap between a ball and the
corner of a cube, so right angles never count as thin, and wedges sharper than about 60 degrees do. Only
faces whose inward ray meets a wall before 1.05 t are tested.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial import cKDTree

from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.edges import components, split_edges
from fabcraft.mesh import Mesh
from fabcraft.solid.patches import inward_thickness

LEVELS = (0.35, 0.5, 0.7, 0.85, 1.0)
"""Shares of the wall at which the opening is tested; a thin rib must not borrow the ball of its block."""

_CORNER = (np.sqrt(3) - 1) / 2
_MOST_FACES = 400_000
_LEAST_AREA = 0.5


@dataclass(frozen=True, eq=False)
class ThinSpots:
    """What of a solid is thinner than the wall."""

    medial: Mesh
    """The thin faces moved to mid-wall."""
    area_mm2: float
    """Of the thin faces."""
    firm: Mesh | None
    """The other faces; None where all are thin."""


def thin_spots(solid: Mesh, wall_mm: float) -> ThinSpots | None:
    """Where a closed mesh is thinner than the wall; None: nowhere."""
    spacing = max(0.4 * wall_mm, float(np.sqrt(2 * solid.area_mm2 / _MOST_FACES)))
    fine = split_edges(solid, 2 * spacing)
    centres, normals = fine.corners.mean(1), fine.face_normals
    thickness = inward_thickness(fine, centres, normals)
    candidates = np.flatnonzero((thickness < 1.05 * wall_mm) & (fine.face_areas > 0))
    if len(candidates) == 0:
        return None
    thin = candidates[_fails_opening(fine, centres, normals, thickness, candidates, wall_mm)]
    if len(thin):
        # A corner a little sharper than a cube's has a speck out of the ball's reach; it needs no knob.
        region = components(fine.faces[thin])
        areas = np.bincount(region, fine.face_areas[thin])
        thin = thin[areas[region] >= _LEAST_AREA * wall_mm**2]
    if len(thin) == 0:
        return None
    corners = fine.corners[thin] - 0.5 * (thickness[thin] * normals[thin].T).T[:, None, :]
    faces = np.arange(3 * len(thin), dtype=np.int32).reshape(-1, 3)
    rest = np.ones(len(fine.faces), dtype=bool)
    rest[thin] = False
    firm = fine.submesh(rest) if fine.face_areas[rest].sum() > 0 else None
    return ThinSpots(Mesh(corners.reshape(-1, 3), faces), float(fine.face_areas[thin].sum()), firm)


def _fails_opening(
    mesh: Mesh,
    centres: np.ndarray,
    normals: np.ndarray,
    thickness: np.ndarray,
    candidates: np.ndarray,
    wall_mm: float,
) -> Bool[np.ndarray, " K"]:
    """Whether each candidate face has no ball of some level near it."""
    reach = wall_mm * 2
    near = cKDTree(centres[candidates]).query(centres, distance_upper_bound=reach, workers=2)[0] < reach
    points, inward = centres[near], -normals[near]
    through = thickness[near]
    distance = SurfaceDistance(mesh)
    fails = np.zeros(len(candidates), bool)
    for level in LEVELS:
        size = level * wall_mm
        # A ball that touches here ends before the ray does: most of a thin wall needs no look at the distance.
        room = through >= size - _slack(size)
        left = np.flatnonzero(~fails)
        found = _ball_gap(distance, points[room], inward[room], centres[candidates[left]], size)
        fails[left] = found > (0.5 + _CORNER) * size
    return fails


def _slack(size_mm: float) -> float:
    """How deep a ball may cut the surface, mm: facets of a round wall are not edges."""
    return max(0.01, 0.02 * size_mm)


def _ball_gap(
    distance: SurfaceDistance, points: np.ndarray, inward: np.ndarray, tested: np.ndarray, size_mm: float
) -> Float64[np.ndarray, " K"]:
    """Distance from every tested point to the nearest centre of a ball of diameter `size_mm` in the solid.

    points : from where the way inward meets nothing for `size_mm`, so that a centre lies inside without being asked.
    """
    centres = points + 0.5 * size_mm * inward
    fits = distance.closest(centres).distances >= 0.5 * size_mm - _slack(size_mm)
    centres = centres[fits]
    if len(centres) == 0:
        return np.full(len(tested), np.inf)
    return cKDTree(centres).query(tested, workers=2)[0]
