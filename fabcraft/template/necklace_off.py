"""How a necklace comes off: a closed one over the head, a collar to the front through the gap at its nape."""

import itertools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from fabcraft.errors import InputError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.passage import passage
from fabcraft.mesh import Mesh
from fabcraft.template.limb import Station, loft, poses, station
from fabcraft.template.neck import LEVEL, ROUND_MM, Neck, head_slices
from fabcraft.template.rolled import Rolled
from fabcraft.template.template import DonningPath

_FLEX, _SKIN_GIVES_MM = 0.085, 3.0
_POSES = 36


def over_the_head(neck: Neck, rolled: Rolled) -> DonningPath:
    """Lifted off the shoulders, levelled, and over the head."""
    seat = Station(rolled.origin, rolled.axes, rolled.oval)
    lifted = poses([seat, *head_slices(neck, neck.tall)], rolled.middle)
    filled = [lifted[0]]
    for before, after in itertools.pairwise(lifted):
        filled += [_between(before, after, 0.5), after]
    gives = 0.0 if neck.part.kind == "character" else _SKIN_GIVES_MM
    return DonningPath(
        np.stack(filled), gives, "ears and hair give", loft(head_slices(neck), "head with the ears laid back")
    )


def _between(one: Float64[np.ndarray, "4 4"], other: Float64[np.ndarray, "4 4"], share: float) -> np.ndarray:
    """The pose between two that differ little: the mean, made a rotation again."""
    mean = (1.0 - share) * one + share * other
    left, _, right = np.linalg.svd(mean[:3, :3])
    mean[:3, :3] = left @ right
    return mean


@dataclass(frozen=True, eq=False)
class Way:
    """How a collar comes off to the front."""

    gap: float
    gives: float
    why: str
    rise: Float64[np.ndarray, "3"]
    """To where the neck is slender."""
    travel: float
    """From there to the front, mm."""

    def path(self, rises: bool, down_deg: float) -> DonningPath:
        """Up first or not, then to the front and down by that angle."""
        step, down = np.linspace(0.0, 1.0, _POSES), np.radians(down_deg)
        off = np.maximum(0.0, (step - 0.25) / 0.75)
        poses_ = np.tile(np.eye(4), (_POSES, 1, 1))
        front = np.array([0.0, -np.cos(down), -np.sin(down)])
        poses_[:, :3, 3] = np.outer(np.minimum(4.0 * step, 1.0) * rises, self.rise) + np.outer(
            off * self.travel, front
        )
        return DonningPath(poses_, self.gives, self.why)


def to_the_front(neck: Neck, rolled: Rolled, asked: float | str | None) -> Way:
    """The gap at the nape that lets the neck through where it is most slender, and the way there and off."""
    flex = _FLEX * rolled.oval.length / np.pi
    gives = flex + (0.0 if neck.part.kind == "character" else _SKIN_GIVES_MM)
    back = rolled.world(np.array([[0.5 * rolled.oval.length, 0.0, 0.0]]))[0]
    axis = (neck.at["head"] - neck.at["neck_root"]) / (neck.at["head"] - neck.at["neck_root"])[2]
    highest = 0.6 * float(neck.at["menton"][2] - neck.at["jugular_notch"][2])
    rises = np.linspace(0.0, max(highest, 0.0), 9)
    breadths = [_breadth(neck, back[2] + rise, axis) for rise in rises]
    best = int(np.argmin(breadths))
    # or along its own plane, where the neck is as broad as the collar but for the clearance
    breadth = min(breadths[best], rolled.oval.width(0.0) - 2.0 * neck.part.clearance_mm(ROUND_MM))
    needed = breadth - 2.0 * gives
    gap = max(0.75 * breadth, needed + 1.5) if asked is None else float(asked)
    if gap < needed:
        raise InputError(
            f"a gap of {gap:.0f} mm does not let the neck through, {breadth:.0f} mm broad there, although the ends spring "
            f"open by {flex:.0f} mm each",
            f"Choose a gap of {np.ceil(needed):.0f} mm or more.",
        )
    travel = 2.0 * rolled.oval.width(0.5 * np.pi) + 4.0 * neck.tube
    return Way(gap, gives, f"each end springs open by {flex:.0f} mm", rises[best] * axis, travel)


def easiest(way: Way, tube: Mesh, surface: SurfaceDistance) -> DonningPath:
    """The first way that presses no more than allowed, or the one that presses least."""
    points = tube.vertices[:: max(1, len(tube.vertices) // 600)]
    best, least = way.path(True, 0.0), np.inf
    for rises, down_deg in ((True, 0.0), *((False, down) for down in (0.0, 20.0, 30.0, 40.0, 50.0, 60.0))):
        path = way.path(rises, down_deg)
        pressed = float(passage(points, path.poses, surface).depth_mm.max())
        if pressed < least:
            best, least = path, pressed
        if least <= path.allowed_mm:
            break
    return best


def _breadth(neck: Neck, z: float, axis: Float64[np.ndarray, "3"]) -> float:
    """Breadth of the neck under the ends of a collar at that height."""
    root, mesh = neck.at["neck_root"], neck.part.mesh
    heights = z + 0.5 * neck.tall * np.array([-1.0, 1.0])
    return max(station(mesh, root + (one - root[2]) * axis, LEVEL).oval.width(0.0) for one in heights)
