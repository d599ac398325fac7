"""`PictureSpace`: a motif frame's own space, in which the frame is a front view like any other.

x to the picture's right, z upwards, -y off the object; lengths times `scale`, so that a motif of any size is worked on at
the size of a mask. A rolled frame is unrolled: x is the arc length at the radius of the frame's origin.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from fabcraft.mesh import Mesh
from fabcraft.template.template import MotifFrame

_SEAM = np.pi * 0.92
"""A rolled picture ends this far round; faces beyond are left out, for they would run back across it."""


@dataclass(frozen=True, eq=False)
class PictureSpace:
    """Maps points of the body's space (mm) into the frame's picture and back."""

    frame: MotifFrame
    scale: float = 1.0
    """Picture units per mm."""

    def inside(self, points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, "N 3"]:
        """Points of the body's space, mm, in the picture."""
        frame = self.frame
        across, up, out = frame.right, frame.up, frame.outward
        if frame.axis is None:
            away = points - frame.origin
            local = np.column_stack([away @ across, -(away @ out), away @ up])
        else:
            away = points - frame.axis[0]
            angle = np.arctan2(away @ across, away @ out)
            radius = np.hypot(away @ across, away @ out)
            local = np.column_stack(
                [self._radius * angle, self._radius - radius, (points - frame.origin) @ up]
            )
        return self.scale * local

    def outside(self, points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, "N 3"]:
        """Points of the picture in the body's space, mm."""
        frame = self.frame
        x, y, z = (points / self.scale).T[:, :, None]
        if frame.axis is None:
            return frame.origin + x * frame.right - y * frame.outward + z * frame.up
        angle, radius = x / self._radius, self._radius - y
        foot = frame.axis[0] + ((frame.origin - frame.axis[0]) @ frame.up) * frame.up
        return foot + radius * (np.sin(angle) * frame.right + np.cos(angle) * frame.outward) + z * frame.up

    def seen(self, mesh: Mesh) -> Mesh:
        """A mesh of the body's space in the picture; of a rolled one, without the faces at the back."""
        moved = mesh.with_vertices(self.inside(mesh.vertices))
        if self.frame.axis is None:
            return moved
        turn = moved.corners[:, :, 0] / (self.scale * self._radius)
        return moved.submesh(np.flatnonzero(np.abs(turn).max(1) < _SEAM))

    @property
    def _radius(self) -> float:
        """Distance of the frame's origin from the axis of a rolled picture, mm."""
        assert self.frame.axis is not None
        return float((self.frame.origin - self.frame.axis[0]) @ self.frame.outward)
