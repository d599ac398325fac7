"""Simple bodies and objects for the fit: a finger, a wrist, rings, and contacts on them."""

import numpy as np
import trimesh

from fabcraft.fit.body_terms import ContactSet
from fabcraft.mesh import Mesh


def ball(radius=20.0, subdivisions=3):
    shape = trimesh.creation.icosphere(subdivisions, radius)
    return Mesh(np.array(shape.vertices), np.array(shape.faces, dtype=np.int32), "ball")


def torus(major, minor, around=48, across=12):
    shape = trimesh.creation.torus(major, minor, major_sections=around, minor_sections=across)
    return Mesh(np.array(shape.vertices), np.array(shape.faces, dtype=np.int32), "ring")


def limb(lower, upper, height=60.0, sections=96):
    """A closed cone about z from radius `lower` to `upper`."""
    angle = np.arange(sections) * 2.0 * np.pi / sections
    circle = np.stack([np.cos(angle), np.sin(angle)], 1)
    rings = [
        np.column_stack([radius * circle, np.full(sections, z)])
        for radius, z in ((lower, -0.5 * height), (upper, 0.5 * height))
    ]
    points = np.concatenate([*rings, [[0.0, 0.0, -0.5 * height], [0.0, 0.0, 0.5 * height]]])
    j = np.arange(sections)
    k, n = (j + 1) % sections, 2 * sections
    sides = np.concatenate([np.stack([j, k, k + sections], 1), np.stack([j, k + sections, j + sections], 1)])
    caps = np.concatenate(
        [
            np.stack([np.full(sections, n), k, j], 1),
            np.stack([np.full(sections, n + 1), j + sections, k + sections], 1),
        ]
    )
    return Mesh(points, np.concatenate([sides, caps]).astype(np.int32), "limb")


def band(radius, gap_mm=0.2, slope=0.0, angles=None):
    """Contacts around z = 0 of a limb whose radius there is `radius` and grows by `slope`."""
    angle = np.arange(48) * 2.0 * np.pi / 48 if angles is None else angles
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros_like(angle)], 1)
    normals = np.stack([np.cos(angle), np.sin(angle), np.full_like(angle, -slope)], 1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return ContactSet(points, normals, np.full(len(angle), gap_mm), np.ones(len(angle)))


def lumpy(ring, lumps=5):
    """The ring with its tube thicker at some places."""
    x, y, _ = ring.vertices.T
    angle, radius = np.arctan2(y, x), np.hypot(x, y)
    middle = 0.5 * (radius.min() + radius.max())
    core = np.stack([middle * np.cos(angle), middle * np.sin(angle), np.zeros_like(angle)], 1)
    thicker = 1.0 + 0.4 * (1.0 + np.cos(lumps * angle))
    return ring.with_vertices(core + (ring.vertices - core) * thicker[:, None])


def horned(length=20.0, width=0.25, radius=20.0):
    """A ball with two long horns."""
    smooth = ball(1.0, 5)
    reach = np.full(len(smooth.vertices), radius)
    for side in (-1.0, 1.0):
        direction = np.array([side, 0.0, 1.0]) / np.sqrt(2.0)
        angle = np.arccos(np.clip(smooth.vertices @ direction, -1.0, 1.0))
        reach += length * np.exp(-((angle / width) ** 2))
    return smooth.with_vertices(smooth.vertices * reach[:, None])
