"""Where a body is cut for each part: planes through joints and landmarks.

head                 head and neck, level, 60 mm below the neck root
bust                 head, neck, shoulders and upper chest: level under the chest, upright beside the shoulders
hand_left, _right    hand and forearm, square to the forearm, 120 mm above the wrist
foot_left, _right    foot and ankle, level, 90 mm above the ankle joint

Small limbs are cut nearer: 0.8 of the forearm at most, and 0.45 of the foot's length above its ankle.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from fabcraft.errors import InputError

Points = Mapping[str, np.ndarray]
Plane = tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]
"""(a point of the plane, the unit normal towards what is kept)."""

NECK_BELOW_ROOT_MM = 60.0
FOREARM_MM = 120.0
ABOVE_ANKLE_MM = 90.0
PARTS = ("head", "bust", "hand_left", "hand_right", "foot_left", "foot_right")

_UP = np.array([0.0, 0.0, 1.0])
_CHEST_DEPTH, _BESIDE_SHOULDER = 0.30, 0.05
"""Of the bust, shares of the distance between the acromia: below the jugular notch, beyond each acromion."""


@dataclass(frozen=True, eq=False)
class Cut:
    """How a part is separated from its body."""

    planes: tuple[Plane, ...]
    anchor: Float64[np.ndarray, "3"]
    """A point inside; of several pieces between the planes the one nearest to it is the part."""
    crop: tuple[Plane, ...] = ()
    """Planes outside of these, which crop the skin before it is smoothed; every opening they make must be a ring of
    its own.  The planes themselves, moved outwards, when there are none."""
    finer: int = 0
    """Subdivisions beyond the body's own, where its skin is coarse."""
    longest_mm: float = np.inf
    """Longer edges are halved after that."""
    scale: float = 1.0
    """Size of the part over a median man's, for a body that is no person."""
    measured_from: tuple[str, ...] = ()
    """The places that the planes are measured from; the part keeps them, even beyond a cut."""


def cut_of(name: str, body: str, joints: Points, landmarks: Points) -> Cut:
    """The cut of the part `name` for a body called `body` with these places, mm.

    Raises `InputError` for an unknown part, and for a body that lacks a place the cut is measured from.
    """
    kind, _, side = name.partition("_")
    if name not in PARTS:
        raise InputError(f"body {body} has no part '{name}'", f"Parts: {', '.join(PARTS)}.")
    cut, needed = _CUTS[kind]
    places = {**landmarks, **joints}
    wanted = [key.replace("*", side) for key in needed]
    missing = [key for key in wanted if key not in places]
    if missing:
        raise InputError(
            f"body {body} has no {', '.join(missing)}, so its part '{name}' cannot be cut off",
            "Choose a body that has that part (fabcraft bodies).",
        )
    return replace(cut(*(places[key] for key in wanted)), measured_from=tuple(wanted))


def _head(neck_root: np.ndarray, head: np.ndarray) -> Cut:
    return Cut(((neck_root - NECK_BELOW_ROOT_MM * _UP, _UP),), head)


def _bust(notch: np.ndarray, left: np.ndarray, right: np.ndarray, head: np.ndarray) -> Cut:
    across = (left - right) * [1.0, 1.0, 0.0]
    width = float(np.linalg.norm(across))
    across = across / width
    beyond = _BESIDE_SHOULDER * width * across
    floor = notch - _CHEST_DEPTH * width * _UP
    planes = (floor, _UP), (left + beyond, -across), (right - beyond, across)
    below = (
        floor - _CHEST_DEPTH * width * _UP,
        _UP,
    )  # under the armpits, where arms and chest are rings apart
    return Cut(planes, head, (below,), longest_mm=8.0)


def _hand(wrist: np.ndarray, forearm: np.ndarray) -> Cut:
    along = wrist - forearm  # the bone begins in the middle of the forearm
    half = float(np.linalg.norm(along))
    along = along / half
    return Cut(((wrist - min(FOREARM_MM, 1.6 * half) * along, along),), wrist)


def _foot(ankle: np.ndarray, heel: np.ndarray, toe_tip: np.ndarray) -> Cut:
    length = float(np.linalg.norm(toe_tip - heel))
    return Cut(((ankle + min(ABOVE_ANKLE_MM, 0.45 * length) * _UP, -_UP),), ankle, finer=1)


_CUTS: Mapping[str, tuple[Callable[..., Cut], tuple[str, ...]]] = {
    "head": (_head, ("neck_root", "head")),
    "bust": (_bust, ("jugular_notch", "acromion_left", "acromion_right", "head")),
    "hand": (_hand, ("wrist_*", "lowerarm_*")),
    "foot": (_foot, ("foot_*", "heel_*", "toe_tip_*")),
}
