"""`TextGuidance`: the object should look like some words (the paper's text route).

Three losses on the rendered views, each 0 at best:

    clip         1 - mean cos(E(I), E(P)),
    direction    1 - mean cos(E(I) - E(I0), E(P) - E(P0)), with I0 the rest shape from the same camera and P0 a base prompt,
    consistency  1 - mean cosine of a vertex's features in neighbouring views.

`clip` and `direction` are means over views; `consistency` is a mean over pairs of views, so neighbours belong into one
chunk.
"""

from collections.abc import Mapping

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from fabcraft.errors import InputError
from fabcraft.guidance.background import jittered
from fabcraft.guidance.clip import ClipModel
from fabcraft.guidance.consistency import consistency_loss, near_pairs, nearest_patch
from fabcraft.guidance.embedding import cosine_loss, direction_loss
from fabcraft.guidance.guidance import Views

WEIGHTS = {"clip": 1.0, "direction": 1.0, "consistency": 0.5}
"""Of the paper's base method."""


class TextGuidance:
    """A prompt as an objective. Call `prepare` with the rest shape's views before the first step, given a base prompt."""

    outputs: tuple[str, ...] = ("shaded", "mask")

    def __init__(
        self,
        model: ClipModel,
        prompt: str,
        base_prompt: str | None = None,
        *,
        weights: Mapping[str, float] | None = None,
        consistency: bool = True,
        seed: int = 0,
    ) -> None:
        """`base_prompt`: what the template is, such as "a mask"; without it there is no direction.

        weights : of "clip", "direction" and "consistency"; `WEIGHTS` where not given. A loss of weight 0 is not computed.
        consistency : compare patches between views, which costs several times the rest of a step.
        seed : of the backgrounds.

        Raises `InputError` for an unusable prompt, a base prompt equal to it, an unknown or negative weight, and an encoder
        without patches when consistency is asked for.
        """
        absent = {
            name for name, there in (("direction", base_prompt), ("consistency", consistency)) if not there
        }
        self.weights = _weights(weights or {}, absent)
        self._model, self._seed = model, seed
        self._prompt, self._base_prompt = prompt, base_prompt
        self._target = model.encode_text([prompt])
        self._direction: Tensor | None = None
        if base_prompt is not None:
            goal, base = model.encode_text([prompt, base_prompt], unit=False)
            if prompt.strip().lower() == base_prompt.strip().lower():
                raise InputError(f"prompt and base prompt are both '{prompt}'", "Name what should change.")
            self._direction = goal - base
        if self.weights.get("consistency"):
            _ = model.patch  # refuses an encoder without patches before any work
        self._backgrounds: dict[int, Tensor] = {}
        self._rest: dict[int, Tensor] = {}

    def describe(self) -> str:
        """One line for the report."""
        away = "" if self._base_prompt is None else f", away from '{self._base_prompt}'"
        return f"text '{self._prompt}'{away}, as {self._model.name} reads it"

    @torch.no_grad()
    def prepare(self, rest: Views) -> None:
        """Keep what the views of the rest shape look like; call it for every chunk of the bank."""
        if self.weights.get("direction"):
            shaded, mask = _pictures(rest)
            vectors = self._model.encode_images(shaded, mask, self._behind(rest.camera), unit=False)
            self._rest.update(
                {int(camera): vector for camera, vector in zip(rest.camera, vectors, strict=True)}
            )

    def losses(self, views: Views) -> Mapping[str, Float[Tensor, ""]]:
        """0-d tensors of "clip", "direction" and "consistency", those with a weight.

        Raises `InputError` when a direction is asked for and a camera's rest shape was not prepared.
        """
        shaded, mask = _pictures(views)
        behind = self._behind(views.camera)
        found: dict[str, Tensor] = {}
        if self.weights.get("clip") or self.weights.get("direction"):
            vectors = self._model.encode_images(shaded, mask, behind, unit=False)
            if self.weights.get("clip"):
                found["clip"] = cosine_loss(vectors, self._target)
            if self.weights.get("direction") and self._direction is not None:
                found["direction"] = direction_loss(vectors, self._rested(views.camera), self._direction)
        if self.weights.get("consistency"):
            found["consistency"] = self._consistency(views, shaded, mask, behind)
        return {name: value.to(views.positions) for name, value in found.items()}

    def _consistency(self, views: Views, shaded: Tensor, mask: Tensor, behind: Tensor) -> Tensor:
        if not near_pairs(views.azimuth_deg, views.elevation_deg):
            return shaded.sum() * 0.0  # without the cost of the features
        features = self._model.patch_features(shaded, mask, behind)
        rows, columns = features.shape[1:3]
        picture = (int(shaded.shape[1]), int(shaded.shape[2]))
        size, patch = self._model.size, self._model.patch
        pixels, visible = views.pixels.to(features.device), views.visible.to(features.device)
        patches = nearest_patch(pixels, visible, picture, size, (rows, columns), patch)
        return consistency_loss(features, patches, views.azimuth_deg, views.elevation_deg)

    def _rested(self, cameras: Int[np.ndarray, " K"]) -> Tensor:
        absent = sorted({int(camera) for camera in cameras} - self._rest.keys())
        if absent:
            raise InputError(
                f"the rest shape was not seen from camera {absent[0]}", "Call prepare with its views first."
            )
        return torch.stack([self._rest[int(camera)] for camera in cameras])

    def _behind(self, cameras: Int[np.ndarray, " K"]) -> Tensor:
        """The cameras' backgrounds, made when a camera is first used."""
        for camera in map(int, cameras):
            if camera not in self._backgrounds:
                made = jittered([camera], self._model.size, self._seed)[0]
                self._backgrounds[camera] = made.to(self._model.device)
        return torch.stack([self._backgrounds[int(camera)] for camera in cameras])


def _weights(given: Mapping[str, float], absent: set[str]) -> dict[str, float]:
    """What counts: `WEIGHTS` with those given, without those that cannot be had."""
    wrong = sorted(name for name, value in given.items() if name not in WEIGHTS or not value >= 0)
    wrong += sorted(name for name in absent if given.get(name))
    if wrong:
        raise InputError(
            f"the weight of '{wrong[0]}' cannot be {given[wrong[0]]} here",
            f"Weigh {', '.join(WEIGHTS)} with 0 or more; a direction needs a base prompt.",
        )
    return {name: float(value) for name, value in {**WEIGHTS, **given}.items() if name not in absent}


def _pictures(views: Views) -> tuple[Tensor, Tensor]:
    if views.shaded is None or views.mask is None:
        raise InputError("views came without shade or mask", "Render the outputs that the guidance asks for.")
    return views.shaded, views.mask
