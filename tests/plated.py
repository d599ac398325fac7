"""Simple solids for the tests of what is done to an object before it is printed."""

import manifold3d
import numpy as np
import trimesh

from fabcraft.mesh import Mesh
from fabcraft.solid.manifolds import to_mesh


def box(*size: float, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Mesh:
    """A box with its middle `at`."""
    shape = trimesh.creation.box(size)
    return Mesh(np.array(shape.vertices) + np.array(at), shape.faces.astype(np.int32), "box")


def tube(outer: float, inner: float, height: float, segments: int = 96) -> Mesh:
    """A tube about z."""
    rod = manifold3d.Manifold.cylinder(height, outer, outer, segments, center=True)
    hole = manifold3d.Manifold.cylinder(2 * height, inner, inner, segments, center=True)
    return to_mesh((rod - hole).refine_to_length(3.0), "tube")


def table(top: float = 40.0, height: float = 20.0) -> Mesh:
    """A plate on a thin leg: all of the plate overhangs."""
    plate = manifold3d.Manifold.cube((top, top, 3.0), True).translate((0.0, 0.0, height))
    leg = manifold3d.Manifold.cube((4.0, 4.0, height), True).translate((0.0, 0.0, 0.5 * height))
    return to_mesh(plate + leg, "table")
