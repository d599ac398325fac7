"""`scan(path)`: a head scan becomes a `Body`: unit settled, cleaned, turned upright, closed, landmarked.

The head is found by fitting the baked model of people (`scan_fit`); the scan itself is only moved, never
resized or bent.  Landmarks are the fitted person's, put on the scan's surface; regions are the nearest fitted
skin's.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float64
from scipy.spatial import cKDTree

from fabcraft.body.body import NECK_BELOW_ROOT_MM, Body, cut_above, fan_closed, rim_loops
from fabcraft.body.region import Region
from fabcraft.body.scan_clean import cleaned, largest_piece
from fabcraft.body.scan_fit import HeadFit, fit_head
from fabcraft.errors import InputError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh
from fabcraft.read.mesh_file import UNITS_MM, read_mesh

HEAD_MM = (180.0, 400.0)
"""Largest side of a scan of head and neck."""
_POSSIBLE_MM = (150.0, 700.0)
"""Largest side of a scan that is looked at: a child's face to a bust with shoulders."""
_WORDS = {"mm": "millimetres", "cm": "centimetres", "m": "metres", "in": "inches"}

MATCHED_AT_LEAST = 0.6
"""Share of the fitted face that must lie on the scan: 1.0 on heads, below 0.4 on spheres, boxes and feet."""
_REGION_REACH_MM = 12.0
_RIM_ABOVE_MM = 0.5
"""The neck is cut level this far above the highest point of its opening."""


def scan(path: Path | str, units: str | None = None) -> Body:
    """The head in a scan file (STL, OBJ, PLY, GLB, 3MF) as a body.

    units : mm, cm, m or in; without it the file's own unit, or the one that makes it a head: see `notes`.
    Raises `InputError` for an unreadable file, a size that no head has, or a surface without a head.
    """
    piece, left_out = largest_piece(read_mesh(path, units))
    mesh, notes = _settled(piece, Path(path), units)
    notes += left_out
    surface, repairs = cleaned(mesh)
    fit = fit_head(surface)
    if fit.matched < MATCHED_AT_LEAST:
        raise InputError(
            f"no head was found in {Path(path).name}: "
            f"only {100 * fit.matched:.0f} % of the best-fitting face lies on the scan",
            "Crop it to head and neck, with an axis pointing up; or use a ready body (fabcraft bodies).",
        )
    upright = surface.with_vertices(fit.place.points(surface.vertices))
    closed, closing = _closed(upright, fit)
    turned = np.degrees(np.arccos(np.clip((np.trace(fit.place.rotation) - 1) / 2, -1, 1)))
    if turned > 1:
        notes += (f"The scan was turned by {turned:.0f} degrees, so that it stands and looks forward.",)
    return Body(
        closed.name,
        closed,
        _landmarks(closed, fit),
        _regions(closed, fit),
        "scan",
        {key: fit.person.joints[key] for key in ("neck_root", "head")},
        notes + repairs + closing,
    )


def _settled(mesh: Mesh, path: Path, units: str | None) -> tuple[Mesh, tuple[str, ...]]:
    """(the mesh in mm, the assumption about its unit).  Raises `InputError` when no unit makes it a head."""
    size = float(mesh.size_mm.max())
    if _POSSIBLE_MM[0] <= size <= _POSSIBLE_MM[1]:
        unitless = units is None and path.suffix.lower() in (".stl", ".obj", ".ply")
        return mesh, (f"{path.name} has no unit; it was taken as millimetres.",) if unitless else ()
    declared = UNITS_MM[units] if units else 1000.0 if path.suffix.lower() in (".glb", ".gltf") else 1.0
    proposal = next(
        (
            unit
            for low, high in (HEAD_MM, _POSSIBLE_MM)
            for unit, length_mm in UNITS_MM.items()
            if low <= size / declared * length_mm <= high
        ),
        None,
    )
    if proposal is None:
        raise InputError(
            f"{path.name} would be {size:.3g} mm large; a head with its neck is "
            f"{HEAD_MM[0]:.0f} to {HEAD_MM[1]:.0f} mm tall",
            "Crop the scan to head and neck, and pass its unit with --body-units mm, cm, m or in.",
        )
    if units is not None:
        raise InputError(
            f"the head would be {size:.3g} mm tall: the file looks like {_WORDS[proposal]}",
            f"Pass --body-units {proposal}.",
        )
    factor = UNITS_MM[proposal] / declared
    note = f"{path.name} was taken as {_WORDS[proposal]}, which makes it {size * factor:.0f} mm large."
    return mesh.with_vertices(mesh.vertices * factor), (note,)


def _closed(mesh: Mesh, fit: HeadFit) -> tuple[Mesh, tuple[str, ...]]:
    """The upright scan without an opening: the neck cut level, an opening elsewhere bridged."""
    loops = rim_loops(mesh.faces)
    floor = float(mesh.bounds[0, 2]) - 1.0
    notes: tuple[str, ...] = ()
    if loops:
        rim = float(mesh.vertices[loops[0], 2].max()) + _RIM_ABOVE_MM
        if rim < fit.person.landmarks["menton"][2]:
            floor, notes = rim, ("The open neck was cut level and closed.",)
        else:
            notes = ("The scan is open above the chin; the opening was bridged; nothing can rest there.",)
    closed = cut_above(fan_closed(mesh), floor)
    handles = 1 - (len(closed.vertices) - len(closed.faces) // 2) // 2
    if handles > 0:
        notes += (f"The scan has {handles} tunnels (behind an ear or in hair), which were left.",)
    return closed, notes


def _landmarks(mesh: Mesh, fit: HeadFit) -> dict[str, Float64[np.ndarray, "3"]]:
    """The fitted landmarks of the head, those of the skin put onto the scan."""
    floor = fit.person.joints["neck_root"][2] - NECK_BELOW_ROOT_MM
    of_head = {key: point for key, point in fit.person.landmarks.items() if point[2] > floor}
    names = [key for key in of_head if key not in ("eye_left", "eye_right")]
    on_skin = SurfaceDistance(mesh).closest(np.stack([of_head[key] for key in names])).points
    return of_head | dict(zip(names, on_skin, strict=True))


def _regions(mesh: Mesh, fit: HeadFit) -> dict[str, Region]:
    """Every scan vertex belongs to the regions of the nearest fitted skin; none farther than 12 mm."""
    person = fit.person.part("head")
    normal_mm = 5.0  # keeps the two sides of lips, lids and ears apart
    tree = cKDTree(np.hstack([person.mesh.vertices, normal_mm * person.mesh.vertex_normals]))
    distance, nearest = tree.query(np.hstack([mesh.vertices, normal_mm * mesh.vertex_normals]))
    regions = {}
    for key, region in person.regions.items():
        inside = np.isin(nearest, region.vertex_indices) & (distance < _REGION_REACH_MM)
        if not inside.any():  # a coarse scan may have no vertex there: the nearest one stands for it
            middle = person.mesh.vertices[region.vertex_indices].mean(0)
            inside[np.linalg.norm(mesh.vertices - middle, axis=1).argmin()] = True
        regions[key] = region.at(np.flatnonzero(inside))
    return regions
