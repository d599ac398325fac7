"""After the loop, the promise: a soft penalty leaves residues, so the object is settled and pushed out by exact distances.

`settle_rigidly` moves the whole object, first along, then turning a little too, so that it lacks as little clearance as it
can: what a shift can mend should not become a dent. `push_out` then mends the rest in rounds of: exact signed distance at
vertices and face centres, the missing clearance along the distance's gradient, spread over the neighbourhood so that the
push is a swell and not a dent, and lifted until nothing is missing. `clear` repeats it until samples agree.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float64
from scipy.sparse.linalg import splu

from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.operators import laplacian
from fabcraft.mesh import Mesh

_RESEATED = 6


@dataclass(frozen=True, eq=False)
class Settled:
    """An object moved as a whole."""

    mesh: Mesh
    shift_mm: Float64[np.ndarray, "3"]
    """How far its middle moved."""
    turn_deg: float
    """How far it turned."""


def settle_rigidly(
    mesh: Mesh,
    distance: SurfaceDistance,
    wanted_mm: Float64[np.ndarray, " V"],
    most_mm: float = 5.0,
    most_deg: float = 5.0,
    rounds: int = 12,
    tolerance_mm: float = 0.02,
) -> Settled:
    """Lower the mean over vertices and face centres of max(0, wanted − s)² by a translation, then by a turn as well.

    Damped Gauss-Newton steps that are taken only when the exact value falls, and never farther than `most_mm` and
    `most_deg` in all. An object that lacks no more than the tolerance stays where it is.
    """
    weights = _sample_weights(mesh)
    middle = mesh.vertices.mean(0)
    points, turned, shift = mesh.vertices, np.eye(3), np.zeros(3)
    for turning in (False, True):
        for _ in range(rounds):
            lacking, direction = _lacking(points, mesh.faces, distance, wanted_mm)
            energy = float(weights @ lacking**2)
            if lacking.max(initial=0.0) <= tolerance_mm:
                break
            step = _rigid_step(points, mesh.faces, lacking, direction, weights, middle + shift, turning)
            for damping in (1.0, 0.5, 0.25, 0.1):
                rotation, along = _rotation(damping * step[3:]) @ turned, shift + damping * step[:3]
                too_far = np.linalg.norm(along) > most_mm or _angle_deg(rotation) > most_deg
                moved = (mesh.vertices - middle) @ rotation.T + middle + along
                now = (
                    np.inf
                    if too_far
                    else float(weights @ _lacking(moved, mesh.faces, distance, wanted_mm)[0] ** 2)
                )
                if now < energy:
                    break
            if now >= 0.98 * energy:  # not worth going astray for less
                break
            points, turned, shift = moved, rotation, along
    return Settled(mesh.with_vertices(points), shift, _angle_deg(turned))


def reseated(
    mesh: Mesh, origin: Float64[np.ndarray, "V 3"], lock: Float64[np.ndarray, " F"], spread_mm: float
) -> tuple[Mesh, float]:
    """The mesh with its locked faces back on the surface that they were built on, and the largest move, mm.

    origin : where every vertex was built.  lock : how much each face is locked; wholly locked ones come back wholly, and the
    move is felt about `spread_mm` around.  They come back along the normals: what has spread along the surface stays there.
    """
    held = mesh.faces[lock >= 1.0]
    if len(held) == 0:
        return mesh, 0.0
    rows = np.unique(held)
    built = SurfaceDistance(Mesh(origin, held))
    spread = spreading(mesh, spread_mm)
    points, first = mesh.vertices.copy(), 0.0
    for rounds in range(_RESEATED):
        found = built.closest(points[rows])
        normals = built.mesh.face_normals[found.faces]
        # off the planes of the faces: beyond its border the surface goes on as it was
        off = np.einsum("ij,ij->i", points[rows] - found.points, normals)[:, None] * normals
        first = max(first, float(np.linalg.norm(off, axis=1).max()))
        back = np.zeros_like(points)
        back[rows] = -off
        points += back if rounds == _RESEATED - 1 else spread(back)
    return mesh.with_vertices(points), first


def clear(
    mesh: Mesh,
    distance: SurfaceDistance,
    wanted_mm: Float64[np.ndarray, " V"],
    spread_mm: float = 5.0,
    tolerance_mm: float = 0.02,
) -> tuple[Mesh, float]:
    """`push_out`, repeated with more clearance where the body still stands between vertices and face centres.

    Returns the mesh and the largest push, mm.
    """
    asked, largest = wanted_mm.copy(), 0.0
    for _ in range(6):
        mesh, pushed = push_out(mesh, distance, asked, spread_mm, tolerance_mm=tolerance_mm)
        largest = max(largest, pushed)
        corner = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4], [0, 3, 3], [3, 0, 3], [3, 3, 0]]) / 6.0
        samples = np.einsum("sk,fkd->fsd", corner, mesh.corners).reshape(-1, 3)
        lacking = np.einsum("sk,fk->fs", corner, wanted_mm[mesh.faces]) - distance.signed(samples).reshape(
            -1, 6
        )
        worst = lacking.max(1)
        if worst.max(initial=0.0) <= 1.5 * tolerance_mm:
            break
        extra = np.zeros(len(asked))
        np.maximum.at(extra, mesh.faces.ravel(), np.repeat(np.maximum(worst, 0.0), 3))
        asked = asked + 1.1 * extra
    return mesh, largest


def push_out(
    sheet: Mesh,
    distance: SurfaceDistance,
    wanted_mm: Float64[np.ndarray, " V"],
    spread_mm: float = 5.0,
    rounds: int = 8,
    tolerance_mm: float = 0.02,
) -> tuple[Mesh, float]:
    """`sheet` with every vertex and face centre at least `wanted_mm` from the body, and the largest push, mm.

    wanted_mm : distance to the skin per vertex.  spread_mm : how wide a push is felt.
    """
    spread = spreading(sheet, spread_mm)
    points, largest = sheet.vertices.copy(), 0.0
    for _ in range(rounds):
        missing, direction = _missing(points, sheet.faces, distance, wanted_mm)
        if missing.max(initial=0.0) <= tolerance_mm:
            break
        largest = max(largest, float(missing.max()))
        points += lifted(spread, missing, direction)
    return sheet.with_vertices(points), largest


def spreading(
    mesh: Mesh, spread_mm: float
) -> Callable[[Float64[np.ndarray, "V 3"]], Float64[np.ndarray, "V 3"]]:
    """What spreads moves of single vertices over about `spread_mm` and keeps their mean: (M + r² L) x = M b, a screened
    Laplacian."""
    mass = np.bincount(mesh.faces.ravel(), np.repeat(mesh.face_areas / 3.0, 3), minlength=len(mesh.vertices))
    solver = splu((sparse.diags(mass) + spread_mm**2 * laplacian(mesh.vertices, mesh.faces)).tocsc())
    return lambda moves: solver.solve(mass[:, None] * moves)


def lifted(
    spread: Callable[[Float64[np.ndarray, "V 3"]], Float64[np.ndarray, "V 3"]],
    missing_mm: Float64[np.ndarray, " V"],
    way: Float64[np.ndarray, "V 3"],
) -> Float64[np.ndarray, "V 3"]:
    """The push by what is missing along `way` (unit, or 0 where nothing is), spread, and whole where it is missing."""
    push = spread(missing_mm[:, None] * way)
    # the spread push is too weak at its peak: the rest is added there
    return push + np.maximum(missing_mm - (push * way).sum(1), 0.0)[:, None] * way


def _missing(
    points: np.ndarray, faces: np.ndarray, distance: SurfaceDistance, wanted_mm: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Per vertex, how much its own or its faces' clearance lacks, and the way out."""
    lacking, gradient = _lacking(points, faces, distance, wanted_mm)
    missing = lacking[: len(points)].copy()
    for corner in range(3):
        np.maximum.at(missing, faces[:, corner], lacking[len(points) :])
    return missing, gradient[: len(points)]


def _lacking(
    points: np.ndarray, faces: np.ndarray, distance: SurfaceDistance, wanted_mm: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The clearance that each vertex, then each face centre lacks, and the way out."""
    signed, gradient = distance.signed_with_gradient(np.concatenate([points, points[faces].mean(1)]))
    return np.maximum(np.concatenate([wanted_mm, wanted_mm[faces].mean(1)]) - signed, 0.0), gradient


def _sample_weights(mesh: Mesh) -> np.ndarray:
    """Share of the area that each vertex and face centre stands for."""
    areas = mesh.face_areas
    owned = np.bincount(mesh.faces.ravel(), np.repeat(areas / 3.0, 3), minlength=len(mesh.vertices))
    return np.concatenate([owned, areas]) / (2.0 * areas.sum())


def _rigid_step(
    points: np.ndarray,
    faces: np.ndarray,
    lacking: np.ndarray,
    direction: np.ndarray,
    weights: np.ndarray,
    middle: np.ndarray,
    turning: bool,
) -> np.ndarray:
    """(6,) translation, then rotation vector, that makes up for what is lacking in the least squares sense."""
    arms = np.concatenate([points, points[faces].mean(1)]) - middle
    columns = np.hstack([direction, np.cross(arms, direction)]) if turning else direction
    touching = lacking > 0.0
    scaled = columns[touching] * weights[touching, None]
    matrix = scaled.T @ columns[touching]
    # damping as for a sphere: along the skin little is gained, so little should move
    arm = float(np.sqrt((arms**2).sum(1).mean()))
    unit = np.array([1.0, 1.0, 1.0, arm, arm, arm])[: len(matrix)] ** 2
    damped = matrix + 0.02 * np.trace(matrix[:3, :3]) * np.diag(unit)
    found = np.linalg.solve(damped, scaled.T @ lacking[touching])
    return np.concatenate([found, np.zeros(6 - len(found))])


def _rotation(vector: np.ndarray) -> np.ndarray:
    """The rotation about `vector` by its length, radians (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def _angle_deg(rotation: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(0.5 * (np.trace(rotation) - 1.0), -1.0, 1.0))))
