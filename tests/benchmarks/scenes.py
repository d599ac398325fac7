"""A closed, bumpy torus that fills about 39 % of every picture, and cameras around it."""

import numpy as np
from scipy.spatial.transform import Rotation

from fabcraft.fit.camera import Cameras, orbit, stack

SIZES = {2016: (42, 24), 9964: (94, 53), 40068: (189, 106)}
"""Rows and columns of a torus, by its number of faces."""


def torus(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """(V, 3) vertices, mm, about 180 across, and (2 V, 3) faces that look outwards."""
    u, v = np.meshgrid(
        2 * np.pi * np.arange(rows) / rows, 2 * np.pi * np.arange(columns) / columns, indexing="ij"
    )
    large, small = 60 + 6 * np.sin(3 * u) * np.cos(2 * v), 27 + 3 * np.sin(5 * v + 2 * u)
    across = large + small * np.cos(v)
    upright = np.stack([across * np.cos(u), across * np.sin(u), small * np.sin(v)], -1).reshape(-1, 3)
    # Tilted, since the near and the far rim of an upright one would hide behind each other exactly.
    points = upright @ Rotation.from_euler("xyz", [50.0, 17.0, 31.0], degrees=True).as_matrix().T
    i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    corner = i * columns + j
    right, below = i * columns + (j + 1) % columns, (i + 1) % rows * columns + j
    opposite = (i + 1) % rows * columns + (j + 1) % columns
    faces = np.concatenate(
        [np.stack([corner, below, opposite], -1), np.stack([corner, opposite, right], -1)]
    ).reshape(-1, 3)
    corners = points[faces]
    volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return points, np.ascontiguousarray(faces if volume > 0 else faces[:, ::-1], dtype=np.int32)


def torus_of(faces: int) -> tuple[np.ndarray, np.ndarray]:
    """A torus of about that many faces."""
    columns = max(6, round(np.sqrt(faces / 3.55)))
    return torus(round(faces / (2 * columns)), columns)


def around(views: int = 8, pixels: int = 224) -> Cameras:
    """Perspective cameras in a ring, 40 degrees of field of view."""
    return stack(
        [orbit((0.0, 0.0, 0.0), 310.0, 360 / views * k, 15 * np.sin(k), 40.0, pixels) for k in range(views)]
    )
