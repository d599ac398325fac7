"""`HumanModel`: the baked linear model of people (`human.npz`, made by `bake`).

x = mean + B c: skin vertices and joints in mm.  Coefficients are standard deviations of a large mixed population:
first the common ones (principal components of age, sex, stature, build), then the local ones (wrist girth, finger
girth, foot length, parts of the face), then for every local change of a limb its difference between left and right.
The file holds the left half; people are mirror images of themselves but for those differences.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.resources import files

import numpy as np
from jaxtyping import Float32, Float64, Int32, Int64

from fabcraft.body.body import Body
from fabcraft.body.hand import HandPose
from fabcraft.body.region import Region, human_region
from fabcraft.mesh import Mesh

ALIKE = 0.17
"""Standard deviation of the common coefficients among people of one age and sex, against the whole population's.
With it the model's spread of women is near to ANSUR II's: 66 mm of stature (64 there), 19 of the head (19), 9.6 of the
wrist (8), 14 of the foot (13), 15 of the neck (18)."""


@dataclass(frozen=True, eq=False)
class HumanModel:
    """The baked linear model of people."""

    mean: Float32[np.ndarray, "P 3"]
    """Skin vertices, then joints."""
    basis: Float32[np.ndarray, "K P 3"]
    """Movement by one standard deviation of each coefficient."""
    common: int
    """How many coefficients, from the first, move the whole body."""
    differences: int
    """How many, at the end, set left and right apart."""
    looks: Int64[np.ndarray, " L"]
    """Which change a face's looks alone, and no measure."""
    faces: Int32[np.ndarray, "F 3"]
    joint_names: tuple[str, ...]
    landmarks: Mapping[str, int]
    """Skin vertex of every landmark but the eye centres."""
    regions: Mapping[str, Region]
    hand: HandPose
    presets: Mapping[str, Float32[np.ndarray, " K"]]
    alike: float = ALIKE
    """Spread of the common coefficients that measures may use."""

    @cached_property
    def spread(self) -> Float64[np.ndarray, " K"]:
        """Standard deviation of every coefficient among adults like one another and of equal looks."""
        spread = np.where(np.arange(len(self.basis)) < self.common, self.alike, 1.0)
        spread[self.looks] = 0.0
        return spread

    def points(self, coefficients: Float32[np.ndarray, " K"]) -> Float64[np.ndarray, "P 3"]:
        """Skin vertices and joints of the person with these coefficients, flat hands, mm."""
        return (self.mean + np.tensordot(coefficients, self.basis, 1)).astype(np.float64)

    def body(self, coefficients: Float32[np.ndarray, " K"], name: str) -> Body:
        """The person with these coefficients."""
        return self.body_at(self.points(coefficients), name)

    def body_at(self, points: Float64[np.ndarray, "P 3"], name: str) -> Body:
        """The person whose skin vertices and joints are the given ones."""
        count = len(points) - len(self.joint_names)
        joints = dict(zip(self.joint_names, points[count:], strict=True))
        landmarks = {key: points[index] for key, index in self.landmarks.items()}
        landmarks |= {key: joints.pop(key) for key in ("eye_left", "eye_right")}
        skin = Mesh(points[:count], self.faces, name)
        return Body(name, skin, landmarks, self.regions, "human", joints, smoothing=1)

    def relaxed(self, points: Float64[np.ndarray, "P 3"]) -> Float64[np.ndarray, "P 3"]:
        """The same person with slightly bent fingers."""
        count = len(points) - len(self.joint_names)
        return self.hand.relaxed(points, count, self.joint_names)


@cache
def human_model() -> HumanModel:
    """The baked model, about 60 ms."""
    with (files("fabcraft.body") / "human.npz").open("rb") as stream, np.load(stream) as arrays:
        return unpacked({key: arrays[key] for key in arrays.files})


def unpacked(stored: Mapping[str, np.ndarray]) -> HumanModel:
    """The model from the arrays of its file."""
    names = tuple(str(name) for name in stored["joint_names"])
    opposite = stored["opposite"].astype(np.int64)
    half = stored["half"].astype(np.int64)
    rows = stored["rows"].astype(np.float32) * stored["scale"][:, None, None]
    paired = stored["paired"].astype(np.int64)
    symmetric, apart = whole(rows, half, opposite), whole(rows[paired], half, opposite, -1.0)
    basis = np.concatenate([symmetric, apart * stored["apart"]])
    emphasis = _named(stored, "emphasis_", np.float64)
    landmarks = [str(name) for name in stored["landmark_names"]]
    return HumanModel(
        mean=whole(stored["mean"][None], half, opposite)[0],
        basis=basis,
        common=int(stored["common"]),
        differences=len(paired),
        looks=stored["looks"].astype(np.int64),
        faces=stored["faces"].astype(np.int32),
        joint_names=names,
        landmarks=dict(zip(landmarks, stored["landmark_vertices"].astype(int).tolist(), strict=True)),
        regions={
            key: human_region(key, members, emphasis[key] / 255.0 if key in emphasis else None)
            for key, members in _named(stored, "region_", np.int64).items()
        },
        hand=HandPose(
            stored["hand_vertices"].astype(np.int64), stored["hand_weights"] / np.float64(255.0), opposite
        ),
        presets=_named(stored, "preset_", np.float32),
    )


def whole(
    rows: Float32[np.ndarray, "R H 3"],
    half: Int64[np.ndarray, " H"],
    opposite: Int64[np.ndarray, " P"],
    sign: float = 1.0,
) -> Float32[np.ndarray, "R P 3"]:
    """Both halves of fields given on the left one; `sign` -1 moves the right side the opposite way.

    half : the points on the left and in the middle; opposite : the mirror image of every point.
    """
    full = np.zeros((len(rows), len(opposite), 3), dtype=np.float32)
    full[:, opposite[half]] = rows * np.array([-sign, sign, sign], dtype=np.float32)
    full[:, half] = rows
    middle = half[opposite[half] == half]
    if sign < 0:
        full[:, middle] = 0.0
    else:
        full[:, middle, 0] = 0.0
    return full


def _named(arrays: Mapping[str, np.ndarray], prefix: str, kind: type) -> dict[str, np.ndarray]:
    """The arrays whose name starts with `prefix`, under the rest of the name."""
    return {key.removeprefix(prefix): arrays[key].astype(kind) for key in arrays if key.startswith(prefix)}
