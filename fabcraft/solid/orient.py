"""Where the object lies on the printer's bed.

The first pose that fits the build volume: as it is worn, then turned about the vertical in steps of 15 degrees; the same
on its back (front up), then on its front. The lowest point touches the bed, the
middle of the box is the middle of the bed.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from fabcraft.mesh import Mesh
from fabcraft.profile import PrinterProfile

POSES = (
    ("as it is worn", 0.0),
    ("on its back, front up", -90.0),
    ("on its front", 90.0),
)
"""Name, and turn about the x axis in degrees: -90 takes -y (the front) to +z."""


@dataclass(frozen=True, eq=False)
class OnBed:
    """An object on the bed, mm, and how it lies, in words."""

    mesh: Mesh
    words: str


def onto_bed(mesh: Mesh, profile: PrinterProfile) -> OnBed:
    """`mesh` placed on the bed; an object that fits in no pose stays as it is worn."""
    build = np.array(profile.build_mm)
    for name, about_x in POSES:
        for about_z in np.arange(0.0, 91.0, 15.0):
            turned = mesh.transformed(_turn(about_x, about_z))
            if (turned.size_mm <= build).all():
                words = name if about_z == 0.0 else f"{name}, turned by {about_z:.0f} degrees"
                return OnBed(_laid(turned, build), words)
    return OnBed(_laid(mesh, build), "as it is worn; it is larger than the build volume")


def moved_together(pair: Mesh, gap_mm: float = 4.0) -> Mesh:
    """The two of a pair, one on either side of x = 0, pushed together until their boxes are `gap_mm` apart."""
    x = pair.vertices[:, 0]
    left = x > 0.0
    shift = np.where(left, 0.5 * gap_mm - x[left].min(), -0.5 * gap_mm - x[~left].max())
    return pair.with_vertices(pair.vertices + shift[:, None] * [1.0, 0.0, 0.0])


def _turn(about_x_deg: float, about_z_deg: float) -> Float64[np.ndarray, "4 4"]:
    x, z = np.radians([about_x_deg, about_z_deg])
    matrix = np.eye(4)
    first = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(x), -np.sin(x)], [0.0, np.sin(x), np.cos(x)]])
    second = np.array([[np.cos(z), -np.sin(z), 0.0], [np.sin(z), np.cos(z), 0.0], [0.0, 0.0, 1.0]])
    # right angles to the last bit: a turned object keeps its exact coordinates
    matrix[:3, :3] = np.where(np.abs(second @ first) < 1e-15, 0.0, second @ first)
    return matrix


def _laid(mesh: Mesh, build: Float64[np.ndarray, "3"]) -> Mesh:
    lower, upper = mesh.bounds
    middle = 0.5 * (lower + upper)
    return mesh.with_vertices(
        mesh.vertices + [0.5 * build[0] - middle[0], 0.5 * build[1] - middle[1], -lower[2]]
    )
