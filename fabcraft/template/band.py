"""A band around a limb: a rounded profile swept along a rolled plane, in near-equilateral triangles; closed or with a gap.

The surface is made of lines that run around the band, evenly spaced over the profile; every second line is half a step
ahead, so that the triangles between two lines are equilateral and edges stay as smooth as the lines.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from fabcraft.mesh import Mesh
from fabcraft.template.plate import Rim, plate
from fabcraft.template.rolled import Rolled

Along = Callable[[Float64[np.ndarray, " N"]], Float64[np.ndarray, " N"]]
"""A length that varies with u."""

_FINE = 48
"""Points of each side and each rounded corner of a profile before it is sampled evenly."""


@dataclass(frozen=True, eq=False)
class Profile:
    """A band's cross-section: half its width along v, from w = `inner` to w = `outer`, mm."""

    half_width: Along
    inner: Along
    outer: Along
    rounding_mm: tuple[float, float]
    """Radius of the inner and of the outer edges; at most half the thickness is taken."""
    inner_crown_mm: float = 0.0
    """How much farther from the skin the inner side is at its edges than in its middle."""
    outer_crown_mm: float = 0.0
    """How much lower the outer side is at its edges than in its middle."""
    taper: float = 0.0
    """How much nearer to the axis the band comes for every mm along v."""

    def points(self, u: Float64[np.ndarray, " N"], count: int) -> Float64[np.ndarray, "N M 2"]:
        """(v, w) of `count` points evenly spaced along the profile at every u, from the middle of the inner side on."""
        fine = self._fine(u)
        steps = np.linalg.norm(np.diff(fine, axis=1, append=fine[:, :1]), axis=2)
        travelled = np.concatenate([np.zeros((len(u), 1)), np.cumsum(steps, axis=1)], axis=1)
        closed = np.concatenate([fine, fine[:, :1]], axis=1)
        share = np.arange(count) / count
        return np.stack(
            [
                np.stack([np.interp(share * way[-1], way, line[:, axis]) for axis in (0, 1)], 1)
                for way, line in zip(travelled, closed, strict=True)
            ]
        )

    def length(self, u: Float64[np.ndarray, " N"]) -> Float64[np.ndarray, " N"]:
        """Around the profile."""
        fine = self._fine(u)
        return np.linalg.norm(np.diff(fine, axis=1, append=fine[:, :1]), axis=2).sum(1)

    def _fine(self, u: Float64[np.ndarray, " N"]) -> Float64[np.ndarray, "N P 2"]:
        half, low, high = (side(u)[:, None] for side in (self.half_width, self.inner, self.outer))
        most = np.minimum(0.5 * (high - low), half)
        radius_in, radius_out = (np.minimum(radius, most) for radius in self.rounding_mm)
        turn = np.linspace(0.0, 0.5 * np.pi, _FINE)[None]
        side = np.linspace(0.0, 1.0, _FINE, endpoint=False)[None]
        inner_v = (half - radius_in) * side
        inner_corner = half - radius_in * (1.0 - np.sin(turn)), low + radius_in * (1.0 - np.cos(turn))
        outer_corner = half - radius_out * (1.0 - np.cos(turn)), high - radius_out * (1.0 - np.sin(turn))
        outer_v = (half - radius_out) * (1.0 - side)
        v = np.concatenate([inner_v, inner_corner[0], outer_corner[0], outer_v], axis=1)
        w = np.concatenate(
            [low + 0.0 * inner_v, inner_corner[1], outer_corner[1], high + 0.0 * outer_v], axis=1
        )
        share = (w - low) / (high - low)
        dome = (1.0 - share) * self.inner_crown_mm - share * self.outer_crown_mm
        half_turn = np.stack([v, w + dome * (v / half) ** 2], axis=2)
        back = half_turn[:, :0:-1] * [
            -1.0,
            1.0,
        ]  # the other half is the mirror image, from the outer middle back
        whole = np.concatenate([half_turn, np.stack([0.0 * high, high], axis=2), back], axis=1)
        whole[:, :, 1] -= self.taper * whole[:, :, 0]
        return whole


def closed_band(
    rolled: Rolled, profile: Profile, edge_mm: float, name: str
) -> tuple[Mesh, Bool[np.ndarray, " F"]]:
    """The band once around, edges about `edge_mm` long, and which of its faces are on the inner side."""
    around = np.linspace(-0.5, 0.5, 64, endpoint=False) * rolled.oval.length
    middle = 0.5 * float(profile.outer(around).mean() + profile.inner(around).mean())
    count = 2 * max(8, round(rolled.oval.grown(middle).length / edge_mm / 2))  # even: symmetric to u = 0
    lines = 2 * max(3, round(float(profile.length(around).mean()) / (0.5 * np.sqrt(3.0) * edge_mm) / 2))
    u = (np.arange(2 * count) / (2 * count) - 0.5) * rolled.oval.length
    places = profile.points(u, lines)
    line, step = np.meshgrid(np.arange(lines), np.arange(count), indexing="ij")
    at = (2 * step + line % 2) % (2 * count)
    flat = np.column_stack([u[at].reshape(-1), places[at.reshape(-1), line.reshape(-1)]])
    mesh = Mesh(rolled.world(flat), _between_lines(lines, count), name)
    middle_w = 0.5 * (profile.inner(flat[:, 0]) + profile.outer(flat[:, 0])) - profile.taper * flat[:, 1]
    return mesh, (flat[:, 2] < middle_w + 1e-9)[mesh.faces].all(1)


def open_band(
    rolled: Rolled,
    size_mm: tuple[float, float],
    gap_mm: float,
    rounding_mm: float,
    crown_mm: float,
    edge_mm: float,
    name: str,
) -> tuple[Mesh, Bool[np.ndarray, " F"]]:
    """A band with a gap opposite its middle and round ends, and which of its faces are on the inner side.

    size_mm : width along v, and thickness at its edges; in the middle it is `crown_mm` thicker.
    gap_mm : distance between the ends, in a straight line.
    """
    width, wall = size_mm
    u = np.linspace(0.2, 0.5, 600) * rolled.oval.length
    ends = [rolled.world(np.column_stack([side * u, 0.0 * u, 0.0 * u])) for side in (-1.0, 1.0)]
    apart = np.linalg.norm(ends[1] - ends[0], axis=1)
    long, half, round_ = float(u[len(u) - 1 - np.argmax(apart[::-1] > gap_mm)]), 0.5 * width, 0.47 * width
    turn = np.linspace(0.0, 0.5 * np.pi, 60)
    corner = np.stack([long - round_ * (1.0 - np.cos(turn)), half - round_ * (1.0 - np.sin(turn))], 1)
    right = np.concatenate([corner[::-1] * [1.0, -1.0], corner])
    outline = np.concatenate([right, right[::-1] * [-1.0, 1.0]])[::-1]
    # measured inside, where the plane is rolled tightest
    inner_edge = edge_mm / (1.0 + np.pi * wall / rolled.oval.length)
    flat = plate([outline], wall, [Rim(rounding_mm, rounding_mm)], inner_edge)
    places = flat.points.copy()
    share = places[:, 2] / wall
    places[:, 2] += crown_mm * share * (1.0 - (places[:, 1] / half) ** 2)
    return Mesh(rolled.world(places), flat.faces, name), (share < 0.5 + 1e-9)[flat.faces].all(1)


def _between_lines(lines: int, count: int) -> np.ndarray:
    """Two triangles for every step of every line; odd lines are half a step ahead of even ones."""
    line, step = np.meshgrid(np.arange(lines), np.arange(count), indexing="ij")
    after, further = (step + 1) % count, (line + 1) % lines
    here, ahead = line * count + step, line * count + after
    beside, diagonal = further * count + step, further * count + after
    odd = (line % 2 == 1)[..., None]
    first = np.where(odd, np.stack([here, diagonal, ahead], -1), np.stack([here, beside, ahead], -1))
    second = np.where(odd, np.stack([here, beside, diagonal], -1), np.stack([ahead, beside, diagonal], -1))
    return np.stack([first, second], axis=2).reshape(-1, 3).astype(np.int32)
