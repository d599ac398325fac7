"""A part of the model of people, bent onto a scan: size, place and the person's coefficients, then what is left.

`fitted` alternates closest points in both directions with Gauss-Newton steps over the coefficients c of the model, a
rotation, a shift and a scale: min mean w (n·(s R (m + B c) + t - q))² + r (|c|² + (log s / 0.06)²), where q is the
closest point of the scan with normal n (Chen and Medioni 1992; a little of the point distance keeps sliding in
bounds).  c is in standard deviations of the population and s near 1, so r is the ratio of the variance of a reading
to the number of independent ones: the most probable person.
`settled` then moves the skin itself onto the scan by a smooth field (non-rigid ICP after Amberg et al. 2007, with
the graph Laplacian), so that a person whom the model does not know is followed too.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.sparse import diags
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from fabcraft.body.scan_part import PartModel
from fabcraft.body.scan_search import Cloud
from fabcraft.geometry.align import Similarity, spread_points
from fabcraft.geometry.edges import graph_laplacian

_SAMPLES, _BACK = 3000, 1200
"""Points of the part, and of the scan, that seek their partner."""
_NORMAL_SHARE = 0.05
"""Distance, as a share of the part's size, that a right angle between normals counts as, about."""
_SLIDING = 0.08
"""Weight of the point distance beside the distance to the plane."""
_READING, _READINGS = 0.006, 100.0
"""Standard deviation of a distance against the part's size, and how many independent ones a scan gives."""
_SIZE_SD = 0.06
"""Standard deviation of the natural logarithm of s."""
MATCHED = 0.016
"""A point of the part is matched when the scan is nearer than this share of the part's size (4 mm on a head)."""


@dataclass(frozen=True, eq=False)
class Surface:
    """The scan as the fit sees it."""

    cloud: Cloud
    rim: Bool[np.ndarray, " N"]
    """Points at a border, beyond which the scan may go on unseen."""
    tree: cKDTree
    """Of the points and weighted normals."""
    weight: float
    """Of the normals in the tree, mm."""

    @staticmethod
    def of(cloud: Cloud, rim: Bool[np.ndarray, " N"], size: float) -> "Surface":
        weight = _NORMAL_SHARE * size
        return Surface(cloud, rim, cKDTree(np.hstack([cloud.points, weight * cloud.normals])), weight)


@dataclass(frozen=True, eq=False)
class PartFit:
    """The part as it lies in the scan."""

    part: PartModel
    coefficients: Float64[np.ndarray, " K"]
    place: Similarity
    """Part to scan."""
    points: Float64[np.ndarray, "P 3"]
    """Skin and joints in the scan's frame."""
    rms: float
    """Root mean square distance from the matched zone to the scan, in the scan's unit."""
    misfit: float
    """Mean distance both ways over the part's size, the farthest left out."""
    matched: float
    """Share of the zone that has the scan nearby and turned alike."""


def fitted(
    part: PartModel,
    surface: Surface,
    start: Similarity,
    origin: Float64[np.ndarray, " K"],
    rounds: int = 16,
) -> PartFit:
    """The person with whom the part lies best on the scan, from a `start` that is roughly right.

    origin : coefficients to begin with.
    """
    skin = part.mean[: part.skin] + np.tensordot(origin, part.basis[:, : part.skin], 1)
    used = spread_points(skin, _SAMPLES)
    basis = part.basis[:, used]
    coefficients, place = origin.copy(), start
    backward = spread_points(surface.cloud.points, _BACK)
    for step in range(rounds):
        points = part.points(coefficients)
        normals = part.mesh(points).vertex_normals[used] @ place.rotation.T
        moved = place.points(points[used])
        pairs = _pairs(moved, normals, surface, backward)
        stiff = 1e6 if step < 2 else 10.0 if step < 5 else 1.0
        change = _step(moved, basis, place, surface, pairs, coefficients, origin, stiff)
        coefficients = coefficients + change[7:]
        place = _moved(place, change[:7], moved.mean(0))
    return judged(part, coefficients, place, surface)


@dataclass(frozen=True, eq=False)
class _Pairs:
    model: Int64[np.ndarray, " N"]
    """Index among the samples."""
    scan: Int64[np.ndarray, " N"]
    weight: Float64[np.ndarray, " N"]


def _pairs(
    moved: Float64[np.ndarray, "M 3"],
    normals: Float64[np.ndarray, "M 3"],
    surface: Surface,
    backward: Int64[np.ndarray, " B"],
) -> _Pairs:
    """Closest points both ways, without those over a border, turned away or far off."""
    keys = np.hstack([moved, surface.weight * normals])
    _, ahead = surface.tree.query(keys)
    _, back = cKDTree(keys).query(surface.tree.data[backward])
    model = np.concatenate([np.arange(len(moved)), back])
    scan = np.concatenate([ahead, backward])
    away = np.linalg.norm(moved[model] - surface.cloud.points[scan], axis=1)
    alike = np.einsum("ij,ij->i", normals[model], surface.cloud.normals[scan])
    reach = max(2.5 * float(np.median(away[: len(moved)])), 0.15 * surface.weight)
    weight = np.clip(1.0 - (away / reach) ** 2, 0.0, None) ** 2 * (alike > 0.3) * ~surface.rim[scan]
    weight[len(moved) :] *= len(moved) / max(len(backward), 1) * 0.5
    kept = np.flatnonzero(weight > 0)
    return _Pairs(model[kept], scan[kept], weight[kept])


def _step(
    moved: Float64[np.ndarray, "M 3"],
    basis: Float64[np.ndarray, "K M 3"],
    place: Similarity,
    surface: Surface,
    pairs: _Pairs,
    coefficients: Float64[np.ndarray, " K"],
    origin: Float64[np.ndarray, " K"],
    stiff: float,
) -> Float64[np.ndarray, " 7+K"]:
    """Gauss-Newton step: turn (3), shift (3), relative size (1), coefficients (K)."""
    normals = surface.cloud.normals[pairs.scan]
    left = moved[pairs.model] - surface.cloud.points[pairs.scan]
    about = moved[pairs.model] - moved.mean(0)
    turned = place.scale * basis[:, pairs.model] @ place.rotation.T  # K N 3
    cross = np.zeros((3, len(about), 3))
    for axis, unit in enumerate(np.eye(3)):
        cross[axis] = np.cross(unit, about)
    shift = np.broadcast_to(np.eye(3)[:, None, :], (3, len(about), 3))
    columns = np.concatenate([cross, shift, about[None], turned])
    along = np.einsum("kni,ni->kn", columns, normals)
    plane = np.einsum("ni,ni->n", left, normals)
    root = np.sqrt(pairs.weight)
    side = np.sqrt(_SLIDING) * root[:, None]
    rows = np.concatenate([along * root, (columns * side).reshape(len(columns), -1)], axis=1)
    wanted = np.concatenate([-plane * root, (-left * side).ravel()])
    matrix = rows @ rows.T / pairs.weight.sum()
    goal = rows @ wanted / pairs.weight.sum()
    ridge = stiff * (_READING * surface.weight / _NORMAL_SHARE) ** 2 / _READINGS
    matrix[7:, 7:] += ridge * np.eye(len(coefficients))
    goal[7:] -= ridge * (coefficients - (origin if stiff > 1 else 0.0))
    matrix[6, 6] += ridge / _SIZE_SD**2
    goal[6] -= ridge / _SIZE_SD**2 * np.log(place.scale)
    matrix[np.diag_indices(7)] += 1e-9 * np.trace(matrix)
    return np.linalg.solve(matrix, goal)


def _moved(place: Similarity, change: Float64[np.ndarray, "7"], middle: Float64[np.ndarray, "3"]) -> Similarity:
    """The similarity turned and resized about `middle`, then shifted."""
    angle = float(np.linalg.norm(change[:3]))
    axis = change[:3] / max(angle, 1e-12)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    grow = float(np.exp(np.clip(change[6], -0.1, 0.1)))
    shift = grow * turn @ (place.translation - middle) + middle + change[3:6]
    return Similarity(grow * place.scale, turn @ place.rotation, shift)


def judged(
    part: PartModel, coefficients: Float64[np.ndarray, " K"], place: Similarity, surface: Surface
) -> PartFit:
    """The fit with its figures."""
    points = part.points(coefficients)
    normals = part.mesh(points).vertex_normals @ place.rotation.T
    placed = place.points(points)
    size = surface.weight / _NORMAL_SHARE
    keys = np.hstack([placed[: part.skin], surface.weight * normals])
    chosen = part.zone[spread_points(points[part.zone], _SAMPLES)]
    _, nearest = surface.tree.query(keys[chosen])
    away = np.linalg.norm(placed[chosen] - surface.cloud.points[nearest], axis=1)
    alike = np.einsum("ij,ij->i", normals[chosen], surface.cloud.normals[nearest]) > 0.5
    near = (away < MATCHED * size) & alike
    rms = float(np.sqrt((away[near] ** 2).mean())) if near.any() else float(size)
    backward = spread_points(surface.cloud.points, _BACK)
    back = np.sort(cKDTree(placed[: part.skin]).query(surface.cloud.points[backward])[0])
    misfit = (np.minimum(away, 0.1 * size).mean() + back[: int(0.8 * len(back))].mean()) / size
    return PartFit(part, coefficients, place, placed, rms, float(misfit), float(near.mean()))


def settled(fit: PartFit, surface: Surface, stiffness: tuple[float, ...] = (30.0, 8.0, 2.0)) -> PartFit:
    """The same fit with its skin drawn onto the scan by a smooth field, and the joints carried along.

    stiffness : weight of the field's differences along edges against the distances, from round to round.
    """
    part = fit.part
    skin, size = part.skin, surface.weight / _NORMAL_SHARE
    start, now = fit.points[:skin], fit.points[:skin].copy()
    laplacian = graph_laplacian(part.faces, skin)
    for stiff in stiffness:
        normals = part.mesh(now).vertex_normals
        keys = np.hstack([now, surface.weight * normals])
        _, nearest = surface.tree.query(keys)
        goal, facing = surface.cloud.points[nearest], surface.cloud.normals[nearest]
        away = np.linalg.norm(goal - now, axis=1)
        alike = np.einsum("ij,ij->i", normals, facing)
        reach = max(3.0 * float(np.median(away)), 2.0 * MATCHED * size)
        weight = np.clip(1.0 - (away / reach) ** 2, 0.0, None) * (alike > 0.4) * ~surface.rim[nearest]
        wanted = now + facing * np.einsum("ij,ij->i", facing, goal - now)[:, None] - start
        system = (stiff * laplacian + diags(weight + 1e-6)).tocsc()
        now = start + splu(system).solve(weight[:, None] * wanted)
    moves = now - start
    joints = fit.points[skin:]
    near, which = cKDTree(start).query(joints, k=40) if len(joints) else (np.zeros((0, 1)), np.zeros((0, 1), int))
    share = 1.0 / np.maximum(near, 1e-6) ** 2
    carried = joints + np.einsum("jk,jki->ji", share / share.sum(1, keepdims=True), moves[which])
    return replace(fit, points=np.concatenate([now, carried]))
