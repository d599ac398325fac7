"""Does the object fit the machine, and how does it stand on the bed?  Size, overhang, contact, islands.

The bed is the plane under the lowest point of the object as it is oriented, z up. An overhang is counted from
the vertical: a wall has 0, a ceiling 90 degrees. Faces within half a layer of the bed rest on it. An island
is a place where a layer begins in the air: a vertex lower than all its neighbours that is not on the bed.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from fabcraft.check.report import Finding, Severity, could_not_run, places
from fabcraft.mesh import Mesh
from fabcraft.profile import PrinterProfile

_SMALL_FOOT = 0.02  # of the box's footprint: less holds the part badly
_FIT_MM = 1e-6


@dataclass(frozen=True, eq=False)
class Printability:
    """How an object stands in a printer."""

    size_mm: tuple[float, float, float]
    volume_mm3: float | None
    """None unless the mesh is a closed solid."""
    fits: bool
    """In the given orientation, turned about z if need be."""
    turn_deg: float | None
    """Smallest turn about z that makes it fit; None when none does."""
    fits_lying: bool
    """On another of its sides, axis by axis."""
    overhang_share: float
    """Share of the surface that overhangs beyond the limit and does not rest on the bed."""
    overhang_mm2: float
    bed_contact_mm2: float
    footprint_mm2: float
    """The box's area on the bed."""
    island_places: Float64[np.ndarray, "I 3"]
    """Lowest points of what begins in the air, the lowest first."""


def inspect_printability(mesh: Mesh, profile: PrinterProfile, solid: bool = True) -> Printability:
    """Measure the object as it is oriented; `solid` says whether it encloses a volume."""
    size = mesh.size_mm
    bed = mesh.bounds[0, 2]
    areas, normals = mesh.face_areas, mesh.face_normals
    resting = mesh.corners[:, :, 2].max(1) <= bed + profile.layer_mm / 2
    # A face at angle a beyond the vertical looks down with sin a.
    steep = normals[:, 2] < -np.sin(np.radians(min(profile.max_overhang_deg + 1e-6, 90.0)))
    hanging = steep & ~resting
    turn = turn_to_fit(mesh, profile.build_mm)
    return Printability(
        size_mm=(float(size[0]), float(size[1]), float(size[2])),
        volume_mm3=abs(mesh.volume_mm3) if solid else None,
        fits=turn is not None,
        turn_deg=turn,
        fits_lying=bool((np.sort(size) <= np.sort(profile.build_mm) + _FIT_MM).all()),
        overhang_share=float(areas[hanging].sum() / max(areas.sum(), 1e-12)),
        overhang_mm2=float(areas[hanging].sum()),
        bed_contact_mm2=float(areas[resting & (normals[:, 2] < -0.5)].sum()),
        footprint_mm2=float(size[0] * size[1]),
        island_places=_islands(mesh, bed + profile.layer_mm),
    )


def printability_findings(state: Printability, profile: PrinterProfile) -> list[Finding]:
    """What a maker should know before slicing."""
    found = size_findings(state, profile)
    if profile.process not in ("fdm", "sla"):
        return found  # powder carries the part
    if state.overhang_mm2 > 0:
        found.append(
            Finding(
                check="overhang",
                severity="warn" if state.overhang_share > 0.1 else "note",
                value=round(100 * state.overhang_share, 2),
                unit="% of the surface",
                advice=f"Hangs over by more than {profile.max_overhang_deg:g} degrees: "
                "let the slicer support it or turn the part.",
            )
        )
    if len(state.island_places):
        found.append(
            Finding(
                check="islands",
                severity="note",
                value=len(state.island_places),
                where=places(state.island_places),
                advice="Here a layer begins in the air; supports must reach these places.",
            )
        )
    if state.bed_contact_mm2 < _SMALL_FOOT * state.footprint_mm2:
        found.append(
            Finding(
                check="bed_contact",
                severity="note",
                value=round(state.bed_contact_mm2, 2),
                limit=round(_SMALL_FOOT * state.footprint_mm2, 2),
                unit="mm²",
                advice="Little of it touches the bed: add a brim or supports, or turn a flat side down.",
            )
        )
    return found


def size_findings(state: Printability, profile: PrinterProfile) -> list[Finding]:
    """Whether it fits the build volume as it stands, turned, or on another side."""
    if not np.isfinite(state.size_mm).all():
        return [could_not_run("size", "the mesh has no extent")]
    severity: Severity
    if state.fits and state.turn_deg:
        severity = "note"
        advice = f"Fits the {profile.name} when turned by {state.turn_deg:.0f} degrees about z."
    elif state.fits:
        return []
    elif state.fits_lying:
        severity = "warn"
        advice = (
            f"Too large for the {profile.name} as it stands, but it fits on another side: turn it (--orient)."
        )
    else:
        severity = "fail"
        advice = f"Larger than the build volume of the {profile.name}: split it (--split), scale it or use a larger printer."
    return [
        Finding(
            check="size",
            severity=severity,
            value=tuple(round(side, 2) for side in state.size_mm),
            limit=profile.build_mm,
            unit="mm",
            advice=advice,
        )
    ]


def file_findings(faces: int, profile: PrinterProfile) -> list[Finding]:
    """Whether a service takes a file of so many triangles, counted as binary STL: 84 bytes and 50 for each."""
    found = []
    megabytes = round((84 + 50 * faces) / 1e6, 1)
    for value, limit, unit in ((faces, profile.max_faces, "faces"), (megabytes, profile.max_file_mb, "MB")):
        if limit is not None and value > limit:
            advice = "Services refuse larger files: make it with fewer triangles (a larger simplify_mm, a coarser preset)."
            found.append(
                Finding(check="file", severity="fail", value=value, limit=limit, unit=unit, advice=advice)
            )
    return found


def turn_to_fit(mesh: Mesh, build_mm: tuple[float, float, float]) -> float | None:
    """The smallest turn about z, in steps of 1 degree, whose box fits the bed; None when none does."""
    if mesh.size_mm[2] > build_mm[2] + _FIT_MM:
        return None
    plan = _hull(mesh.vertices[:, :2])
    for degrees in range(180):
        angle = np.radians(degrees)
        turned = plan @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        if (np.ptp(turned, axis=0) <= np.array(build_mm[:2]) + _FIT_MM).all():
            return float(degrees)
    return None


def _hull(plan: Float64[np.ndarray, "V 2"]) -> Float64[np.ndarray, "H 2"]:
    """The outline's corners, or all points where they lie on a line."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return plan[ConvexHull(plan).vertices]
    except (QhullError, ValueError):
        return plan


def _islands(mesh: Mesh, above: float) -> Float64[np.ndarray, "I 3"]:
    """Places above `above` where the solid begins: flat bottoms count once, hollows' floors not at all."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    _, compact = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = compact.reshape(-1)[mesh.faces]
    count = int(compact.max()) + 1
    height = np.zeros(count)
    height[compact.reshape(-1)] = mesh.vertices[:, 2]
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    level = np.abs(height[start] - height[end]) < 1e-9
    graph = coo_array((np.ones(level.sum(), dtype=bool), (start[level], end[level])), shape=(count, count))
    plateaus, label = connected_components(graph, directed=False)
    lowest = np.ones(plateaus, dtype=bool)
    for one, other in ((start, end), (end, start)):
        lowest[label[one[height[other] < height[one] - 1e-9]]] = False
    # Below a beginning there is air: the faces around it look down on the whole.
    down = np.zeros(plateaus)
    np.add.at(down, label[faces.reshape(-1)], np.repeat(mesh.area_vectors[:, 2], 3))
    used = np.zeros(plateaus, dtype=bool)
    used[label[faces.reshape(-1)]] = True
    first = np.zeros(plateaus, dtype=np.int64)
    first[label[compact.reshape(-1)[::-1]]] = np.arange(len(mesh.vertices))[::-1]
    begins = np.flatnonzero(lowest & used & (down < 0))
    points = mesh.vertices[first[begins]]
    points = points[points[:, 2] > above]
    return points[np.lexsort((points[:, 1], points[:, 0], points[:, 2]))]
