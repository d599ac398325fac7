"""Landmarks and regions of a head that is nobody's: a person's stretched to the given landmarks, seen from between the ears.

A figure's skin does not tell where its forehead is, and it may be far from where a person's would be.  So every place of
the stretched person goes along the line to the middle of the head until it meets the skin: outward where it is inside.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial import cKDTree

from fabcraft.body.contacts import skin_disc
from fabcraft.body.region import Region
from fabcraft.body.scan_fit import PartFit
from fabcraft.body.scan_places import size_of
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.rays import Rays
from fabcraft.mesh import Mesh

_FARTHEST = 0.5
"""Share of the head's size that a place may have to go; one that is farther off is not on the figure."""
_COVERED = 0.6
"""A region is on the figure when this share of its points is."""
_INNER = ("eye_left", "eye_right")
_SPREAD = 1.5
"""Radius of skin that a point of a region stands for, over its distance from the next."""


def figure_landmarks(
    mesh: Mesh, fit: PartFit, given: Mapping[str, Float64[np.ndarray, "3"]]
) -> dict[str, Float64[np.ndarray, "3"]]:
    """The landmarks that meet the skin of `mesh`; `given` ones stay as they are, eyes where they are stretched to, mm."""
    names = [name for name in fit.part.landmarks if name not in _INNER]
    places, met = _Skin(mesh, fit).met(np.array([fit.part.landmarks[name] for name in names]))
    found = {name: place for name, place, there in zip(names, places, met, strict=True) if there}
    eyes = {name: fit.points[fit.part.landmarks[name]] for name in _INNER if name in fit.part.landmarks}
    return found | eyes | dict(given)


def figure_regions(mesh: Mesh, fit: PartFit) -> tuple[dict[str, Region], tuple[str, ...]]:
    """(every region that the figure has, on its vertices; those that it has not)."""
    found: dict[str, Region] = {}
    skin = _Skin(mesh, fit)
    for name, region in fit.part.regions.items():
        places, met = skin.met(region.vertex_indices)
        if met.mean() < _COVERED:
            continue
        own, emphasis = places[met], region.emphasis[met]
        members = skin_disc(mesh, own, _SPREAD * _apart(fit, region))
        nearest = cKDTree(own).query(mesh.vertices[members])[1]
        found[name] = region.at(members, emphasis[nearest])
    return found, tuple(sorted(fit.part.regions.keys() - found.keys()))


class _Skin:
    """The skin of a figure, made ready once for all places of the stretched person."""

    def __init__(self, mesh: Mesh, fit: PartFit) -> None:
        self._fit, self._distance, self._rays = fit, SurfaceDistance(mesh), Rays(mesh)
        ears = [fit.points[fit.part.landmarks[f"tragion_{side}"]] for side in ("left", "right")]
        self._middle = np.mean(ears, axis=0)

    def met(self, rows: np.ndarray) -> tuple[Float64[np.ndarray, "N 3"], Bool[np.ndarray, " N"]]:
        """Where the rows of the stretched person meet the skin, and whether they do."""
        points = self._fit.points[rows]
        away = points - self._middle
        out = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
        way = np.where(self._distance.signed(points)[:, None] < 0.0, out, -out)
        travelled = self._rays.distances(points, way)
        met = travelled < _FARTHEST * size_of(self._fit)
        return points + np.where(met, travelled, 0.0)[:, None] * way, met


def _apart(fit: PartFit, region: Region) -> float:
    """Usual distance of the points of a region from the next one, mm."""
    points = fit.points[region.vertex_indices]
    return float(np.median(cKDTree(points).query(points, k=2)[0][:, 1]))
