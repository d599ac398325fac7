"""Bringing one point set onto another by a similarity (scale, rotation, translation).

`fit_similarity` is the closed form for known pairs (S. Umeyama, "Least-squares estimation of transformation
parameters between two point patterns", PAMI 1991).  `similarity_icp` finds the pairs itself: iterated closest
points (Besl and McKay 1992) over positions and normals, in both directions, since one direction alone lets a
free scale shrink the source onto one point; the worst pairs are left out (trimmed ICP, Chetverikov 2002).
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from fabcraft.geometry.distance import SurfaceDistance


@dataclass(frozen=True, eq=False)
class Similarity:
    """x to scale · R x + t."""

    scale: float = 1.0
    rotation: Float64[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))
    translation: Float64[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    rms: float = float("nan")
    """Root mean square distance of the pairs kept, in the target's unit; nan where nothing was fitted."""

    def points(self, points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, "N 3"]:
        """The points moved."""
        return self.scale * points @ self.rotation.T + self.translation

    @property
    def matrix(self) -> Float64[np.ndarray, "4 4"]:
        """The same map as a homogeneous matrix."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.scale * self.rotation
        matrix[:3, 3] = self.translation
        return matrix

    def after(self, first: "Similarity") -> "Similarity":
        """`first`, then this one."""
        shift = self.points(first.translation[None])[0]
        return Similarity(self.scale * first.scale, self.rotation @ first.rotation, shift, self.rms)

    def inverse(self) -> "Similarity":
        """The map back."""
        back = self.rotation.T
        return Similarity(1.0 / self.scale, back, -(back @ self.translation) / self.scale)


def fit_similarity(
    source: Float64[np.ndarray, "N 3"],
    target: Float64[np.ndarray, "N 3"],
    scale_range: tuple[float, float] = (0.0, np.inf),
) -> Similarity:
    """The similarity with the least squared distances between paired points; (1, 1) fixes the scale."""
    source_middle, target_middle = source.mean(0), target.mean(0)
    spread, goal = source - source_middle, target - target_middle
    left, stretch, right = np.linalg.svd(goal.T @ spread)
    proper = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])  # a rotation, never a mirror
    rotation = (left * proper) @ right
    scale = float(np.clip((stretch * proper).sum() / (spread**2).sum(), *scale_range))
    moved = scale * spread @ rotation.T - goal
    rms = float(np.sqrt((moved**2).sum(1).mean()))
    return Similarity(scale, rotation, target_middle - scale * rotation @ source_middle, rms)


def similarity_icp(
    source: Float64[np.ndarray, "N 3"],
    target: Float64[np.ndarray, "M 3"],
    source_normals: Float64[np.ndarray, "N 3"],
    target_normals: Float64[np.ndarray, "M 3"],
    start: Similarity,
    iterations: int = 40,
    keep: float = 0.75,
    normal_weight: float = 10.0,
    scale_range: tuple[float, float] = (0.7, 1.4),
) -> Similarity:
    """The similarity that brings `source` onto `target`, from a `start` that is roughly right.

    keep : share of the pairs that counts, the nearest ones.
    normal_weight : distance, in the unit of the points, that two opposite normals count as half of.
    """
    tree = cKDTree(np.hstack([target, normal_weight * target_normals]))
    now = start
    for _ in range(iterations):
        moved = np.hstack([now.points(source), normal_weight * source_normals @ now.rotation.T])
        ahead_distance, ahead = tree.query(moved)
        back_distance, back = cKDTree(moved).query(tree.data)
        near, near_back = _nearest(ahead_distance, keep), _nearest(back_distance, keep)
        pairs = (
            np.concatenate([np.flatnonzero(near), back[near_back]]),
            np.concatenate([ahead[near], np.flatnonzero(near_back)]),
        )
        previous, now = now, fit_similarity(source[pairs[0]], target[pairs[1]], scale_range)
        if abs(previous.rms - now.rms) < 1e-6 * (1.0 + now.rms):
            break
    return now


def settled_on(
    surface: SurfaceDistance,
    points: Float64[np.ndarray, "N 3"],
    start: Similarity,
    scaled: bool,
    keep: float = 0.75,
    iterations: int = 30,
    turned: bool = True,
) -> Similarity:
    """The similarity that brings `points` onto `surface`, from a `start` that is nearly right, by the distances to the
    tangent planes (Chen and Medioni 1992): unlike distances to points they let it slide along the surface.

    keep : share of the points that counts, the nearest ones.  scaled, turned : it may change its size, and turn.  A turn
    that the surface cannot tell (of a round ring about its axis) is left as it is.
    """
    now = start
    reach = start.scale * float(np.sqrt(((points - points.mean(0)) ** 2).sum(1).mean()))
    for _ in range(iterations):
        moved = now.points(points)
        found = surface.closest(moved)
        near = _nearest(found.distances, keep)
        normals = surface.mesh.face_normals[found.faces[near]]
        middle = moved.mean(0)
        arm = (moved[near] - middle) / reach
        columns = [np.cross(arm, normals) * turned, normals] + [(arm * normals).sum(1)[:, None]] * scaled
        gap = ((found.points[near] - moved[near]) * normals).sum(1)
        step = np.linalg.lstsq(np.hstack(columns), gap, rcond=1e-2)[0]
        turn = Rotation.from_rotvec(step[:3] / reach).as_matrix()
        grown = 1.0 + float(step[6]) / reach if scaled else 1.0
        shift = middle + step[3:6] + grown * turn @ (now.translation - middle)
        rms = float(np.sqrt((gap**2).mean()))
        now = Similarity(grown * now.scale, turn @ now.rotation, shift, rms)
        if float(np.abs(step).max()) < 1e-6 * reach:
            break
    return now


def _nearest(distances: Float64[np.ndarray, " N"], share: float) -> Bool[np.ndarray, " N"]:
    """Which distances belong to the smallest `share`."""
    return distances <= np.quantile(distances, share)


def axis_rotations() -> list[Float64[np.ndarray, "3 3"]]:
    """The 24 rotations that map axes onto axes, the identity first."""
    rotations = []
    for order in ((0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (2, 1, 0), (1, 0, 2)):
        for signs in np.ndindex(2, 2, 2):
            matrix = np.zeros((3, 3))
            matrix[np.arange(3), order] = 1.0 - 2.0 * np.array(signs)
            if np.linalg.det(matrix) > 0:
                rotations.append(matrix)
    return rotations


def spread_points(points: Float64[np.ndarray, "N 3"], count: int) -> Int64[np.ndarray, " K"]:
    """Indices of at most `count` points, evenly spread: one for each cell of the finest grid that fits."""
    low, size = points.min(0), float(np.ptp(points, axis=0).max())
    cell = size / max(np.sqrt(count), 1.0)
    for _ in range(30):
        _, chosen = np.unique(np.floor((points - low) / cell).astype(np.int64), axis=0, return_index=True)
        if len(chosen) <= count:
            return np.sort(chosen)
        cell *= 1.1
    return np.sort(chosen)[:count]
