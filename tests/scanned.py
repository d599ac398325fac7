"""Scans of known people: parts of the baked model, damaged and written the way scanners do it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh

from fabcraft.body.body import Body
from fabcraft.body.measures import tapes
from fabcraft.body.parts import cut_of
from fabcraft.geometry.align import fit_similarity
from fabcraft.mesh import Mesh, concatenate

Y_UP = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
"""Z up, facing -y, becomes Y up, facing +z."""


def somebody(body: Body, off_mm=1.5, seed=5) -> Body:
    """`body` changed by a smooth field, waves of 80 to 240 mm, that the model of people does not have."""
    rng = np.random.default_rng(seed)
    waves = rng.normal(size=(12, 3))
    waves *= (2 * np.pi / rng.uniform(80.0, 240.0, 12) / np.linalg.norm(waves, axis=1))[:, None]
    phases, moves = rng.uniform(0, 2 * np.pi, 12), rng.normal(size=(12, 3))
    moves *= off_mm / np.sqrt(0.5 * (moves**2).sum())

    def changed(points):
        return points + np.sin(points @ waves.T + phases) @ moves

    return replace(
        body,
        mesh=body.mesh.with_vertices(changed(body.mesh.vertices)),
        landmarks={name: changed(point) for name, point in body.landmarks.items()},
        joints={name: changed(point) for name, point in body.joints.items()},
    )


def opened(body: Body, name: str, below_mm=0.0) -> Mesh:
    """The part `name` of `body` without its flat cuts, and without what lies up to `below_mm` before them."""
    part = body.part(name)
    inside = np.ones(len(part.mesh.faces), dtype=bool)
    for point, normal in cut_of(name, body.name, body.joints, body.landmarks).planes:
        inside &= ((part.mesh.corners - point) @ normal).min(1) > below_mm + 0.01
    return part.mesh.submesh(inside)


def holed(mesh: Mesh, middle, radius_mm: float) -> Mesh:
    """`mesh` without its faces around `middle`."""
    away = np.linalg.norm(mesh.corners.mean(1) - middle, axis=1)
    return mesh.submesh(away > radius_mm)


def dense(mesh: Mesh, least: int) -> Mesh:
    """`mesh` with every face in four, again and again, up to at least that many."""
    vertices, faces = mesh.vertices, mesh.faces
    while len(faces) < least:
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    return Mesh(vertices, faces.astype(np.int32), mesh.name)


def noisy(mesh: Mesh, sd_mm: float) -> Mesh:
    """Every vertex moved along its normal by a random length."""
    steps = np.random.default_rng(3).normal(0.0, sd_mm, (len(mesh.vertices), 1))
    return mesh.with_vertices(mesh.vertices + steps * mesh.vertex_normals)


def inside_out(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices, mesh.faces[:, ::-1], mesh.name)


def with_crumb(mesh: Mesh) -> Mesh:
    """`mesh` with a little ball beside it."""
    ball = trimesh.creation.icosphere(1, radius=4.0)
    return concatenate([mesh, Mesh(np.array(ball.vertices) + mesh.bounds[1], ball.faces.astype(np.int32))])


def saved(path: Path, mesh: Mesh, matrix=None, scale=1.0) -> Path:
    vertices = scale * (mesh.vertices if matrix is None else mesh.vertices @ np.asarray(matrix).T)
    trimesh.Trimesh(vertices, mesh.faces, process=False).export(path)
    return path


def landmark_errors(body: Body, truth: Body) -> dict[str, float]:
    """Distance of every landmark that both have, mm, up to the rigid movement that a scan does not tell."""
    names = sorted(body.landmarks.keys() & truth.landmarks.keys())
    ours = np.stack([body.landmarks[name] for name in names])
    true = np.stack([truth.landmarks[name] for name in names])
    back = fit_similarity(ours, true, (1.0, 1.0))
    return dict(zip(names, np.linalg.norm(back.points(ours) - true, axis=1).tolist(), strict=True))


def girth_errors(body: Body, truth: Body) -> dict[str, float]:
    """Measure of `body` less the true one, mm, of every measure that both have."""
    ours, true = tapes(body), tapes(truth)
    return {name: ours[name].length_mm - true[name].length_mm for name in ours if name in true}
