"""`human(name)`: a ready person from the baked body model (`human.npz`, made by `bake`).

x = mean + B c: skin vertices and joints in mm from 64 coefficients in standard deviations; the presets are
coefficient vectors.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from jaxtyping import Float32, Float64, Int32

from fabcraft.body.body import Body
from fabcraft.body.region import Region, human_region
from fabcraft.errors import InputError
from fabcraft.mesh import Mesh

PRESETS = ("man", "woman", "child")


@dataclass(frozen=True, eq=False)
class HumanModel:
    """The baked linear model of people."""

    mean: Float32[np.ndarray, "P 3"]
    """Skin vertices, then joints."""
    basis: Float32[np.ndarray, "K P 3"]
    """Movement by one standard deviation of each component."""
    faces: Int32[np.ndarray, "F 3"]
    joint_names: tuple[str, ...]
    landmarks: Mapping[str, int]
    """Skin vertex of every landmark but the eye centres."""
    regions: Mapping[str, Region]
    presets: Mapping[str, Float32[np.ndarray, " K"]]

    def body(self, coefficients: Float32[np.ndarray, " K"], name: str) -> Body:
        """The person with these coefficients."""
        points = self.mean + np.tensordot(coefficients, self.basis, 1)
        return self.body_at(points.astype(np.float64), name)

    def body_at(self, points: Float64[np.ndarray, "P 3"], name: str) -> Body:
        """The person whose skin vertices and joints are the given ones."""
        count = len(points) - len(self.joint_names)
        joints = dict(zip(self.joint_names, points[count:], strict=True))
        landmarks = {key: points[index] for key, index in self.landmarks.items()}
        landmarks |= {key: joints.pop(key) for key in ("eye_left", "eye_right")}
        skin = Mesh(points[:count], self.faces, name)
        return Body(name, skin, landmarks, self.regions, "human", joints, smoothing=1)


def human_model() -> HumanModel:
    """The baked model, about 20 ms."""
    with (files("fabcraft.body") / "human.npz").open("rb") as stream, np.load(stream) as arrays:
        model = {key: arrays[key] for key in arrays.files}
    basis = model["basis"] * model["scale"][:, None]
    emphasis = _named(model, "emphasis_", np.float64)
    names = [str(name) for name in model["landmark_names"]]
    return HumanModel(
        model["mean"].reshape(-1, 3),
        basis.reshape(len(basis), -1, 3),
        model["faces"].astype(np.int32),
        tuple(str(name) for name in model["joint_names"]),
        dict(zip(names, (int(index) for index in model["landmark_vertices"]), strict=True)),
        {
            key: human_region(
                key, members, shares / 255.0 if (shares := emphasis.get(key)) is not None else None
            )
            for key, members in _named(model, "region_", np.int64).items()
        },
        _named(model, "preset_", np.float32),
    )


def _named(model: Mapping[str, np.ndarray], prefix: str, kind: type) -> dict[str, np.ndarray]:
    """The arrays whose name starts with `prefix`, under the rest of the name."""
    return {key.removeprefix(prefix): model[key].astype(kind) for key in model if key.startswith(prefix)}


def human(name: str) -> Body:
    """The body called `name`: man and woman with the median head of ANSUR II, child of about nine years.

    Raises `InputError` for another name.
    """
    if name not in PRESETS:
        raise InputError(
            f"there is no body called '{name}'",
            f"Choose one of: {', '.join(PRESETS)}; or give the path of a head scan.",
        )
    model = human_model()
    return model.body(model.presets[name], name)
