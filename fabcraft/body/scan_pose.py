"""The joints that people hold differently from the model: how its skin follows them.

A bone turns everything beyond its joint; its weight (0 to 1, blended across the joint) says how far a point goes along.
Finger weights are the model's own (`HandPose`); those of neck, limbs and toes are smooth steps along the bones.  Bones
are applied from the tips to the trunk, so that every joint is where it was in the model when its own turn comes:
x becomes x + w (R - 1)(x - joint).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Float64
from scipy.spatial.transform import Rotation

from fabcraft.body.hand import FINGERS
from fabcraft.body.model import HumanModel

Turns = Float64[np.ndarray, "B 3 3"]
"""The rotation of every bone against the model's own pose."""

_SD_DEG = {
    "head": 12.0, "shoulder": 25.0, "elbow": 20.0, "wrist": 20.0, "finger": 34.0,
    "hip": 10.0, "knee": 8.0, "ankle": 12.0, "toes": 10.0,
}  # fmt: skip
"""Standard deviation of the angle of each kind of joint between scans."""
_BEYOND = {
    "shoulder": ("elbow", "lowerarm", "wrist", "metacarpal", "finger"),
    "elbow": ("lowerarm", "wrist", "metacarpal", "finger"),
    "wrist": ("metacarpal", "finger"),
    "hip": ("knee", "foot", "toe1_1"),
    "knee": ("foot", "toe1_1"),
    "ankle": ("toe1_1",),
    "toes": (),
}
"""What the joint names begin with that go along with each bone."""
HIP = (0.62, 0.12)
"""Where a hip joint is, which the model has none of: sideways as a share of the knee's, down of the way to it."""


@dataclass(frozen=True, eq=False)
class Bone:
    """A joint and what follows it."""

    name: str
    joint: int
    """Row of the points that it turns about."""
    weights: Float64[np.ndarray, " P"]
    sd: float
    """Standard deviation of its angle, radians."""


def posed(
    points: Float64[np.ndarray, "P 3"], bones: Sequence[Bone], turns: Turns
) -> tuple[Float64[np.ndarray, "P 3"], Float64[np.ndarray, "P 3 3"]]:
    """(the points with every bone turned, how each point's surroundings are turned by that)."""
    out, spins = points.copy(), np.broadcast_to(np.eye(3), (len(points), 3, 3)).copy()
    for bone, turn in zip(bones, turns, strict=True):
        moving = np.flatnonzero(bone.weights)
        share, change = bone.weights[moving], turn - np.eye(3)
        out[moving] += share[:, None] * ((out[moving] - out[bone.joint]) @ change.T)
        spins[moving] += share[:, None, None] * (change @ spins[moving])
    return out, spins


def turned_by(
    bones: Sequence[Bone],
    turns: Turns,
    spins: Float64[np.ndarray, "P 3 3"],
    steps: Float64[np.ndarray, "B 3"],
) -> Turns:
    """`turns` after every bone was turned further by a small rotation vector in the posed frame."""
    changed = turns.copy()
    for index, bone in enumerate(bones):
        left, _, right = np.linalg.svd(spins[bone.joint])
        changed[index] = Rotation.from_rotvec((left @ right).T @ steps[index]).as_matrix() @ turns[index]
    return changed


def angles(turns: Turns) -> Float64[np.ndarray, "B 3"]:
    """Rotation vectors of the bones, radians."""
    return Rotation.from_matrix(turns).as_rotvec().reshape(-1, 3) if len(turns) else np.zeros((0, 3))


def with_hips(points: Float[np.ndarray, "... P 3"], names: Sequence[str]) -> Float[np.ndarray, "... Q 3"]:
    """The model's points, or their movements, with the two hip joints after them."""
    first = points.shape[-2] - len(names)
    pelvis = points[..., first + names.index("pelvis"), :]
    hips = []
    for side in ("left", "right"):
        knee = points[..., first + names.index(f"knee_{side}"), :]
        hip = pelvis + HIP[1] * (knee - pelvis)
        hip[..., 0] = HIP[0] * knee[..., 0]
        hips.append(hip)
    return np.concatenate([points, np.stack(hips, axis=-2)], axis=-2)


def bones_of(model: HumanModel, adult: Float64[np.ndarray, "P 3"], names: Sequence[str]) -> dict[str, Bone]:
    """All bones by name, from the tips to the trunk, for points (skin, then joints called `names`) at `adult`."""
    skin = len(adult) - len(names)
    row = {name: skin + index for index, name in enumerate(names)}
    bones: dict[str, Bone] = {}
    for side in ("left", "right"):
        bones |= _fingers(model, row, side, len(adult))
        at = {name: adult[row[f"{name}_{side}"]] for name in ("shoulder", "elbow", "wrist", "finger3_3")}
        at |= {name: adult[row[f"{name}_{side}"]] for name in ("hip", "knee", "foot", "toe1_1")}
        arm = _beside(adult, [at["shoulder"], at["elbow"], at["wrist"], at["finger3_3"]])
        leg = _ramp(adult[:, 0] * (1.0 if side == "left" else -1.0), 0.0, 15.0) * (
            adult[:, 2] < at["hip"][2] + 80.0
        )
        upper, fore = at["elbow"] - at["shoulder"], at["wrist"] - at["elbow"]
        thigh, shin, foot = at["knee"] - at["hip"], at["foot"] - at["knee"], at["toe1_1"] - at["foot"]
        for name, joint, along, width, member in (
            ("wrist", "wrist", fore, 0.06, arm),
            ("elbow", "elbow", fore, 0.12, arm),
            ("shoulder", "shoulder", upper, 0.18, arm),
            ("toes", "toe1_1", foot, 0.1, leg),
            ("ankle", "foot", shin, 0.07, leg),
            ("knee", "knee", shin, 0.12, leg),
            ("hip", "hip", thigh, 0.2, leg),
        ):
            length = float(np.linalg.norm(along))
            weights = member * _ramp((adult - at[joint]) @ along / length, 0.0, width * length)
            weights[skin:] = [
                name_.endswith(side) and name_.startswith(_BEYOND[name]) if _BEYOND[name] else False
                for name_ in names
            ]
            bones[f"{name}_{side}"] = Bone(
                f"{name}_{side}", row[f"{joint}_{side}"], weights, np.radians(_SD_DEG[name])
            )
    low, high = adult[row["neck_root"]], adult[row["head"]]
    weights = _ramp(adult[:, 2], 0.5 * (low[2] + high[2]), 0.5 * (high[2] - low[2]))
    weights[skin:] = [name in ("head", "eye_left", "eye_right") for name in names]
    bones["head"] = Bone("head", row["neck_root"], weights, np.radians(_SD_DEG["head"]))
    return bones


def _fingers(model: HumanModel, row: dict[str, int], side: str, count: int) -> dict[str, Bone]:
    """The finger bones of one hand, tips first."""
    vertices = model.hand.vertices if side == "left" else model.hand.opposite[model.hand.vertices]
    bones = {}
    for index, finger in enumerate(FINGERS):
        for bone in (3, 2, 1):
            weights = np.zeros(count)
            weights[vertices] = model.hand.weights[:, 3 * index + bone - 1 : 3 * index + 3].sum(1)
            weights[[row[f"finger{finger}_{later}_{side}"] for later in range(bone + 1, 4)]] = 1.0
            name = f"finger{finger}_{bone}_{side}"
            bones[name] = Bone(name, row[name], weights, np.radians(_SD_DEG["finger"]))
    return bones


def _ramp(value: np.ndarray, middle: float, half: float) -> np.ndarray:
    """0 below, 1 above, smooth over `half` on both sides of `middle`."""
    share = np.clip(0.5 + 0.5 * (value - middle) / half, 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def _beside(points: np.ndarray, line: list[np.ndarray]) -> np.ndarray:
    """1 near the polyline of an arm, 0 beyond a third of the upper arm's length."""
    nearest = np.full(len(points), np.inf)
    for start, end in pairwise(line):
        along = end - start
        share = np.clip((points - start) @ along / (along @ along), 0.0, 1.2)
        nearest = np.minimum(nearest, np.linalg.norm(points - start - share[:, None] * along, axis=1))
    upper = float(np.linalg.norm(line[1] - line[0]))
    return 1.0 - _ramp(nearest, 0.29 * upper, 0.06 * upper)
