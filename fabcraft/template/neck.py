"""The neck that wears a necklace, and the head that a closed one goes over, as slices in their planes."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from fabcraft.body.body import Body
from fabcraft.geometry.oval import Oval
from fabcraft.template.band import Profile
from fabcraft.template.limb import Axes, Station, station
from fabcraft.template.rolled import Rolled

ROUND_MM = 4.0
"""Clearance of a necklace all round."""
LEVEL = np.array([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
"""Axes of a level slice: to the right of the wearer, to the front, up."""
_TALL = 4.0 / 3.0
"""Height of the tube's section over its thickness."""
_SLICES = 24


@dataclass(frozen=True, eq=False)
class Neck:
    """Where a necklace is worn, and how thick it is."""

    part: Body
    at: Mapping[str, Float64[np.ndarray, "3"]]
    scale: float
    """Girth of the neck over a median man's."""
    girth_mm: float
    """Of the neck, where it is least."""
    tube: float
    """Thickness of the tube, square to the skin."""

    @property
    def tall(self) -> float:
        """Height of the tube's section, along the neck."""
        return _TALL * self.tube

    def axes(self, tilt_deg: float) -> Axes:
        """The plane that rises to the nape by that angle: to the right of the wearer, to the front, up."""
        turn = np.radians(tilt_deg)
        front = np.array([0.0, -np.cos(turn), -np.sin(turn)])
        return np.stack([[-1.0, 0.0, 0.0], front, [0.0, front[2], -front[1]]])

    def skin(self, up_mm: float, tilt_deg: float) -> Rolled:
        """The neck under the tube where the plane passes `up_mm` above the jugular notch."""
        notch, axes = self.at["jugular_notch"], self.axes(tilt_deg)
        depth = float(np.linalg.norm(notch - self.at["cervicale"]))
        origin = (notch + [0.0, 0.0, up_mm] - 0.5 * depth * axes[1]) * [0.0, 1.0, 1.0]
        heights = 0.5 * self.tall * np.array([-1.0, 0.0, 1.0])
        ovals = [station(self.part.mesh, origin + at * axes[2], axes).oval for at in heights]
        return Rolled(origin, axes, Oval.holding(ovals).mirrored())


def tube_profile(neck: Neck) -> Profile:
    return Profile(
        lambda u: np.full(len(u), 0.5 * neck.tall),
        np.zeros_like,
        lambda u: np.full(len(u), neck.tube),
        (0.5 * neck.tube, 0.5 * neck.tube),
    )


def head_slices(neck: Neck, thick_mm: float = 0.0) -> list[Station]:
    """Level slices of the head from the chin to past its top, ears laid back; those of a character stay.

    thick_mm : how much a slice takes in besides what lies between it and the next.
    """
    vertices = neck.part.mesh.vertices
    keep = np.ones(len(vertices), dtype=bool)
    if neck.part.kind != "character":
        for name in ("ear_left", "ear_right"):
            if name in neck.part.regions:
                keep[neck.part.regions[name].vertex_indices] = False
    points = vertices[keep]
    low, top = 0.5 * (neck.at["neck_root"][2] + neck.at["menton"][2]), neck.at["vertex"][2]
    heights = np.linspace(low, top + neck.tall, _SLICES)
    reach = 0.75 * (heights[1] - heights[0]) + 0.5 * thick_mm
    slices: list[Station] = []
    for z in heights:
        near = points[np.abs(points[:, 2] - z) < reach]
        middle = np.array([0.0, neck.at["head"][1], z])
        past = len(near) <= 8  # the top of the head
        oval = slices[-1].oval.scaled(0.5) if past else Oval.around((near - middle) @ LEVEL[:2].T).mirrored()
        slices.append(Station(middle, LEVEL, oval))
    return slices
