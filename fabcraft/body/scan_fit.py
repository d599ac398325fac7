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
from fabcraft.geometry.align import Similarity, fit_similarity, spread_points
from fabcraft.geometry.edges import graph_laplacian

_BACK = 1200
"""Points of the scan that seek their partner on the part."""
_NORMAL_SHARE = 0.05
"""Distance, as a share of the part's size, that a right angle between normals counts as, about."""
_SLIDING = 0.08
"""Weight of the point distance beside the distance to the plane."""
_READING, _READINGS = 0.006, 100.0
"""Standard deviation of a distance against the part's size, and how many independent ones a scan gives."""
_PART_MM = 300.0
"""A whole body is read no less exactly than a part of this size."""
_SIZE_SD = 0.06
"""Standard deviation of the natural logarithm of s."""
MATCHED = 0.016
"""A point of the part is matched when the scan is nearer than this share of the part's size (4 mm on a hand)."""


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
    spread: Int64[np.ndarray, " B"]
    """Some of the points, evenly spread."""

    @staticmethod
    def of(cloud: Cloud, rim: Bool[np.ndarray, " N"], size: float) -> "Surface":
        weight = _NORMAL_SHARE * size
        tree = cKDTree(np.hstack([cloud.points, weight * cloud.normals]))
        return Surface(cloud, rim, tree, weight, spread_points(cloud.points, _BACK))


@dataclass(frozen=True, eq=False)
class Marks:
    """Landmarks whose place in the scan is known."""

    rows: Int64[np.ndarray, " M"]
    """Rows of the part's points."""
    points: Float64[np.ndarray, "M 3"]


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
    marks: Marks | None = None,
) -> PartFit:
    """The person with whom the part lies best on the scan, from a `start` that is roughly right.

    origin : coefficients to begin with.  marks : landmarks that are known; together they weigh as much as the scan.
    """
    used, basis = part.samples, part.basis[:, part.samples]
    coefficients, place = _absorbed(part, start, origin) if rounds else (origin, start)
    origin = coefficients
    for step in range(rounds):
        points = part.points(coefficients)
        normals = part.mesh(points).vertex_normals[used] @ place.rotation.T
        moved = place.points(points[used])
        pairs = _pairs(moved, normals, surface)
        stiff = 1e6 if step < 2 else 10.0 if step < 5 else 1.0
        matrix, goal = _normal_equations(moved, basis, place, surface, pairs)
        if marks is not None:
            held = _held(place.points(points[marks.rows]), part.basis[:, marks.rows], place, moved, marks)
            matrix, goal = matrix + held[0], goal + held[1]
        size = surface.weight / _NORMAL_SHARE
        change = _solved(matrix, goal, place, coefficients, origin, stiff, size)
        coefficients = coefficients + change[7:]
        place = _moved(place, change[:7], moved.mean(0))
    return judged(part, coefficients, place, surface)


def _absorbed(
    part: PartModel, start: Similarity, origin: Float64[np.ndarray, " K"]
) -> tuple[Float64[np.ndarray, " K"], Similarity]:
    """The likely person who is as large as the one of `origin` at the scale of `start`, and that one's place."""
    used = part.samples
    basis = part.basis[:, used]
    flat = (basis - basis.mean(1, keepdims=True)).reshape(len(basis), -1)
    scaled = start.scale * (part.mean[used] + np.tensordot(origin, basis, 1))
    wanted = scaled - part.mean[used]
    wanted = (wanted - wanted.mean(0)).ravel()
    size = float(np.ptp(part.mean[part.zone], axis=0).max())
    ridge = _ridge(size) * len(used)
    coefficients = np.linalg.solve(flat @ flat.T + ridge * np.eye(len(basis)), flat @ wanted)
    likely = part.mean[used] + np.tensordot(coefficients, basis, 1)
    return coefficients, fit_similarity(likely, start.points(scaled / start.scale))


def _ridge(size: float) -> float:
    """Weight of the prior against a mean squared distance."""
    return (_READING * min(size, _PART_MM)) ** 2 / _READINGS


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
) -> _Pairs:
    """Closest points both ways, without those over a border, turned away or far off."""
    keys = np.hstack([moved, surface.weight * normals])
    _, ahead = surface.tree.query(keys)
    backward = surface.spread
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


def _normal_equations(
    moved: Float64[np.ndarray, "M 3"],
    basis: Float64[np.ndarray, "K M 3"],
    place: Similarity,
    surface: Surface,
    pairs: _Pairs,
) -> tuple[Float64[np.ndarray, "D D"], Float64[np.ndarray, " D"]]:
    """(matrix, right side) of the step: turn (3), shift (3), relative size (1), coefficients (K); a mean over pairs."""
    normals = surface.cloud.normals[pairs.scan]
    left = moved[pairs.model] - surface.cloud.points[pairs.scan]
    columns = _columns(
        moved[pairs.model] - moved.mean(0), place.scale * basis[:, pairs.model] @ place.rotation.T
    )
    along = np.einsum("kni,ni->kn", columns, normals)
    plane = np.einsum("ni,ni->n", left, normals)
    root = np.sqrt(pairs.weight)
    side = np.sqrt(_SLIDING) * root[:, None]
    rows = np.concatenate([along * root, (columns * side).reshape(len(columns), -1)], axis=1)
    wanted = np.concatenate([-plane * root, (-left * side).ravel()])
    total = max(float(pairs.weight.sum()), 1e-9)
    return rows @ rows.T / total, rows @ wanted / total


def _held(
    at: Float64[np.ndarray, "M 3"],
    basis: Float64[np.ndarray, "K M 3"],
    place: Similarity,
    moved: Float64[np.ndarray, "N 3"],
    marks: Marks,
) -> tuple[Float64[np.ndarray, "D D"], Float64[np.ndarray, " D"]]:
    """The same for known landmarks, which hold in every direction."""
    columns = _columns(at - moved.mean(0), place.scale * basis @ place.rotation.T)
    rows = columns.reshape(len(columns), -1)
    return rows @ rows.T / len(at), rows @ (marks.points - at).ravel() / len(at)


def _columns(
    about: Float64[np.ndarray, "N 3"], shapes: Float64[np.ndarray, "K N 3"]
) -> Float64[np.ndarray, "D N 3"]:
    """How points move with each unknown; `about` from the middle that everything turns and grows about."""
    turns = np.stack([np.cross(unit, about) for unit in np.eye(3)])
    shifts = np.broadcast_to(np.eye(3)[:, None, :], turns.shape)
    return np.concatenate([turns, shifts, about[None], shapes])


def _solved(
    matrix: Float64[np.ndarray, "D D"],
    goal: Float64[np.ndarray, " D"],
    place: Similarity,
    coefficients: Float64[np.ndarray, " K"],
    origin: Float64[np.ndarray, " K"],
    stiff: float,
    size: float,
) -> Float64[np.ndarray, " D"]:
    """The step with the prior; above 1, `stiff` draws towards the `origin` instead of the average person."""
    ridge = stiff * _ridge(size)
    matrix, goal = matrix.copy(), goal.copy()
    matrix[7:, 7:] += ridge * np.eye(len(coefficients))
    goal[7:] -= ridge * (coefficients - (origin if stiff > 1 else 0.0))
    matrix[6, 6] += ridge / _SIZE_SD**2
    goal[6] -= ridge / _SIZE_SD**2 * np.log(place.scale)
    matrix[np.diag_indices(7)] += 1e-9 * np.trace(matrix)
    return np.linalg.solve(matrix, goal)


def _moved(
    place: Similarity, change: Float64[np.ndarray, "7"], middle: Float64[np.ndarray, "3"]
) -> Similarity:
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
    chosen = part.zone_samples
    _, nearest = surface.tree.query(keys[chosen])
    left, facing = placed[chosen] - surface.cloud.points[nearest], surface.cloud.normals[nearest]
    plane, away = np.abs(np.einsum("ij,ij->i", left, facing)), np.linalg.norm(left, axis=1)
    alike = np.einsum("ij,ij->i", normals[chosen], facing) > 0.5
    limit = MATCHED * min(size, 2 * _PART_MM)
    near = (plane < limit) & (away < 2.5 * limit) & alike
    rms = float(np.sqrt((plane[near] ** 2).mean())) if near.any() else float(size)
    back = np.sort(cKDTree(placed[: part.skin]).query(surface.cloud.points[surface.spread])[0])
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
        reach = max(3.0 * float(np.median(away)), 2.0 * MATCHED * min(size, 2 * _PART_MM))
        weight = np.clip(1.0 - (away / reach) ** 2, 0.0, None) * (alike > 0.4) * ~surface.rim[nearest]
        wanted = now + facing * np.einsum("ij,ij->i", facing, goal - now)[:, None] - start
        system = (stiff * laplacian + diags(weight + 1e-6)).tocsc()
        now = start + splu(system).solve(weight[:, None] * wanted)
    return replace(fit, points=np.concatenate([now, _carried(fit.points[skin:], start, now - start)]))


def held_by(fit: PartFit, marks: Marks) -> PartFit:
    """The same fit drawn onto known landmarks by the smoothest field, wherever the surface is."""
    skin = fit.part.skin
    start = fit.points[:skin]
    wanted = marks.points - fit.points[marks.rows]
    on_skin = marks.rows < skin
    weight, goal = np.zeros(skin), np.zeros((skin, 3))
    weight[marks.rows[on_skin]], goal[marks.rows[on_skin]] = 1e3, wanted[on_skin]
    laplacian = graph_laplacian(fit.part.faces, skin)
    bending = laplacian @ laplacian
    moves = splu((bending + diags(weight + 1e-7)).tocsc()).solve(weight[:, None] * goal)
    points = np.concatenate([start + moves, _carried(fit.points[skin:], start, moves)])
    points[marks.rows] = marks.points
    return replace(fit, points=points)


def _carried(joints: np.ndarray, skin: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """The joints moved as the skin around them is on average."""
    if not len(joints):
        return joints
    near, which = cKDTree(skin).query(joints, k=40)
    share = 1.0 / np.maximum(near, 1e-6) ** 2
    return joints + np.einsum("jk,jki->ji", share / share.sum(1, keepdims=True), moves[which])
