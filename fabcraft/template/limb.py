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


def way(
    mesh: Mesh, waypoints: Sequence[Float64[np.ndarray, "3"]], axes: Axes, count: int
) -> tuple[Station, ...]:
    """`count` sections along the middle of the limb, from the first of `waypoints` to the last.

    The first has the given axes; they turn with the limb and not about it.  The waypoints (joints) only lead the way: the
    line is that through the middles of the sections.  Past the tip the last section goes on.
    """
    corners = np.stack(waypoints)
    knots = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    bones, at = PchipInterpolator(knots, corners), np.linspace(0.0, knots[-1], count)
    middles, turned = [corners[0]], axes
    for place, direction in zip(bones(at[1:]), bones(at[1:], 1), strict=True):
        turned = facing(direction, turned[1])
        found = _section(mesh, place, turned)
        if found is None:  # past the tip
            break
        middles.append(found.middle)
    line = _smooth_line(np.stack(middles), axes[2], at[1] - at[0], count)
    stations = [station(mesh, line[0], axes)]
    for index in range(1, count):
        before = line[index + 1] - line[index - 1] if index + 1 < count else line[index] - line[index - 1]
        axes = facing(before, axes[1])
        found = _section(mesh, line[index], axes) if index < len(middles) else None
        oval = stations[-1].oval if found is None else found.oval
        stations.append(Station(line[index], axes, oval))
    return tuple(stations)


def _section(mesh: Mesh, origin: Float64[np.ndarray, "3"], axes: Axes) -> Station | None:
    """The section there; None where the limb has ended, so that the nearest section is of another one."""
    try:
        found = station(mesh, origin, axes)
    except InputError:
        return None
    beside = found.oval.located(np.zeros((1, 2)))[1][0]
    return found if beside < 0.05 * found.oval.length else None


def _smooth_line(
    middles: Float64[np.ndarray, "M 3"], start: Float64[np.ndarray, "3"], step: float, count: int
) -> Float64[np.ndarray, "K 3"]:
    """Middles without jitter, beginning in the direction `start` and going on straight past their end."""
    before = middles[0] - step * start * np.arange(_RUN_UP, 0, -1)[:, None]
    last = middles[-1] - middles[-min(4, len(middles))]
    beyond = (
        middles[-1] + step * last / np.linalg.norm(last) * np.arange(1, count + 1 - len(middles))[:, None]
    )
    whole = gaussian_filter1d(np.concatenate([before, middles, beyond]), 2.0, axis=0, mode="nearest")
    whole[_RUN_UP] = middles[0]
    return whole[_RUN_UP:]


def poses(stations: Sequence[Station], held: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "K 4 4"]:
    """Transforms that carry the middle of a band, now at `held`, along the middles of the sections; the first is nothing.

    What the band is off the middle at its seat fades over the first third of the way.
    """
    start = stations[0]
    off = held - start.middle
    found = np.tile(np.eye(4), (len(stations), 1, 1))
    for index, one in enumerate(stations):
        turn = one.axes.T @ start.axes
        fade = np.clip(1.0 - 3.0 * index / len(stations), 0.0, 1.0)
        found[index, :3, :3] = turn
        found[index, :3, 3] = one.middle + fade * (turn @ off) - turn @ held
    return found
