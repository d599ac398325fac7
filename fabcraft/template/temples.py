"""The side pieces of glasses: from the front along the head, over the ear and down behind it.

A temple is a plate in its own side view, tapered towards the ear and rounded at its tip, that is bent along a line beside
the head.  The line is straight to the root of the ear and then follows its back; it is moved off the skin where it comes
too near.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.ndimage import gaussian_filter1d

from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh
from fabcraft.template.plate import Rim, plate

_STEP_MM = 0.5
_PUSHES = 40
_DOWN = np.array([0.0, 1.0, -1.0]) / np.sqrt(2.0)
"""Behind the ear, by 45 degrees."""


@dataclass(frozen=True, eq=False)
class Temple:
    """The left temple's middle line and section."""

    line: Float64[np.ndarray, "N 3"]
    """From inside the end piece to the tip, evenly spaced, mm."""
    half_height: Float64[np.ndarray, " N"]
    thickness: float

    @property
    def length(self) -> float:
        """Along the line, mm."""
        return float(np.linalg.norm(np.diff(self.line, axis=0), axis=1).sum())

    def frames(
        self,
    ) -> tuple[Float64[np.ndarray, "N 3"], Float64[np.ndarray, "N 3"], Float64[np.ndarray, "N 3"]]:
        """Along the line, up across it, and away from the head."""
        ahead = np.gradient(self.line, axis=0)
        ahead = ahead / np.linalg.norm(ahead, axis=1, keepdims=True)
        off = np.array([1.0, 0.0, 0.0]) - ahead[:, :1] * ahead
        off = off / np.linalg.norm(off, axis=1, keepdims=True)
        return ahead, np.cross(off, ahead), off

    def mesh(self, edge_mm: float) -> Mesh:
        """The closed solid; its front end is square, its tip round."""
        way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.line, axis=0), axis=1))])
        tip = self.half_height[-1]
        turn = np.linspace(0.5 * np.pi, -0.5 * np.pi, 60)
        end = np.stack([way[-1] - tip + tip * np.cos(turn), tip * np.sin(turn)], 1)
        body = way < way[-1] - tip
        upper = np.stack([way[body], self.half_height[body]], 1)
        corner = 0.4 * self.half_height[0]
        upper = upper[upper[:, 0] > corner]
        turn = np.linspace(0.0, 0.5 * np.pi, 20)
        start = np.stack(
            [corner * (1.0 - np.cos(turn)), self.half_height[0] - corner * (1.0 - np.sin(turn))], 1
        )
        top = np.concatenate([start, upper, end[: len(end) // 2]])
        outline = np.concatenate([top, top[::-1] * [1.0, -1.0]])[::-1]
        rim = 0.42 * self.thickness
        flat = plate([outline], self.thickness, [Rim(rim, rim)], edge_mm)
        u, v, w = flat.points.T
        _, up, off = self.frames()
        at = [np.stack([np.interp(u, way, part[:, k]) for k in range(3)], 1) for part in (self.line, up, off)]
        return Mesh(at[0] + v[:, None] * at[1] + (w - 0.5 * self.thickness)[:, None] * at[2], flat.faces)


@dataclass(frozen=True, eq=False)
class Way:
    """Where a left temple has to pass."""

    root: Float64[np.ndarray, "3"]
    """Top of the ear's root."""
    thickness: float
    height: float
    """Of its section."""
    beside_mm: float
    """Least distance to the head."""
    on_ear_mm: float
    """And over the ear."""
    skin: SurfaceDistance
    scale: float
    flare: float = 1.3
    """Height at the hinge over that of the section."""

    def bend(self) -> Float64[np.ndarray, "3"]:
        """Where it turns down, behind the ear."""
        top = self.root + np.array(
            [0.5 * self.thickness + self.on_ear_mm, 0.0, 0.5 * self.height + self.on_ear_mm]
        )
        top[2] += max(0.0, 0.5 * self.height + self.on_ear_mm - float(self.skin.signed(top[None])[0]))
        return _behind_the_ear(top, 0.5 * self.thickness + self.on_ear_mm, self.skin, self.scale)

    def outside(
        self, hinge: Float64[np.ndarray, "3"], bend: Float64[np.ndarray, "3"]
    ) -> tuple[Float64[np.ndarray, " N"], Float64[np.ndarray, " N"]]:
        """(share of the way from hinge to bend, least x there that keeps clear of the head)."""
        share = np.linspace(0.35, 1.0, 24)
        x = bend[0] + np.arange(-12.0, 14.0, 0.5) * self.scale
        places = hinge + share[:, None] * (bend - hinge)
        grid = np.stack(np.broadcast_arrays(x[None], places[:, 1:2], places[:, 2:]), -1)
        over = np.clip((places[:, 1] - self.root[1]) / (25.0 * self.scale) + 1.0, 0.0, 1.0)
        wanted = 0.5 * self.thickness + self.beside_mm + over * (self.on_ear_mm - self.beside_mm)
        free = self.skin.signed(grid.reshape(-1, 3)).reshape(grid.shape[:2]) >= wanted[:, None]
        return share, np.where(free.any(1), x[free.argmax(1)], -np.inf)

    def short(self, hinge: Float64[np.ndarray, "3"]) -> float:
        """How much farther out the hinge has to be, mm, for a straight temple that lies close at the ear."""
        bend = self.bend()
        share, needed = self.outside(hinge, bend)
        front = share < 0.8
        close = max(float(bend[0]), float(needed[~front].max()))
        return float(((needed - share * close) / (1.0 - share + 1e-9))[front].max()) - float(hinge[0])


def temple(hinge: Float64[np.ndarray, "3"], way: Way, drop_mm: float) -> Temple:
    """The left temple from `hinge`, straight over the ear and down behind it for `drop_mm`."""
    bend, skin, scale = way.bend(), way.skin, way.scale
    share, needed = way.outside(hinge, bend)
    bend[0] = max(float(bend[0]), float((hinge[0] + (needed - hinge[0]) / share).max()))
    tip = bend + drop_mm * _DOWN
    tip[0] = _beside(tip, 0.5 * way.thickness + way.beside_mm, skin, scale)
    line = _even(np.stack([hinge, bend, tip]))
    sigma, ends = 5.0 * scale / _STEP_MM, np.arange(60, 0, -1)[:, None]
    run, tail = line[0] - (line[1] - line[0]) * ends, line[-1] + (line[-1] - line[-2]) * ends[::-1]
    line = gaussian_filter1d(np.concatenate([run, line, tail]), sigma, axis=0)[60:-60]
    ear = int(np.argmin(np.linalg.norm(line - bend, axis=1)))
    half = _half_heights(len(line), ear, 0.5 * way.height, way.flare)
    before = int(np.argmin(np.abs(line[:ear, 1] - way.root[1])))
    knots = [before - 25.0 * scale / _STEP_MM, before]
    room = np.interp(np.arange(len(line)), knots, [way.beside_mm, way.on_ear_mm])
    return _cleared(Temple(line, half, way.thickness), room, skin, scale)


def _behind_the_ear(
    top: Float64[np.ndarray, "3"], reach: float, skin: SurfaceDistance, scale: float
) -> Float64[np.ndarray, "3"]:
    """The foremost place behind `top` from where a line can go down between skull and ear."""
    deep = np.array([3.0, 8.0, 14.0, 22.0]) * scale
    across = np.arange(-4.0, 4.1, 1.0) * scale
    bend = top + np.array([0.0, 36.0 * scale, 0.0])
    for back in np.arange(36.0, -0.5, -1.0) * scale:
        places = top + np.array([0.0, back, 0.0]) + np.outer(deep, _DOWN)
        wide = places[:, None] + across[None, :, None] * np.array([1.0, 0.0, 0.0])
        room = skin.signed(wide.reshape(-1, 3)).reshape(len(deep), -1)
        if (room.max(1) < reach).any():
            break
        bend = top + np.array([0.0, back, 0.0])
    return bend


def _beside(point: Float64[np.ndarray, "3"], reach: float, skin: SurfaceDistance, scale: float) -> float:
    """x of the place nearest to the skull, beside `point`, that is `reach` off the skin."""
    x = point[0] + np.arange(-25.0, 12.0, 0.25) * scale
    room = skin.signed(np.column_stack([x, np.full(len(x), point[1]), np.full(len(x), point[2])]))
    free = np.flatnonzero(room >= reach)
    return float(x[free[0]]) if len(free) else float(point[0])


def _half_heights(count: int, ear: int, half: float, flare: float) -> Float64[np.ndarray, " N"]:
    """Higher at the hinge, slender over the ear, a little broader again at the tip."""
    at = np.arange(count)
    last = count - 1.0
    knots = [0.0, 0.35 * ear, 0.9 * ear, ear + 0.35 * (last - ear), last - 0.2 * (last - ear), last]
    return gaussian_filter1d(
        np.interp(at, knots, half * np.array([flare, 1.05, 0.9, 0.92, 1.12, 1.12])), 12.0
    )


def _cleared(one: Temple, room: Float64[np.ndarray, " N"], skin: SurfaceDistance, scale: float) -> Temple:
    """The temple moved off the skin, smoothly along its line; its front end stays."""
    line = one.line
    hold = np.clip(np.arange(len(line)) / (25.0 * scale / _STEP_MM), 0.0, 1.0)[:, None]
    corners = np.array(
        [(-0.8, -0.8), (0.8, -0.8), (-0.8, 0.8), (0.8, 0.8), (0.0, -1.0), (-1.0, 0.0), (0.0, 1.0), (1.0, 0.0)]
    )
    moved = np.zeros_like(line)
    every = np.arange(0, len(line), 4)
    for _ in range(_PUSHES):
        now = Temple(line + moved, one.half_height, one.thickness)
        _, up, off = now.frames()
        around = (
            now.line[every, None]
            + corners[None, :, 1:] * (one.half_height[every, None, None] * up[every, None])
            + corners[None, :, :1] * (0.5 * one.thickness * off[every, None])
        )
        signed, gradient = skin.signed_with_gradient(around.reshape(-1, 3))
        short = np.maximum(room[every, None] + 0.1 - signed.reshape(len(every), -1), 0.0)
        if not (short > 0.05).any():
            break
        push = (short[..., None] * gradient.reshape(*around.shape) * [1.0, 0.0, 1.0]).sum(1)
        push = push / np.maximum((short > 0.0).sum(1), 1)[:, None]
        spread = np.stack([np.interp(np.arange(len(line)), every, push[:, k]) for k in range(3)], 1)
        moved = moved + 0.7 * hold * gaussian_filter1d(spread, 8.0 * scale / _STEP_MM, axis=0, mode="nearest")
    return Temple(line + moved, one.half_height, one.thickness)


def _even(corners: Float64[np.ndarray, "C 3"]) -> Float64[np.ndarray, "N 3"]:
    """Points evenly spaced along a polyline."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    at = np.linspace(0.0, way[-1], round(way[-1] / _STEP_MM) + 1)
    return np.stack([np.interp(at, way, corners[:, k]) for k in range(3)], 1)
