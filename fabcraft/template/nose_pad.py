"""A rounded block between given places, its skin side shaped by the skin: the pad of glasses."""

import numpy as np
from jaxtyping import Float64
from scipy.spatial import ConvexHull

from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.isotropic import isotropic
from fabcraft.mesh import Mesh

_BALL, _SOFT, _PUSHES = 60, 6, 4


def rounded_block(
    places: Float64[np.ndarray, "N 3"], radius: float, skin: SurfaceDistance, room_mm: float, edge_mm: float
) -> Mesh:
    """The hull of balls of `radius` round `places`, its edges softened, pushed `room_mm` off the skin, mm."""
    cloud = (places[:, None] + _ball(radius)).reshape(-1, 3)
    hull = ConvexHull(cloud)
    used = np.unique(hull.simplices)
    faces = np.searchsorted(used, hull.simplices)
    a, b, c = cloud[used][faces].transpose(1, 0, 2)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    block = isotropic(Mesh(cloud[used], faces.astype(np.int32), "pad"), edge_mm)
    vertices = _softened(block, _SOFT)
    for _ in range(_PUSHES):
        signed, gradient = skin.signed_with_gradient(vertices)
        vertices = vertices + np.maximum(room_mm - signed, 0.0)[:, None] * gradient
    return block.with_vertices(vertices)


def _softened(mesh: Mesh, rounds: int) -> Float64[np.ndarray, "V 3"]:
    """The vertices after so many moves half-way to the middle of their neighbours: edges become round."""
    ends = mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    degree = np.bincount(ends[:, 0], minlength=len(mesh.vertices))[:, None]
    vertices = mesh.vertices
    for _ in range(rounds):
        total = np.stack(
            [np.bincount(ends[:, 0], vertices[ends[:, 1], k], len(vertices)) for k in range(3)], 1
        )
        vertices = 0.5 * (vertices + total / degree)
    return vertices


def _ball(radius: float) -> Float64[np.ndarray, "N 3"]:
    """Points of a small ball, evenly spread."""
    z = 1.0 - (2.0 * np.arange(_BALL) + 1.0) / _BALL
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(_BALL)
    across = np.sqrt(1.0 - z**2)
    return radius * np.stack([across * np.cos(turn), across * np.sin(turn), z], 1)
