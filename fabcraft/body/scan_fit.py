"""Finding the head in a scan: the baked model of people is laid onto it.

The 24 axis-aligned orientations are each aligned by ICP; from the best one the coefficients of the model are
fitted by alternating closest points and ridge regression, with the preset at the start as the prior.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64, Int64
from scipy.spatial import cKDTree

from fabcraft.body.body import NECK_BELOW_ROOT_MM, Body
from fabcraft.body.human import HumanModel, human_model
from fabcraft.geometry.align import Similarity, axis_rotations, fit_similarity, similarity_icp, spread_points
from fabcraft.mesh import Mesh

_COARSE, _FINE = 700, 3000
"""Points of the two stages."""
_SKULL_MM = 200.0
"""Height from the crown that the first placement looks at."""
_NORMAL_MM = 10.0
"""Distance that a right angle between normals counts as, about, when pairs are chosen."""
_SIZES = (0.75, 1.33)
"""Size of a head against the model's."""


@dataclass(frozen=True, eq=False)
class HeadFit:
    """Where the head is in a scan."""

    place: Similarity
    """Scan to body frame; scale exactly 1."""
    person: Body
    """The fitted person in the body frame."""
    size: float
    """Size of the head against the fitted model's natural one."""
    face_rms_mm: float
    """Root mean square distance from the fitted face to the scan."""
    misfit_mm: float
    """That, plus the mean distance of the scan from the fitted person, its farthest fifth left out."""
    matched: float
    """Share of the fitted face that has the scan within 4 mm."""


def fit_head(scan: Mesh) -> HeadFit:
    """The best fit of a person's head to `scan` (mm; any axis-aligned orientation, within 30 degrees)."""
    model = human_model()
    adult = (model.presets["man"] + model.presets["woman"]) / 2
    template = model.body(adult, "adult")
    head = _head_vertices(template)
    points, normals = _samples(scan, _COARSE)
    goal = head[spread_points(template.mesh.vertices[head], _COARSE)]
    pairing = (points, template.mesh.vertices[goal], normals, template.mesh.vertex_normals[goal])

    def aligned(start: Similarity, iterations: int) -> Similarity:
        return similarity_icp(*pairing, start, iterations, normal_weight=25.0)

    def misfit(place: Similarity) -> float:
        return _misfit(place, *pairing)

    starts = [_crown_on_crown(points, pairing[1], rotation) for rotation in axis_rotations()]
    promising = sorted((aligned(start, 6) for start in starts), key=misfit)[:6]
    upright = sorted((aligned(start, 30) for start in promising), key=misfit)[:3]
    skin = template.mesh.vertices
    rough = [(place, _deformed(model, adult, head, skin, scan, place, 5)) for place in upright]
    place = min(rough, key=lambda pair: pair[1].misfit_mm)[0]
    fits = [_deformed(model, start, head, skin, scan, place, 14) for start in model.presets.values()]
    return min(fits, key=lambda fit: fit.misfit_mm)


def _head_vertices(person: Body) -> Int64[np.ndarray, " H"]:
    """The skin above the middle of the neck's root region."""
    floor = person.joints["neck_root"][2] - NECK_BELOW_ROOT_MM / 2
    return np.flatnonzero(person.mesh.vertices[:, 2] > floor)


def _samples(scan: Mesh, count: int) -> tuple[Float64[np.ndarray, "N 3"], Float64[np.ndarray, "N 3"]]:
    """At most `count` points of the scan, evenly spread, and their normals."""
    chosen = spread_points(scan.vertices, count)
    return scan.vertices[chosen], scan.vertex_normals[chosen]


def _crown_on_crown(
    points: Float64[np.ndarray, "N 3"], goal: Float64[np.ndarray, "M 3"], rotation: Float64[np.ndarray, "3 3"]
) -> Similarity:
    """The turned scan with its top on the model's top and the middles of both skulls over each other."""
    turned = points @ rotation.T

    def anchor(cloud: np.ndarray) -> np.ndarray:
        top = cloud[:, 2].max()
        skull = cloud[cloud[:, 2] > top - _SKULL_MM]
        return np.append((skull[:, :2].min(0) + skull[:, :2].max(0)) / 2, top)

    return Similarity(1.0, rotation, anchor(goal) - anchor(turned))


def _misfit(
    fit: Similarity,
    points: Float64[np.ndarray, "N 3"],
    goal: Float64[np.ndarray, "M 3"],
    normals: Float64[np.ndarray, "N 3"],
    goal_normals: Float64[np.ndarray, "M 3"],
) -> float:
    """Mean distance both ways over positions and normals, the farthest fifth left out."""
    moved = np.hstack([fit.points(points), 15.0 * normals @ fit.rotation.T])
    fixed = np.hstack([goal, 15.0 * goal_normals])
    both = [cKDTree(fixed).query(moved)[0], cKDTree(moved).query(fixed)[0]]
    return float(sum(np.sort(side)[: int(0.8 * len(side))].mean() for side in both))


def _deformed(
    model: HumanModel,
    start: Float32[np.ndarray, " K"],
    head: Int64[np.ndarray, " H"],
    aligned: Float64[np.ndarray, "V 3"],
    scan: Mesh,
    rough: Similarity,
    rounds: int,
) -> HeadFit:
    """The coefficients and the similarity that bring the model's head onto the scan, beginning at `start`.

    aligned : the skin that `rough` brings the scan onto.
    """
    tree = cKDTree(np.hstack([scan.vertices, _NORMAL_MM * scan.vertex_normals]))
    used = head[spread_points(model.mean[head].astype(np.float64), _FINE)]
    basis = model.basis[:, used].astype(np.float64)
    basis -= basis.mean(1, keepdims=True)  # where the head is in space is the similarity's part
    coefficients = start
    # the person at the start stands elsewhere in space than the one that was aligned: head on head
    shape = model.body(start, "fit").mesh.vertices[head]
    place = fit_similarity(shape, rough.inverse().points(aligned[head]))
    # pairs are sought from the model alone, which would let a free scale shrink it into the scan
    sizes = (max(0.93 * place.scale, _SIZES[0]), min(1.07 * place.scale, _SIZES[1]))
    for step in range(rounds):
        person = model.body(coefficients, "fit")
        shape, facing = person.mesh.vertices[used], person.mesh.vertex_normals[used]
        placed = np.hstack([place.points(shape), _NORMAL_MM * facing @ place.rotation.T])
        distance, nearest = tree.query(placed)
        good = distance < max(np.quantile(distance, 0.8), 2.0)
        goal = scan.vertices[nearest[good]]
        place = fit_similarity(shape[good], goal, sizes)
        if step < 3:
            continue
        wanted = place.inverse().points(goal) - shape[good]
        prior_mm = 6.0 if step < 7 else 1.5
        step_by = _regressed(basis[:, good], wanted, (coefficients - start).astype(np.float64), prior_mm)
        coefficients = coefficients + step_by.astype(np.float32)
        place = fit_similarity(model.body(coefficients, "fit").mesh.vertices[used][good], goal, sizes)
    return _judged(model, coefficients, place, scan)


def _regressed(
    basis: Float64[np.ndarray, "K N 3"],
    wanted: Float64[np.ndarray, "N 3"],
    away: Float64[np.ndarray, " K"],
    prior_mm: float,
) -> Float64[np.ndarray, " K"]:
    """The change d of the coefficients: min mean |B d - wanted|² + prior² mean (away + d)²."""
    flat, count = basis.reshape(len(basis), -1), len(wanted)
    ridge = prior_mm**2 / len(basis)
    left = flat @ flat.T / count + ridge * np.eye(len(basis))
    return np.linalg.solve(left, flat @ (wanted - wanted.mean(0)).ravel() / count - ridge * away)


def _judged(
    model: HumanModel, coefficients: Float32[np.ndarray, " K"], place: Similarity, scan: Mesh
) -> HeadFit:
    """The fitted person in the body frame at the scan's own size, and how well the face matches."""
    points = model.mean + np.tensordot(coefficients, model.basis, 1)
    person = model.body_at(place.scale * points.astype(np.float64), "fit")
    back = Similarity(1.0, place.rotation, place.translation).inverse()
    moved = back.points(scan.vertices)
    distance = cKDTree(moved).query(person.mesh.vertices[_face_vertices(person)])[0]
    rms = float(np.sqrt((distance**2).mean()))
    beyond = np.sort(cKDTree(person.mesh.vertices).query(back.points(_samples(scan, _FINE)[0]))[0])
    misfit = rms + float(beyond[: int(0.8 * len(beyond))].mean())
    return HeadFit(back, person, place.scale, rms, misfit, float((distance < 4.0).mean()))


def _face_vertices(person: Body) -> Int64[np.ndarray, " N"]:
    """From menton to 30 mm above glabella, before the ears."""
    at, vertices = person.landmarks, person.mesh.vertices
    low, high, back = at["menton"][2], at["glabella"][2] + 30.0, at["tragion_left"][1] - 10.0
    return np.flatnonzero((vertices[:, 2] > low) & (vertices[:, 2] < high) & (vertices[:, 1] < back))
