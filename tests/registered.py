"""Guidance meshes as image-to-3D models give them: any axes and scale, with clutter; and how they come back."""

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from fabcraft.geometry.align import Similarity, axis_rotations, fit_similarity
from fabcraft.mesh import Mesh, concatenate

SCALES = (0.004, 1.0, 37.0)


def given(mesh, rotation, scale, seed, cluttered=True):
    """`mesh` turned, scaled and shifted, with clutter of a fifth of its area, vertices first; and the similarity."""
    pose = Similarity(scale, rotation, scale * np.array([30.0, -70.0, 15.0]))
    whole = concatenate([mesh, *clutter(mesh, seed)]) if cluttered else mesh
    return whole.with_vertices(pose.points(whole.vertices)), pose


def clutter(mesh, seed, share=0.2):
    """A floor plate under the mesh (half of the area), crumbs around it and lumps stuck to it (a quarter each)."""
    rng, area = np.random.default_rng(seed), share * mesh.area_mm2
    low, high = mesh.bounds
    middle, size = 0.5 * (low + high), high - low
    side = np.sqrt(0.25 * area)
    plate = trimesh.creation.box((side, side, 0.01 * size.max()))
    plate.apply_translation((middle[0], middle[1], low[2] - 0.012 * size.max()))
    parts = [plate]
    for count, apart in ((6, True), (5, False)):
        radius = np.sqrt(0.25 * area / count / (4.0 * np.pi))
        for _ in range(count):
            direction = rng.normal(size=3)
            direction /= np.linalg.norm(direction)
            at = middle + direction * (0.45 + 0.2 * rng.random()) * np.linalg.norm(size)
            if not apart:
                at = mesh.vertices[rng.integers(len(mesh.vertices))]
            ball = trimesh.creation.icosphere(2, radius)
            ball.apply_translation(at)
            parts.append(ball)
    return [Mesh(np.array(part.vertices), np.array(part.faces, dtype=np.int32)) for part in parts]


def shaken(mesh, seed, share=0.002):
    """Noise on the vertices, as a share of the size."""
    noise = np.random.default_rng(seed).normal(size=mesh.vertices.shape) * share * mesh.size_mm.max()
    return mesh.with_vertices(mesh.vertices + noise)


def error(found, pose, truth, mesh):
    """(degrees, share of the scale, share of the size that the middle is off) of a placement `found` of the mesh that
    was given by `pose`, against its `truth`."""
    should = fit_similarity(pose.points(mesh.vertices), truth.points(mesh.vertices))
    turn = Rotation.from_matrix(found.rotation @ should.rotation.T).magnitude()
    middle = pose.points(mesh.bounds.mean(0)[None])
    off = np.linalg.norm(found.points(middle) - should.points(middle)) / (truth.scale * mesh.size_mm.max())
    return np.degrees(turn), abs(found.scale / should.scale - 1.0), off


def orientations():
    return axis_rotations()
