"""`Sampler`: anny as a function from named parameters to our skin and joints (extra `fabcraft[bake]`)."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float64

from fabcraft.body.bake_skin import Skin, joint_names, skin_of
from fabcraft.body.body import Body
from fabcraft.errors import MissingError
from fabcraft.mesh import Mesh

NEUTRAL = {"gender": 0.5, "age": 2 / 3, "height": 0.5}
"""The neutral adult; what is not named is 0.5 (phenotypes) or 0 (local changes)."""


class Sampler:
    """anny with its local changes, about 100 s on its first use on a machine, then 3 s."""

    def __init__(self) -> None:
        try:
            import anny
        except ImportError as error:
            raise MissingError("anny is not installed", "pip install 'fabcraft[bake]'") from error
        self.model = anny.Anny(local_changes="default")
        self.skin: Skin = skin_of(self.model)
        self.count = int(self.skin.faces.max()) + 1

    def points(self, parameters: Mapping[str, float]) -> Float64[np.ndarray, "P 3"]:
        """Skin vertices, then the joints: bone heads and eye centres, mm.

        parameters : phenotypes and local changes by anny's names; `?` in one stands for both sides.
        """
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
