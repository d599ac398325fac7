"""The pendant of a necklace: a domed disc below the tube, as near to upright as the chest lets it hang."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from fabcraft.body.body import Body
from fabcraft.mesh import Mesh
from fabcraft.template.melt import melted
from fabcraft.template.plate import Rim, plate
from fabcraft.template.rolled import Rolled
from fabcraft.template.template import MotifFrame

BEHIND_MM = 1.0
"""Clearance behind the pendant."""
_RIGHT = np.array([1.0, 0.0, 0.0])
_WIDE = 35.0 / 30.0
_ROOTED = 0.3
"""How much of a drawn pendant's height may lie over the tube, so that even a pointed one holds, in tube heights."""


@dataclass(frozen=True, eq=False)
class Hanger:
    """The tube that it hangs from."""

    part: Body
    rolled: Rolled
    mesh: Mesh
    tube_mm: float
    """Thickness of the tube, square to the skin."""
    tall_mm: float
    """Height of the tube's section."""
    thick_mm: float
    """Thickness of the pendant."""
    scale: float

    @property
    def hook(self) -> Float64[np.ndarray, "3"]:
        """Middle of the tube's section in front."""
        return self.rolled.world(np.array([[0.0, 0.0, 0.5 * self.tube_mm]]))[0]

    def up(self, width: float, length: float) -> Float64[np.ndarray, "3"]:
        """The upward direction of what hangs `length` below the hook, clear of the chest."""
        away = self.part.mesh.vertices - self.hook
        near = (np.abs(away[:, 0]) < 0.5 * width + 2.0) & (away[:, 2] < 0.0) & (away[:, 2] > -1.2 * length)
        off = 0.6 * self.thick_mm + self.part.clearance_mm(BEHIND_MM)
        up = np.array([0.0, 0.0, 1.0])
        for lean in np.radians(np.arange(0.0, 66.0, 1.0)):
            up = np.array([0.0, np.sin(lean), np.cos(lean)])
            under = near & (away @ up > -length)
            if not under.any() or float((away[under] @ np.array([0.0, -up[2], up[1]])).max()) < -off:
                break
        return up


def with_pendant(hanger: Hanger, drop: float, edge: float, name: str) -> tuple[Mesh, tuple[MotifFrame, ...]]:
    """The tube with its disc, and the places for a motif on it and for a drawn pendant instead of it.

    drop : length of the disc, mm; 0 for none, then a motif sits on the front of the tube.
    """
    drawn = _drawn(hanger, drop or 30.0 * hanger.scale)
    if drop == 0.0:
        front = hanger.rolled.world(np.array([[0.0, 0.0, hanger.tube_mm]]))[0]
        size = (30.0 * hanger.scale, 24.0 * hanger.scale)
        on_tube = MotifFrame("pendant", front, _RIGHT, hanger.rolled.axes[2], size, 8.0 * hanger.scale)
        return hanger.mesh, (on_tube, drawn)
    thick, width = hanger.thick_mm, _WIDE * drop
    up = hanger.up(width, drop + 0.5 * hanger.tall_mm)
    out = np.cross(_RIGHT, up)
    middle = hanger.hook - (0.5 * drop + 0.2 * hanger.tall_mm) * up
    turn = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    outline = 0.5 * np.stack([width * np.cos(turn), drop * np.sin(turn)], 1)
    rim = 0.45 * thick
    flat = plate([outline], thick, [Rim(rim, rim)], edge)
    u, v, w = flat.points.T
    domed = (w - 0.5 * thick) * (1.0 + 0.2 * (1.0 - (2.0 * u / width) ** 2 - (2.0 * v / drop) ** 2))
    places = middle + np.outer(u, _RIGHT) + np.outer(v, up) + np.outer(domed, out)
    mesh = melted(hanger.mesh, Mesh(places, flat.faces), 0.6 * hanger.tube_mm, edge, name)
    outer = middle + 0.6 * thick * out
    on_disc = MotifFrame("pendant", outer, _RIGHT, up, (width, drop), 10.0 * hanger.scale)
    return mesh, (on_disc, drawn)


def _drawn(hanger: Hanger, drop: float) -> MotifFrame:
    """A drawn pendant: its upper end over the tube."""
    width = 1.2 * drop
    up = hanger.up(width, drop + 0.5 * hanger.tall_mm)
    out = np.cross(_RIGHT, up)
    middle = hanger.hook - (0.5 * drop - _ROOTED * hanger.tall_mm) * up
    origin = middle + 0.5 * hanger.thick_mm * out
    return MotifFrame(
        "hanging",
        origin,
        _RIGHT,
        up,
        (width, drop),
        10.0 * hanger.scale,
        depth_mm=hanger.thick_mm,
        carrier=hanger.mesh,
    )
