"""A limb as its sections: the ovals that a band has to go round, and the way along it that the band comes off."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d

from fabcraft.body.tape import girth
from fabcraft.errors import InputError
from fabcraft.geometry.oval import Oval
from fabcraft.mesh import Mesh

Axes = Float64[np.ndarray, "3 3"]
"""Unit rows, right-handed; the third is the limb's direction."""


_RUN_UP = 8


@dataclass(frozen=True, eq=False)
class Station:
    """A section of a limb."""

    origin: Float64[np.ndarray, "3"]
    """On the limb's axis, mm."""
    axes: Axes
    oval: Oval
    """The tape round the section nearest to the origin, in the first two axes."""

    @property
    def middle(self) -> Float64[np.ndarray, "3"]:
        """The middle of the section, mm."""
        return self.origin + self.oval.middle @ self.axes[:2]


def facing(axis: Float[np.ndarray, "3"], towards: Float[np.ndarray, "3"]) -> Axes:
    """Axes with the third along `axis` and the second as near to `towards` as can be."""
    third = axis / np.linalg.norm(axis)
    second = towards - (towards @ third) * third
    second = second / np.linalg.norm(second)
    return np.stack([np.cross(second, third), second, third])


def station(mesh: Mesh, origin: Float64[np.ndarray, "3"], axes: Axes) -> Station:
    """The section of the skin through `origin`, square to the third of the axes."""
    points = girth(mesh, origin, axes[2]).points
    return Station(origin, axes, Oval.around((points - origin) @ axes[:2].T, soften_deg=4.0))


def centred(
    mesh: Mesh, origin: Float64[np.ndarray, "3"], axes: Axes, half_mm: float
) -> tuple[Float64[np.ndarray, "3"], Axes]:
    """Origin and axes moved to the middle of the flesh within `half_mm` either way, which bones seldom are in."""
    for _ in range(2):
        ends = [station(mesh, origin + at * axes[2], axes).middle for at in (-half_mm, 0.0, half_mm)]
        origin, axes = ends[1], facing(ends[2] - ends[0], axes[1])
    return origin, axes


def straight(waypoints: Sequence[Float64[np.ndarray, "3"]], count: int) -> Float64[np.ndarray, "K 3"]:
    """`count` points evenly spaced along a smooth line through the waypoints."""
    corners = np.stack(waypoints)
    knots = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    return PchipInterpolator(knots, corners)(np.linspace(0.0, knots[-1], count))


def middles(mesh: Mesh, bones: Float64[np.ndarray, "K 3"], axes: Axes) -> Float64[np.ndarray, "K 3"]:
    """The line through the middles of the sections of a limb, led along its `bones`, which seldom lie in the middle.

    It begins at the first of them in the direction of the axes; past the tip it goes straight on.
    """
    found, turned = [bones[0]], axes
    for place, direction in zip(bones[1:], np.gradient(bones, axis=0)[1:], strict=True):
        turned = facing(direction, turned[1])
        section = _section(mesh, place, turned)
        if section is None:  # past the tip
            break
        found.append(section.middle)
    step = float(np.linalg.norm(bones[1] - bones[0]))
    before = found[0] - step * axes[2] * np.arange(_RUN_UP, 0, -1)[:, None]
    last = found[-1] - found[-min(4, len(found))]
    beyond = (
        found[-1] + step * last / np.linalg.norm(last) * np.arange(1, len(bones) + 1 - len(found))[:, None]
    )
    line = gaussian_filter1d(np.concatenate([before, np.stack(found), beyond]), 2.0, axis=0, mode="nearest")
    line[_RUN_UP] = found[0]
    return line[_RUN_UP:]


def along(mesh: Mesh, line: Float64[np.ndarray, "K 3"], axes: Axes) -> tuple[Station, ...]:
    """The sections along `line`, the first with the given axes; they turn with the line and not about it.

    Past the tip the last section goes on.
    """
    stations = [station(mesh, line[0], axes)]
    for place, direction in zip(line[1:], np.gradient(line, axis=0)[1:], strict=True):
        axes = facing(direction, axes[1])
        found = _section(mesh, place, axes)
        stations.append(Station(place, axes, stations[-1].oval if found is None else found.oval))
    return tuple(stations)


def _section(mesh: Mesh, origin: Float64[np.ndarray, "3"], axes: Axes) -> Station | None:
    """The section there; None where the limb has ended, so that the nearest section is of another one."""
    try:
        found = station(mesh, origin, axes)
    except InputError:
        return None
    beside = found.oval.located(np.zeros((1, 2)))[1][0]
    return found if beside < 0.05 * found.oval.length else None


def poses(stations: Sequence[Station], held: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "K 4 4"]:
    """Transforms that carry the middle of a band, now at `held`, along the middles of the sections; the first is nothing.

    What the band is off the middle at its seat fades over the first sixth of the way.
    """
    start = stations[0]
    off = held - start.middle
    found = np.tile(np.eye(4), (len(stations), 1, 1))
    for index, one in enumerate(stations):
        turn = one.axes.T @ start.axes
        fade = np.clip(1.0 - 6.0 * index / len(stations), 0.0, 1.0)
        found[index, :3, :3] = turn
        found[index, :3, 3] = one.middle + fade * (turn @ off) - turn @ held
    return found


def loft(stations: Sequence[Station], name: str) -> Mesh:
    """The closed surface through the ovals of the stations, capped flat at both ends."""
    step = 8
    rings = np.stack([one.origin + one.oval.points()[::step] @ one.axes[:2] for one in stations])
    count, size = rings.shape[:2]
    ring, at = np.meshgrid(np.arange(count - 1), np.arange(size), indexing="ij")
    here, beside = ring * size + at, ring * size + (at + 1) % size
    sides = np.stack(
        [np.stack([here, beside, beside + size], -1), np.stack([here, beside + size, here + size], -1)]
    )
    around = np.arange(size)
    caps = [
        np.stack([np.roll(around, -1), around, np.full(size, count * size)], 1),
        np.stack([around, np.roll(around, -1), np.full(size, count * size + 1 - (count - 1) * size)], 1)
        + (count - 1) * size,
    ]
    points = np.concatenate([rings.reshape(-1, 3), rings[0].mean(0)[None], rings[-1].mean(0)[None]])
    return Mesh(points, np.concatenate([sides.reshape(-1, 3), *caps]).astype(np.int32), name)
