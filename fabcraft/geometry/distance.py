"""`SurfaceDistance`: how far a point is from a surface, and on which side, asked again and again of one mesh.

Length and sign come from two places. The length is the exact distance to the closest triangle (libigl's AABB
tree, built once). The sign is the generalised winding number w of Jacobson et al., "Robust Inside-Outside
Segmentation using Generalized Winding Numbers" (2013), in the fast form of Barill et al. (2018): w > 1/2 is
inside. libigl's own signed distance with the fast winding number multiplies the length by (1 - 2w), so it is
not used.

Sign: **positive outside, negative inside**, for faces that look outward. Overlapping and nested parts count
as one inside; open surfaces get the side that w = 1/2 separates. Millimetres.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import igl
import numpy as np
from jaxtyping import Bool, Float, Float64, Int64

from fabcraft.errors import InputError
from fabcraft.mesh import Mesh

# Closer to the surface than this, (q - c)/d is rounding noise; the closest face's normal is the gradient.
_TOUCHING_MM = 1e-6


class Closest(NamedTuple):
    """The closest place on the surface for each of N query points."""

    distances: Float64[np.ndarray, " N"]
    """Unsigned distance, mm."""
    faces: Int64[np.ndarray, " N"]
    """Index of the face that holds the closest point."""
    points: Float64[np.ndarray, "N 3"]
    """The closest point itself, mm."""


@dataclass(frozen=True, eq=False)
class SurfaceDistance:
    """Distances to `mesh`; each of the two search trees is built once, when it is first asked.

    Points are asked in the order of a space-filling curve, so that the trees stay in the cache.
    Raises `InputError` for a mesh without faces.
    """

    mesh: Mesh

    def __post_init__(self) -> None:
        if len(self.mesh.faces) == 0:
            raise InputError(
                f"mesh {self.mesh.name or '(unnamed)'} has no faces, so nothing can be measured to it",
                "Check that the file holds a surface and not only points.",
            )

    @cached_property
    def _arrays(self) -> tuple[np.ndarray, np.ndarray]:
        vertices = np.array(self.mesh.vertices, order="C")
        return vertices, np.array(self.mesh.faces, dtype=np.int64, order="C")

    @cached_property
    def _tree(self) -> igl.AABB:
        tree = igl.AABB()
        tree.init(*self._arrays)
        return tree

    @cached_property
    def _winding(self) -> igl.FastWindingNumberBVH:
        winding = igl.FastWindingNumberBVH()
        winding.init(*self._arrays)
        return winding

    def closest(self, points: Float[np.ndarray, "N 3"]) -> Closest:
        """The closest point of the surface to every point: distance (mm, unsigned), face and place."""
        order = _scan_order(points)
        squared, faces, places = self._tree.squared_distance(*self._arrays, _contiguous(points)[order])
        back = np.empty(len(order), np.int64)
        back[order] = np.arange(len(order))
        # libigl counts in long long, which NumPy keeps apart from int64.
        faces = faces.astype(np.int64)
        return Closest(np.sqrt(np.maximum(squared, 0.0))[back], faces[back], places.reshape(-1, 3)[back])

    def winding(self, points: Float[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        """Generalised winding number: 1 inside, 0 outside, between on a surface with holes."""
        if len(points) == 0:
            return np.zeros(0)
        order = _scan_order(points)
        winding = np.empty(len(points))
        winding[order] = self._winding.winding_number(_contiguous(points)[order]).reshape(-1)
        return winding

    def inside(self, points: Float[np.ndarray, "N 3"]) -> Bool[np.ndarray, " N"]:
        """Whether each point lies inside the surface."""
        return self.winding(points) > 0.5

    def signed(self, points: Float[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
        """Signed distance, mm: positive outside, negative inside."""
        return np.where(self.inside(points), -1.0, 1.0) * self.closest(points).distances

    def signed_with_gradient(
        self, points: Float[np.ndarray, "N 3"]
    ) -> tuple[Float64[np.ndarray, " N"], Float64[np.ndarray, "N 3"]]:
        """Signed distance (mm) and its unit gradient, the way out; on the surface itself, the face normal."""
        distances, faces, places = self.closest(points)
        sign = np.where(self.inside(points), -1.0, 1.0)
        away = sign[:, None] * (np.asarray(points, dtype=np.float64) - places)
        gradient = np.where(
            distances[:, None] > _TOUCHING_MM,
            away / np.maximum(distances, _TOUCHING_MM)[:, None],
            self.mesh.face_normals[faces],
        )
        return sign * distances, gradient


def _contiguous(points: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(points, dtype=np.float64)


def _scan_order(points: np.ndarray) -> np.ndarray:
    """The order of the points along a Morton curve of 1024 cells a side."""
    if len(points) < 64:
        return np.arange(len(points))
    lower, upper = points.min(0), points.max(0)
    cells = ((points - lower) * (1023.0 / max(float((upper - lower).max()), 1e-12))).astype(np.int64)
    # Spread ten bits so that two empty ones follow each: the classic magic numbers of bit interleaving.
    for shift, mask in ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249)):
        cells = (cells | (cells << shift)) & mask
    return np.argsort(cells @ np.array([4, 2, 1]), kind="stable")
