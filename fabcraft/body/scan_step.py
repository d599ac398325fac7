"""One Gauss-Newton step of laying a part onto a scan.

Unknowns: a turn, a shift and a size of the whole; the coefficients c of the person; a turn of every bone.  The step
minimises  mean w (n·(x - q))² + a |x - q|²  + r (|c|² + (log s / 0.06)² + sum |angle / sd|²),  where q is the closest
point of the scan with normal n (Chen and Medioni 1992; a little of the point distance keeps sliding in bounds).  c is in
standard deviations of the population and s near 1, so r is the variance of a reading over the number of independent
ones: the most probable person.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from fabcraft.body.scan_part import PartModel
from fabcraft.body.scan_pose import Turns, angles, posed, turned_by
from fabcraft.body.scan_search import Cloud
from fabcraft.geometry.align import Similarity, fit_similarity, spread_points

_BACK = 1200
"""Points of the scan that seek their partner on the part."""
_ROUGH_POINTS = 5000
_NORMAL_SHARE = 0.05
"""Distance, as a share of the part's size, that a right angle between normals counts as, about."""
_NEAR = 0.025
"""Share of the part's size up to which a partner always counts: bent fingers are few beside a palm that fits."""
_SLIDING = 0.08
"""Weight of the point distance beside the distance to the plane."""
_READING, _READINGS = 0.006, 100.0
"""Standard deviation of a distance against the part's size, and how many independent ones a scan gives."""
PART_MM = 300.0
"""A whole body is read no less exactly than a part of this size."""
_SIZE_SD = 0.06
"""Standard deviation of the natural logarithm of s."""
_WHOLE = 7
"""Unknowns of the whole: turn (3), shift (3), size (1)."""


@dataclass(frozen=True, eq=False)
class Surface:
    """The scan as the fit sees it."""

    cloud: Cloud
    rim: Bool[np.ndarray, " N"]
    """Points at a border, beyond which the scan may go on unseen."""
    size: float
    """Of the part's zone in the scan, mm."""
    tree: cKDTree
    """Of the points and weighted normals."""
    spread: Int64[np.ndarray, " B"]
    """Some of the points, evenly spread."""

    @staticmethod
    def of(cloud: Cloud, rim: Bool[np.ndarray, " N"], size: float) -> "Surface":
        """The surface for a part whose zone is `size` mm large."""
        tree = cKDTree(np.hstack([cloud.points, _NORMAL_SHARE * size * cloud.normals]))
        return Surface(cloud, rim, size, tree, spread_points(cloud.points, _BACK))

    @cached_property
    def rough(self) -> "Surface":
        """The same in few points, for the steps that find the way."""
        chosen = spread_points(self.cloud.points, _ROUGH_POINTS)
        cloud = Cloud(self.cloud.points[chosen], self.cloud.normals[chosen])
        return Surface.of(cloud, self.rim[chosen], self.size)

    def nearest(
        self, points: Float64[np.ndarray, "M 3"], normals: Float64[np.ndarray, "M 3"]
    ) -> Int64[np.ndarray, " M"]:
        """The point of the scan that is near in place and normal to each of `points`."""
        return self.tree.query(self.keys(points, normals))[1]

    def keys(
        self, points: Float64[np.ndarray, "M 3"], normals: Float64[np.ndarray, "M 3"]
    ) -> Float64[np.ndarray, "M 6"]:
        """Points and normals as the tree compares them."""
        return np.hstack([points, _NORMAL_SHARE * self.size * normals])


@dataclass(frozen=True, eq=False)
class Marks:
    """Landmarks whose place in the scan is known."""

    rows: Int64[np.ndarray, " M"]
    """Rows of the part's points."""
    points: Float64[np.ndarray, "M 3"]


@dataclass(frozen=True, eq=False)
class State:
    """A person, how they hold themselves, and where they are in the scan."""

    coefficients: Float64[np.ndarray, " L"]
    turns: Turns
    place: Similarity

    def points(self, part: PartModel) -> Float64[np.ndarray, "P 3"]:
        """Skin and joints in the scan."""
        return self.place.points(posed(part.points(self.coefficients), part.bones, self.turns)[0])


def at_rest(part: PartModel, start: Similarity, origin: Float64[np.ndarray, " L"]) -> State:
    """The likely person who is as large as the one of `origin` at the scale of `start`, in the model's pose."""
    used = part.few
    basis = part.basis[:, used]
    flat = (basis - basis.mean(1, keepdims=True)).reshape(len(basis), -1)
    scaled = start.scale * (part.mean[used] + np.tensordot(origin, basis, 1))
    wanted = scaled - part.mean[used]
    wanted = (wanted - wanted.mean(0)).ravel()
    ridge = _ridge(float(np.ptp(part.mean[part.zone], axis=0).max())) * len(used)
    coefficients = np.linalg.solve(flat @ flat.T + ridge * np.eye(len(basis)), flat @ wanted)
    likely = part.mean[used] + np.tensordot(coefficients, basis, 1)
    turns = np.broadcast_to(np.eye(3), (len(part.bones), 3, 3)).copy()
    return State(coefficients, turns, fit_similarity(likely, start.points(scaled / start.scale)))


def stepped(
    part: PartModel,
    used: Int64[np.ndarray, " S"],
    surface: Surface,
    state: State,
    marks: Marks | None,
    stiff: float,
    reach: float,
) -> State:
    """The state after one step; above 1, `stiff` holds the person where they are.

    used : the part's vertices that seek the scan.  reach : distance up to which they look for it, mm, even where most
    of them are nearer.
    """
    points, spins = posed(part.points(state.coefficients), part.bones, state.turns)
    place = state.place
    normals = part.mesh(points).vertex_normals[used] @ place.rotation.T
    moved = place.points(points)
    middle = moved[used].mean(0)
    columns = _columns(part, used, points, spins, moved - middle, place)
    matrix, goal = _readings(columns, moved[used], normals, surface, reach)
    if marks is not None:
        held = _columns(part, marks.rows, points, spins, moved - middle, place).reshape(len(columns), -1)
        matrix = matrix + held @ held.T / len(marks.rows)
        goal = goal + held @ (marks.points - moved[marks.rows]).ravel() / len(marks.rows)
    change = _solved(part, matrix, goal, state, stiff, surface.size)
    shape = slice(_WHOLE, _WHOLE + len(state.coefficients))
    steps = change[shape.stop :].reshape(-1, 3)
    return State(
        state.coefficients + change[shape],
        turned_by(part.bones, state.turns, spins, _bounded(steps)),
        _moved(place, change[:_WHOLE], middle),
    )


def _columns(
    part: PartModel,
    rows: Int64[np.ndarray, " N"],
    points: Float64[np.ndarray, "P 3"],
    spins: Float64[np.ndarray, "P 3 3"],
    about: Float64[np.ndarray, "P 3"],
    place: Similarity,
) -> Float64[np.ndarray, "D N 3"]:
    """How the points `rows` move in the scan with each unknown.

    points, spins : posed, in the part's frame; about : in the scan's, from the middle that everything turns about.
    """
    units = np.eye(3)
    turns = np.stack([np.cross(unit, about[rows]) for unit in units])
    shifts = np.broadcast_to(units[:, None, :], turns.shape)
    shapes = np.einsum("nij,lnj->lni", place.scale * place.rotation @ spins[rows], part.basis[:, rows])
    bones = [
        place.scale
        * bone.weights[rows, None]
        * np.cross(unit, points[rows] - points[bone.joint])
        @ place.rotation.T
        for bone in part.bones
        for unit in units
    ]
    return np.concatenate([turns, shifts, about[None, rows], shapes, *([np.stack(bones)] if bones else [])])


def _readings(
    columns: Float64[np.ndarray, "D M 3"],
    moved: Float64[np.ndarray, "M 3"],
    normals: Float64[np.ndarray, "M 3"],
    surface: Surface,
    reach: float,
) -> tuple[Float64[np.ndarray, "D D"], Float64[np.ndarray, " D"]]:
    """(matrix, right side) of the distances, a mean over the pairs."""
    model, scan, weight = _pairs(moved, normals, surface, reach)
    facing = surface.cloud.normals[scan]
    left = surface.cloud.points[scan] - moved[model]
    each = weight[:, None, None] * (facing[:, :, None] * facing[:, None, :] + _SLIDING * np.eye(3))
    # the pairs of a vertex together are one 3 x 3 matrix, which keeps the large product small
    held, pull = np.zeros((len(moved), 3, 3)), np.zeros((len(moved), 3))
    np.add.at(held, model, each)
    np.add.at(pull, model, np.einsum("nij,nj->ni", each, left))
    total = max(float(weight.sum()), 1e-9)
    flat = columns.reshape(len(columns), -1)
    weighted = np.einsum("dni,nij->dnj", columns, held).reshape(len(columns), -1)
    return weighted @ flat.T / total, flat @ pull.ravel() / total


def _pairs(
    moved: Float64[np.ndarray, "M 3"], normals: Float64[np.ndarray, "M 3"], surface: Surface, reach: float
) -> tuple[Int64[np.ndarray, " N"], Int64[np.ndarray, " N"], Float64[np.ndarray, " N"]]:
    """(sample, point of the scan, weight) of the closest pairs both ways; over a border, turned away or far off: none."""
    keys, backward = surface.keys(moved, normals), surface.spread
    ahead = surface.tree.query(keys)[1]
    back = cKDTree(keys).query(surface.tree.data[backward])[1]
    model = np.concatenate([np.arange(len(moved)), back])
    scan = np.concatenate([ahead, backward])
    away = np.linalg.norm(moved[model] - surface.cloud.points[scan], axis=1)
    alike = np.einsum("ij,ij->i", normals[model], surface.cloud.normals[scan])
    near = max(2.5 * float(np.median(away[: len(moved)])), _NEAR * surface.size)
    limit = np.full(len(away), near)  # the scan may show more than the part: only the part looks far
    limit[: len(moved)] = max(near, reach)
    weight = np.clip(1.0 - (away / limit) ** 2, 0.0, None) ** 2 * (alike > 0.3) * ~surface.rim[scan]
    weight[len(moved) :] *= len(moved) / max(len(backward), 1) * 0.5
    kept = np.flatnonzero(weight > 0)
    return model[kept], scan[kept], weight[kept]


def _solved(
    part: PartModel,
    matrix: Float64[np.ndarray, "D D"],
    goal: Float64[np.ndarray, " D"],
    state: State,
    stiff: float,
    size: float,
) -> Float64[np.ndarray, " D"]:
    """The step with the prior; above 1, `stiff` draws to where the person is instead of to the average one."""
    ridge = _ridge(size)
    sd = np.repeat([bone.sd for bone in part.bones], 3)
    weights = ridge * np.concatenate([np.ones(len(state.coefficients)), 1.0 / sd**2])
    away = np.concatenate([state.coefficients, angles(state.turns).ravel()])
    matrix, goal = matrix.copy(), goal.copy()
    matrix[np.diag_indices(_WHOLE)] += 1e-9 * np.trace(matrix)
    matrix[6, 6] += ridge / _SIZE_SD**2
    goal[6] -= ridge / _SIZE_SD**2 * np.log(state.place.scale)
    person = np.arange(_WHOLE, len(goal))
    matrix[person, person] += stiff * weights
    if stiff <= 1:
        goal[person] -= weights * away
    return np.linalg.solve(matrix, goal)


def _ridge(size: float) -> float:
    """Weight of the prior against a mean squared distance."""
    return (_READING * min(size, PART_MM)) ** 2 / _READINGS


def _bounded(steps: Float64[np.ndarray, "B 3"]) -> Float64[np.ndarray, "B 3"]:
    """Small rotations, none above 20 degrees."""
    angle = np.linalg.norm(steps, axis=1, keepdims=True)
    return steps * np.minimum(1.0, np.radians(20.0) / np.maximum(angle, 1e-12))


def _moved(
    place: Similarity, change: Float64[np.ndarray, "7"], middle: Float64[np.ndarray, "3"]
) -> Similarity:
    """The similarity turned and resized about `middle`, then shifted."""
    turn = Rotation.from_rotvec(change[:3]).as_matrix()
    grow = float(np.exp(np.clip(change[6], -0.1, 0.1)))
    shift = grow * turn @ (place.translation - middle) + middle + change[3:6]
    return Similarity(grow * place.scale, turn @ place.rotation, shift)
