"""`Rolled`: a picture plane rolled around a part of the body.

In it u runs along the body's section, v along the axis of the limb and w out of the surface, all in mm; a ring, a bangle, a
collar and the front of glasses are flat there.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64

from fabcraft.geometry.oval import Oval, angles

_TURN = np.append(angles(), 2.0 * np.pi)


@dataclass(frozen=True, eq=False)
class Rolled:
    """A plane rolled around the cylinder over an oval, mm."""

    origin: Float64[np.ndarray, "3"]
    """On the cylinder's axis."""
    axes: Float64[np.ndarray, "3 3"]
    """Unit rows, right-handed: the picture's left (seen from outside with the third axis upwards), the way that its middle
    faces, and the axis of the cylinder."""
    oval: Oval
    """The section, where w = 0, in the first two axes."""

    def flat(self, points: Float[np.ndarray, "N 3"]) -> Float64[np.ndarray, "N 3"]:
        """(u, v, w) of points; u is 0 in the middle of the picture and at most half a turn, positive to the right."""
        local = (points - self.origin) @ self.axes.T
        angle, out = self.oval.located(local[:, :2])
        u, length = np.interp(angle, _TURN, self._arc), self.oval.length
        return np.stack([(u + 0.5 * length) % length - 0.5 * length, local[:, 2], out], 1)

    def world(self, flat: Float[np.ndarray, "N 3"]) -> Float64[np.ndarray, "N 3"]:
        """Points at (u, v, w)."""
        arc = self._arc
        u = (flat[:, 0] - arc[0]) % self.oval.length + arc[0]
        angle = np.interp(u, arc, _TURN)
        plane = self.oval.at(angle, flat[:, 2])
        return self.origin + plane @ self.axes[:2] + flat[:, 1:2] * self.axes[2]

    @property
    def middle(self) -> Float64[np.ndarray, "3"]:
        """The middle of the section, on the plane v = 0."""
        return self.origin + self.oval.middle @ self.axes[:2]

    @property
    def _arc(self) -> Float64[np.ndarray, " M"]:
        """u at the angles of `_TURN`, rising."""
        arc = self.oval.arc
        return arc - np.interp(0.5 * np.pi, _TURN, arc)
