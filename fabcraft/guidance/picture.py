"""`PictureGuidance`: the object should look like a guidance mesh, view by view, or like one picture.

    embedding   1 - mean cos(E(I), E(J)), J the guidance mesh from the same camera (the paper's image loss), or the picture,
    image       mean |I - J| over pixels, of shade, mask and normals alike (the paper's 2D loss); needs no encoder.

What the guidance mesh looks like from the fixed bank is computed once (`targets_of`). A single picture (`reference`) is a
target for the views within some angle of where it was taken; other views count with 0. Means over views.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from torch import Tensor

from fabcraft.errors import InputError
from fabcraft.guidance.clip import ClipModel
from fabcraft.guidance.embedding import cosine_loss
from fabcraft.guidance.guidance import Views

WEIGHTS = {"embedding": 1.0, "image": 5.0}
IMAGES = ("shaded", "mask", "normal")


@dataclass(frozen=True, eq=False)
class Targets:
    """What a guidance mesh looks like from every camera of a fixed bank."""

    cameras: Int[np.ndarray, " N"]
    """Index in the bank."""
    embeddings: Float[Tensor, "N D"] | None
    """Unit vectors; None without an encoder."""
    images: Mapping[str, Float[Tensor, "N ..."]]
    """Pictures by output, as rendered."""

    def rows(self, cameras: Int[np.ndarray, " K"]) -> Int[Tensor, " K"]:
        """Where the targets of `cameras` stand.  Raises `InputError` for a camera without a target."""
        place = {int(camera): row for row, camera in enumerate(self.cameras)}
        absent = sorted({int(camera) for camera in cameras} - place.keys())
        if absent:
            raise InputError(
                f"the guidance mesh was not seen from camera {absent[0]}",
                "Make its targets from every camera of the bank.",
            )
        return torch.tensor([place[int(camera)] for camera in cameras])


@dataclass(frozen=True, eq=False)
class Reference:
    """One picture of how the object should look from about one side."""

    embedding: Float[Tensor, "1 D"]
    azimuth_deg: float
    elevation_deg: float
    within_deg: float
    """Views up to this far from the picture's own have it for a target."""

    def near(self, views: Views) -> Int[Tensor, " N"]:
        """The views of a chunk whose direction is within the angle."""
        azimuth = np.radians(views.azimuth_deg - self.azimuth_deg)
        own, other = np.radians(self.elevation_deg), np.radians(views.elevation_deg)
        cosine = np.sin(own) * np.sin(other) + np.cos(own) * np.cos(other) * np.cos(azimuth)
        angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
        return torch.from_numpy(np.flatnonzero(angle <= self.within_deg))


@torch.no_grad()
def targets_of(
    chunks: Iterable[Views], model: ClipModel | None = None, images: Sequence[str] = IMAGES
) -> Targets:
    """The targets that views of a guidance mesh set, from every camera of the bank, in chunks.

    model : encoder of the vectors; None for none.
    images : which pictures to keep for comparison: some of "shaded", "mask" and "normal".

    Raises `InputError` for views that lack what is needed, and when there are none.
    """
    cameras: list[np.ndarray] = []
    vectors: list[Tensor] = []
    kept: dict[str, list[Tensor]] = {name: [] for name in images}
    for views in chunks:
        cameras.append(views.camera)
        for name in images:
            kept[name].append(_picture(views, name).detach())
        if model is not None:
            vectors.append(model.encode_images(_picture(views, "shaded"), _picture(views, "mask")))
    if not cameras:
        raise InputError("the guidance mesh was seen from no camera", "Give at least one chunk of views.")
    return Targets(
        np.concatenate(cameras),
        torch.cat(vectors) if vectors else None,
        {name: torch.cat(pictures) for name, pictures in kept.items()},
    )


@torch.no_grad()
def reference(
    model: ClipModel,
    picture: UInt8[np.ndarray, "H W 4"],
    azimuth_deg: float = 0.0,
    elevation_deg: float = 0.0,
    within_deg: float = 45.0,
) -> Reference:
    """The target that one RGBA picture sets; it is laid in the middle of a white square, nothing is cut off."""
    if not 0.0 < within_deg <= 180.0:
        raise InputError(f"a picture for views within {within_deg} degrees was given", "Choose 0 to 180.")
    side = max(picture.shape[:2])
    square = np.zeros((side, side, 4), np.float32)
    top, left = ((side - length) // 2 for length in picture.shape[:2])
    square[top : top + picture.shape[0], left : left + picture.shape[1]] = picture / np.float32(255.0)
    mask = torch.from_numpy(square[None, ..., 3])
    colours = torch.from_numpy(square[None, ..., :3]) * mask[..., None]
    return Reference(model.encode_images(colours, mask), azimuth_deg, elevation_deg, within_deg)


class PictureGuidance:
    """A guidance mesh's views, or one picture, as an objective."""

    def __init__(
        self,
        target: Targets | Reference,
        model: ClipModel | None = None,
        *,
        weights: Mapping[str, float] | None = None,
    ) -> None:
        """`model`: the encoder that `target` was made with; None compares pixels only.

        weights : of "embedding" and "image"; `WEIGHTS` where not given. A loss of weight 0 is not computed.

        Raises `InputError` when a weight is unknown or negative, or nothing is left to compare.
        """
        there = set()
        if model is not None and (isinstance(target, Reference) or target.embeddings is not None):
            there.add("embedding")
        if isinstance(target, Targets) and target.images:
            there.add("image")
        wrong = sorted(
            name for name, value in (weights or {}).items() if name not in WEIGHTS or not value >= 0
        )
        if wrong:
            raise InputError(f"the weight of '{wrong[0]}' cannot be used", f"Weigh {' and '.join(WEIGHTS)}.")
        chosen = {**WEIGHTS, **(weights or {})}
        self.weights = {name: float(value) for name, value in chosen.items() if name in there and value}
        if not self.weights:
            raise InputError(
                "there is nothing to compare views with", "Give an encoder, or pictures to match."
            )
        self._target, self._model = target, model
        encoded = ("shaded", "mask") if "embedding" in self.weights else ()
        compared = tuple(target.images) if isinstance(target, Targets) and "image" in self.weights else ()
        self.outputs = tuple(dict.fromkeys((*encoded, *compared)))

    def describe(self) -> str:
        """One line for the report."""
        if isinstance(self._target, Targets):
            what = f"a guidance mesh from {len(self._target.cameras)} sides"
        else:
            what = f"one picture, for views within {self._target.within_deg:g} degrees"
        by = [f"as {self._model.name} sees it"] if self._model and "embedding" in self.weights else []
        by += ["pixel by pixel"] if "image" in self.weights else []
        return f"{what}, {' and '.join(by)}"

    def losses(self, views: Views) -> Mapping[str, Float[Tensor, ""]]:
        """0-d tensors of "embedding" and "image", those with a weight.

        Raises `InputError` for a camera without a target, and for pictures of another size than the targets'.
        """
        found: dict[str, Tensor] = {}
        if "embedding" in self.weights:
            found["embedding"] = self._embedding(views)
        if "image" in self.weights and isinstance(self._target, Targets):
            found["image"] = _image_loss(views, self._target)
        return {name: value.to(views.positions) for name, value in found.items()}

    def _embedding(self, views: Views) -> Tensor:
        shaded, mask, target = _picture(views, "shaded"), _picture(views, "mask"), self._target
        assert self._model is not None
        if isinstance(target, Targets):
            assert target.embeddings is not None
            return cosine_loss(
                self._model.encode_images(shaded, mask), target.embeddings[target.rows(views.camera)]
            )
        near = target.near(views).to(shaded.device)
        if not len(near):
            return shaded.sum() * 0.0
        vectors = self._model.encode_images(shaded[near], mask[near])
        return cosine_loss(vectors, target.embedding) * (len(near) / len(shaded))


def _image_loss(views: Views, targets: Targets) -> Tensor:
    """Mean absolute difference over pixels and channels, averaged over the kinds of picture."""
    rows = targets.rows(views.camera)
    found = []
    for name, kept in targets.images.items():
        picture = _picture(views, name)
        wanted = kept[rows.to(kept.device)].to(picture)
        if wanted.shape != picture.shape:
            raise InputError(
                f"views of {picture.shape[2]} x {picture.shape[1]} pixels, targets of {wanted.shape[2]} x {wanted.shape[1]}",
                "Render both with the same bank of cameras.",
            )
        found.append((picture - wanted).abs().mean())
    return torch.stack(found).mean()


def _picture(views: Views, name: str) -> Tensor:
    picture = getattr(views, name, None)
    if picture is None:
        raise InputError(f"views came without '{name}'", "Render the outputs that the guidance asks for.")
    return picture
