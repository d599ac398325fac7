"""How near do surfaces come to each other outside the material: gaps between parts, and slots within one.

A gap is the opening thickness of the air: the same balls as in `thickness`, rolled on the outer side. So the inner
corner of a right angle is no gap, a slot is as wide as it is, and a groove sharper than about 60 degrees counts at its
bottom. What lies across the gap, the same part or another, is what the ray along the normal meets.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from fabcraft.check.balls import spread
from fabcraft.check.report import Finding, places
from fabcraft.check.thickness import measure_thickness
from fabcraft.check.thin import thinnest
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.rays import Rays
from fabcraft.mesh import Mesh
from fabcraft.profile import PrinterProfile

_START_MM = 1e-3  # before the face that the ray starts from
_SMALLEST_MM2 = 0.25
_MOST_RAYS = 200_000


@dataclass(frozen=True, eq=False)
class Gaps:
    """The gaps below the limit; a width is None where there is none of at least 0.25 mm²."""

    between_mm: float | None
    """Narrowest gap between two parts."""
    within_mm: float | None
    """Narrowest gap within one part."""
    between_places: Float64[np.ndarray, "B 3"]
    """Points of the surface at gaps between parts, the narrowest first."""
    within_places: Float64[np.ndarray, "W 3"]


def measure_gaps(
    mesh: Mesh,
    part_of_face: Int64[np.ndarray, " F"],
    between_mm: float,
    within_mm: float,
    distance: SurfaceDistance | None = None,
) -> Gaps:
    """Gaps of a closed, outward-looking mesh below `between_mm` (two parts) and `within_mm` (one part)."""
    need, rays, none = max(between_mm, within_mm), Rays(mesh), np.zeros((0, 3))
    areas = mesh.face_areas
    points, faces, shares = spread(mesh, areas, max(0.5 * need, float(np.sqrt(areas.sum() / _MOST_RAYS))))
    normals = mesh.face_normals[faces]
    near = rays.distances(points + _START_MM * normals, normals) < need
    if shares[near].sum() < _SMALLEST_MM2:  # most objects: nothing faces anything
        return Gaps(None, None, none, none)
    outside = Mesh(mesh.vertices, mesh.faces[:, ::-1], mesh.name)
    air = measure_thickness(outside, need, limit_mm=need, smallest_mm2=_SMALLEST_MM2, distance=distance)
    normals = mesh.face_normals[air.faces]
    across = rays.faces(air.points + _START_MM * normals, normals)
    other = (across >= 0) & (part_of_face[across] != part_of_face[air.faces])
    found: list[tuple[float | None, np.ndarray]] = []
    for chosen, limit in ((other, between_mm), (~other, within_mm)):
        narrow = np.flatnonzero(chosen & (across >= 0) & (air.values_mm < 0.98 * limit))
        if air.areas[narrow].sum() < _SMALLEST_MM2:
            found.append((None, none))
            continue
        order = narrow[np.argsort(air.values_mm[narrow], kind="stable")]
        found.append(
            (thinnest(air.values_mm[narrow], air.areas[narrow]), air.points[_apart(air.points, order)])
        )
    (between, between_places), (within, within_places) = found
    return Gaps(between, within, between_places, within_places)


def _apart(points: np.ndarray, order: np.ndarray, most: int = 8, least_mm: float = 5.0) -> list[int]:
    """The first of `order` that are not near to one another."""
    kept: list[int] = []
    for index in order:
        if all(np.linalg.norm(points[index] - points[one]) > least_mm for one in kept):
            kept.append(int(index))
            if len(kept) == most:
                break
    return kept


def gap_findings(gaps: Gaps, profile: PrinterProfile) -> list[Finding]:
    """Parts that would grow together are a warning, slots that would close a note."""
    found = []
    if gaps.between_mm is not None:
        found.append(
            Finding(
                check="gap",
                severity="warn",
                value=round(gaps.between_mm, 3),
                limit=profile.clearance_moving_mm,
                unit="mm",
                where=places(gaps.between_places),
                advice="Parts come so near to each other that they may print as one: move them apart.",
            )
        )
    if gaps.within_mm is not None:
        found.append(
            Finding(
                check="detail",
                severity="note",
                value=round(gaps.within_mm, 3),
                limit=profile.min_engrave_mm,
                unit="mm",
                where=places(gaps.within_places),
                advice="Slots or grooves are narrower than the printer shows: widen them, or they fill up.",
            )
        )
    return found
