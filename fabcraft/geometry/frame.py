"""`Frame`: the one similarity between millimetres and the optimiser's frame.

The centre of a mesh's box goes to the origin and its longest side becomes 2. Object, body, contacts and guidance go through
the same frame; nothing is ever normalised on its own.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from fabcraft.errors import InputError
from fabcraft.mesh import Mesh


@dataclass(frozen=True, eq=False)
class Frame:
    """x mm to `scale` (x − `centre`)."""

    centre: Float64[np.ndarray, "3"]
    """mm."""
    scale: float
    """1 / mm."""

    @staticmethod
    def of(mesh: Mesh) -> "Frame":
        """The frame of a mesh, before it is deformed.  Raises `InputError` for a mesh without extent."""
        if len(mesh.vertices) == 0 or mesh.size_mm.max() <= 0.0:
            raise InputError(
                f"mesh {mesh.name or '(unnamed)'} has no extent, so nothing can be deformed",
                "Check that the file holds a surface.",
            )
        lower, upper = mesh.bounds
        return Frame(0.5 * (lower + upper), 2.0 / float((upper - lower).max()))

    def inside(self, points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, "N 3"]:
        """Points in mm, in the optimiser's frame."""
        return (points - self.centre) * self.scale

    def outside(self, points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, "N 3"]:
        """Points in the optimiser's frame, in mm."""
        return points / self.scale + self.centre
