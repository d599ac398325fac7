"""`ClipModel`: pictures and words as vectors that can be compared (CLIP), the only door to open_clip.

An encoder is its architecture, its weights and its preprocessing together, under one name: `ARCHITECTURE/TAG` of
open_clip, or the path of a checkpoint with the `open_clip_config.json` that belongs to it. It is float32 and frozen; what
flows through it is differentiable down to the pixels. Pictures are in the renderer's layout: box-filtered over black,
row 0 on top, so a picture plus (1 - mask) times a background is the object before that background.

`ClipModel.patch_features` are the dense features of TextDeformer (Gao et al. 2023): the patch convolution's stride is a
fraction of the patch, the table of positions is interpolated to match, and the hidden state after the last block is
taken.
"""

import functools
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from types import ModuleType
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from fabcraft.errors import InputError, MissingError
from fabcraft.guidance.encoder_weights import (
    CHECKPOINTS,
    Weights,
    config_beside,
    find_checkpoint,
    require_cached,
    three,
)

DEFAULT = "ViT-B-32-quickgelu/openai"
"""The encoder of the paper: 512 numbers a picture, weights of OpenAI."""

KNOWN = {
    DEFAULT: "151 million parameters; the default",
    "ViT-B-32-256/datacomp_s34b_b86k": "151 million parameters; trained on more pictures, of 256 px",
    "ViT-B-16-quickgelu/openai": "150 million parameters; smaller patches, about twice as slow",
    "ViT-L-14-quickgelu/openai": "428 million parameters; for a graphics card",
}
"""Encoders to choose from, with what to know about them; any other ARCHITECTURE/TAG of open_clip may do as well."""

MOST_TOKENS = 1024
"""Of a dense picture: the cost of attention grows with the square."""

Images = Float[Tensor, "K H W"] | Float[Tensor, "K H W 3"]


@dataclass(frozen=True, eq=False)
class ClipModel:
    """A frozen encoder of pictures and words into the same D-dimensional space."""

    name: str
    """ARCHITECTURE/TAG, or the checkpoint's path."""
    network: Any
    """The `CLIP` or `CustomTextCLIP` of open_clip: float32, for use only, no weight asks for a gradient."""
    tokenizer: Any
    """The `SimpleTokenizer` of open_clip: a list of N prompts becomes (N, L) integers."""
    size: tuple[int, int]
    """Height and width of the pictures it reads, px."""
    mean: tuple[float, float, float]
    """Of its training pictures, by channel."""
    std: tuple[float, float, float]
    interpolation: str
    """"bicubic" or "bilinear", how pictures are brought to `size`."""
    device: torch.device

    @torch.no_grad()
    def encode_text(self, prompts: Sequence[str], unit: bool = True) -> Float[Tensor, "N D"]:
        """(N, D) vectors of N prompts, of length 1 or (`unit=False`) as the network gives them.

        Raises `InputError` for a prompt that is empty, or longer than the network reads.
        """
        longest = self.tokenizer.context_length - 2  # a start and an end are added
        for prompt in prompts:
            count = len(self.tokenizer.encode(prompt))
            if not 0 < count <= longest:
                raise InputError(
                    f"the prompt '{prompt[:60]}' has {count} pieces of words, expected 1 to {longest}",
                    "Describe the object in a few words.",
                )
        vectors = self.network.encode_text(self.tokenizer(list(prompts)).to(self.device))
        return functional.normalize(vectors, dim=-1) if unit else vectors

    def encode_images(
        self,
        images: Images,
        mask: Float[Tensor, "K H W"] | None = None,
        background: Float[Tensor, "K h w 3"] | None = None,
        unit: bool = True,
    ) -> Float[Tensor, "K D"]:
        """(K, D) vectors of K square pictures; differentiable to the pixels and the mask.

        images : 0..1, grey or of three channels, black where `mask` is 0.
        mask : share of every pixel that the object covers; None for pictures that are already full.
        background : (K, *size, 3), what stands behind; white when None.

        Raises `InputError` for pictures that are not square.
        """
        vectors = self.network.encode_image(self._prepared(images, mask, background))
        return functional.normalize(vectors, dim=-1) if unit else vectors

    def patch_features(
        self,
        images: Images,
        mask: Float[Tensor, "K H W"] | None = None,
        background: Float[Tensor, "K h w 3"] | None = None,
        stride: int | None = None,
    ) -> Float[Tensor, "K rows columns C"]:
        """Features of patches all over K pictures: the hidden state after the last block, without the class token.

        stride : px between patches; `dense_stride` when None. The other arguments as for `encode_images`.

        Raises `InputError` when the network is no vision transformer of open_clip.
        """
        tower, stride = self._transformer(), stride or self.dense_stride
        pixels = self._prepared(images, mask, background)
        grid = functional.conv2d(pixels, tower.conv1.weight, tower.conv1.bias, stride)
        rows, columns = grid.shape[2:]
        whole = tower.class_embedding.expand(len(grid), 1, -1)
        tokens = torch.cat([whole, grid.flatten(2).transpose(1, 2)], 1) + self._positions(rows, columns)
        hidden = tower.transformer(tower.ln_pre(tokens))
        return hidden[:, 1:].unflatten(1, (rows, columns))

    @property
    def patch(self) -> int:
        """Side of a patch, px.  Raises `InputError` when the network is no vision transformer of open_clip."""
        return int(self._transformer().patch_size[0])

    @property
    def dense_stride(self) -> int:
        """The smallest stride from a quarter of a patch on that covers the picture and keeps to `MOST_TOKENS`."""
        room = [side - self.patch for side in self.size]
        for stride in range(max(self.patch // 4, 1), self.patch):
            tokens = (room[0] // stride + 1) * (room[1] // stride + 1)
            if tokens <= MOST_TOKENS and not any(side % stride for side in room):
                return stride
        return self.patch

    def _prepared(self, images: Tensor, mask: Tensor | None, background: Tensor | None) -> Tensor:
        """(K, 3, *size) pictures as the network was trained on; compositing commutes with the linear resize."""
        height, width = images.shape[1:3]
        if height != width:
            raise InputError(f"pictures of {width} x {height} pixels were given", "Give square pictures.")
        colours = images.unsqueeze(1).expand(-1, 3, -1, -1) if images.ndim == 3 else images.movedim(-1, 1)
        pixels = self._resized(colours)
        if mask is not None:
            behind = 1.0 - self._resized(mask.unsqueeze(1))
            pixels = pixels + (
                behind if background is None else behind * background.to(pixels).movedim(-1, 1)
            )
        mean, std = (pixels.new_tensor(values)[:, None, None] for values in (self.mean, self.std))
        return (pixels - mean) / std

    def _resized(self, pictures: Tensor) -> Tensor:
        pictures = pictures.to(self.device, torch.float32)
        if tuple(pictures.shape[-2:]) == self.size:
            return pictures
        return functional.interpolate(pictures, self.size, mode=self.interpolation, antialias=True)

    def _transformer(self) -> Any:
        from open_clip.transformer import VisionTransformer

        tower = self.network.visual
        if not isinstance(tower, VisionTransformer):
            raise InputError(
                f"the encoder {self.name} sees with a {type(tower).__name__}, which has no patches to compare",
                f"Choose a vision transformer such as {DEFAULT}, or leave view consistency out.",
            )
        return tower

    def _positions(self, rows: int, columns: int) -> Tensor:
        """(1 + rows * columns, C) table of positions.  The outermost patches of both grids have the same centres."""
        tower = self._transformer()
        table = tower.positional_embedding
        grid = table[1:].T.reshape(1, -1, *tower.grid_size)
        dense = functional.interpolate(grid, (rows, columns), mode="bicubic", align_corners=True)
        return torch.cat([table[:1], dense[0].flatten(1).T])


def load_clip(name: str | Path = DEFAULT, device: str | torch.device = "cpu") -> ClipModel:
    """The encoder `name`, from this disk; never uses the network.

    name : ARCHITECTURE/TAG of open_clip, or a path: a checkpoint with `open_clip_config.json` beside it, or their folder.

    Raises `MissingError` when the weights of a named encoder are not here, and `InputError` for an unknown name, a
    checkpoint without its config, or weights that do not fit it.
    """
    library = open_clip()
    architecture, _, tag = str(name).rpartition("/")
    known: Mapping[str, Any] = library.pretrained.get_pretrained_cfg(architecture, tag)
    if known:
        path = require_cached(weights_of(str(name)))
        config = library.get_model_config(architecture)
        config["quick_gelu"] = bool(config.get("quick_gelu") or known.get("quick_gelu"))
        source, preprocessing = architecture, known
    elif Path(name).exists() or Path(name).suffix in CHECKPOINTS:
        path = find_checkpoint(Path(name))
        config, preprocessing = config_beside(path)
        source = f"local-dir:{path.parent}"
    else:
        raise _unknown(str(name))
    _require_supported(config, str(name))
    network = _network(config, path, str(name)).to(device)
    size = network.visual.image_size
    return ClipModel(
        name=str(name),
        network=network,
        tokenizer=library.get_tokenizer(source),
        size=(size, size) if isinstance(size, int) else (int(size[0]), int(size[1])),
        mean=three(preprocessing["mean"]),
        std=three(preprocessing["std"]),
        interpolation="bilinear" if preprocessing.get("interpolation") == "bilinear" else "bicubic",
        device=torch.device(device),
    )


def weights_of(name: str) -> Weights:
    """Where the weights of the encoder `name`, ARCHITECTURE/TAG of open_clip, are to be had.

    Raises `InputError` for a name that open_clip does not know, and for an encoder that cannot be used here.
    """
    library = open_clip()
    architecture, _, tag = name.rpartition("/")
    place = library.pretrained.get_pretrained_cfg(architecture, tag).get("hf_hub", "")
    if not place:
        raise _unknown(name)
    _require_supported(library.get_model_config(architecture), name)
    repository, _, file = place.rpartition("/")
    if not file:
        constants = library.constants
        return Weights(name, repository, (constants.HF_SAFE_WEIGHTS_NAME, constants.HF_WEIGHTS_NAME))
    return Weights(name, repository, tuple(dict.fromkeys((f"{Path(file).stem}.safetensors", file))))


def open_clip() -> ModuleType:
    """The open_clip package, imported where it is needed first: that takes seconds."""
    import_torchvision()
    import open_clip as library

    return library


@functools.cache
def import_torchvision() -> torch.library.Library | None:
    """Import torchvision, which open_clip and diffusers need, also where its compiled operators do not load.

    Torchvision 0.28 describes `nms` and `qnms` to torch without asking whether they exist; where its binary does not
    fit torch's (one is built for a graphics card, the other is not), that ends the import. Declaring the two lets it go
    on; nobody calls them here. The declarations live as long as the returned object, hence the cache.
    """
    try:
        import torchvision

        return None
    except RuntimeError as error:
        if "torchvision::" not in str(error):
            raise
    for module in [name for name in sys.modules if name.partition(".")[0] == "torchvision"]:
        del sys.modules[module]  # halves of the failed import
    declared = torch.library.Library("torchvision", "DEF")
    for operator in ("nms", "qnms"):
        declared.define(f"{operator}(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")
    import torchvision  # noqa: F401

    return declared


def _require_supported(config: Mapping[str, Any], name: str) -> None:
    """Refuse what would fetch something while it is built, and what reads words by a dictionary that is not here."""
    text, vision = config.get("text_cfg", {}), config.get("vision_cfg", {})
    remote = ":" in str(vision.get("timm_model_name") or "") or vision.get("timm_model_pretrained")
    words = text.get("hf_model_name") or text.get("hf_tokenizer_name")
    if words or remote or "multimodal_cfg" in config:
        raise InputError(
            f"the encoder {name} needs parts that its weights do not bring",
            "Choose one from `fabcraft weights list`.",
        )


def _network(config: dict[str, Any], path: Path, name: str) -> Any:
    """The frozen network with the weights of the file `path`; leaves torch's random numbers as they were."""
    library = open_clip()
    kind = library.CustomTextCLIP if config.pop("custom_text", False) else library.CLIP
    try:
        with torch.random.fork_rng(devices=[]):
            network = kind(**config)
        library.load_checkpoint(network, str(path), strict=True, weights_only=True)
    except ModuleNotFoundError:
        raise
    except MemoryError:
        raise MissingError(f"there is not enough memory for {name}", "Choose a smaller encoder.") from None
    except Exception as error:  # whatever a file that is not what it says may provoke
        words = " ".join(str(error).split())[:200]
        raise InputError(
            f"{path} does not hold weights that fit {name} ({type(error).__name__}: {words})",
            "Give the config that came with the checkpoint, and weights without code (.safetensors).",
        ) from None
    return network.float().eval().requires_grad_(False)


def _unknown(name: str) -> InputError:
    names = ["/".join(pair) for pair in open_clip().list_pretrained()]
    close = get_close_matches(name, names, 1) or [DEFAULT]
    return InputError(
        f"no encoder is called '{name}'",
        f"Did you mean {close[0]}? `fabcraft weights list` shows what there is.",
    )
