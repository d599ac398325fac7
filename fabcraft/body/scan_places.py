"""Landmarks, joints and regions of the fitted person, put onto the scan; what the scan does not show is left out."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float64
from scipy.spatial import cKDTree

from fabcraft.body.region import Region
from fabcraft.body.scan_fit import MATCHED, PartFit
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh

_INNER = ("eye_left", "eye_right")
"""Landmarks that are not on the skin."""
_NORMAL_SHARE = 0.03
"""Distance, as a share of the part's size, that a right angle between normals counts as, about."""
_REACH = 0.035
"""Share of the part's size within which the scan belongs to the fitted skin."""
_COVERED = 0.6
"""A region is on the scan when this share of its points is."""

Points = Mapping[str, Float64[np.ndarray, "3"]]


def landmarks_on(mesh: Mesh, fits: Sequence[PartFit], given: Points) -> dict[str, np.ndarray]:
    """The landmarks that lie on `mesh`, put exactly onto it; of several fits the last one knows.

    given : those that are known beforehand.
    """
    surface = SurfaceDistance(mesh)
    found: dict[str, np.ndarray] = {}
    normals = mesh.face_normals
    for fit in fits:
        part = fit.part
        names = [name for name in part.landmarks if name not in _INNER]
        if not names:
            continue
        rows = np.array([part.landmarks[name] for name in names])
        near = surface.closest(fit.points[rows])
        facing = part.mesh(fit.points).vertex_normals[rows]
        alike = np.einsum("ij,ij->i", facing, normals[near.faces]) > 0.0
        on = (near.distances < 1.5 * MATCHED * size_of(fit)) & alike
        found |= {name: near.points[index] for index, name in enumerate(names) if on[index]}
        if "sellion" in found:
            found |= {name: fit.points[part.landmarks[name]] for name in _INNER if name in part.landmarks}
    return found | dict(given)


def joints_of(fits: Sequence[PartFit]) -> dict[str, np.ndarray]:
    """The joints of all fits, but for the eyes."""
    found: dict[str, np.ndarray] = {}
    for fit in fits:
        found |= dict(zip(fit.part.joint_names, fit.points[fit.part.skin :], strict=True))
    return {name: point for name, point in found.items() if name not in _INNER}


def regions_on(
    mesh: Mesh, fits: Sequence[PartFit], unsure: Float64[np.ndarray, "N 3"]
) -> tuple[dict[str, Region], tuple[str, ...]]:
    """(every region that the scan shows, on its vertices; those that it does not, which the fit has).

    unsure : points of fillings, where no region may be.
    """
    found: dict[str, Region] = {}
    asked: set[str] = set()
    known = np.ones(len(mesh.vertices), dtype=bool)
    if len(unsure):
        known = cKDTree(unsure).query(mesh.vertices)[0] > 1e-6
    normals = mesh.vertex_normals
    for fit in fits:
        part, skin = fit.part, fit.points[: fit.part.skin]
        size = size_of(fit)
        weight, reach = _NORMAL_SHARE * size, _REACH * size
        own = np.hstack([skin, weight * part.mesh(fit.points).vertex_normals])
        scanned = np.hstack([mesh.vertices, weight * normals])
        tree, back = cKDTree(own), cKDTree(scanned)
        distance, nearest = tree.query(scanned, distance_upper_bound=2.0 * reach)
        inside = np.isfinite(distance)
        nearest = np.where(inside, nearest, 0)
        for name, region in part.regions.items():
            asked.add(name)
            away, beside = back.query(own[region.vertex_indices])
            if float(((away < 1.5 * reach) & known[beside]).mean()) < _COVERED:
                continue
            members = np.flatnonzero(inside & known & np.isin(nearest, region.vertex_indices))
            if not len(members):  # a coarse skin may have no vertex there: the nearest one stands for it
                members = np.unique(beside[known[beside]])[:1]
            place = np.searchsorted(region.vertex_indices, nearest[members])
            place = np.minimum(place, len(region.vertex_indices) - 1)
            found[name] = region.at(members, region.emphasis[place])
    return found, tuple(sorted(asked - found.keys()))


def size_of(fit: PartFit) -> float:
    """The largest side of what the fit is judged by, mm; of a whole body, its head's about."""
    size = float(np.ptp(fit.points[fit.part.zone], axis=0).max())
    return size if fit.part.kind != "body" else 0.14 * size
