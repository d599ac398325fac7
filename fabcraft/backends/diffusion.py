"""`diffusers[:MODEL[#CONTROLNET]]`: Stable Diffusion on this machine makes a picture of words; a ControlNet, over a sketch.

The models are files in the cache of the Hugging Face Hub, or a folder; nothing is downloaded here, so a run never begins
with gigabytes that nobody asked for.
"""

import importlib.util
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from fabcraft.backends.backend import Answer, Request, Said, Terms
from fabcraft.errors import InputError, MissingError

MODEL = "stable-diffusion-v1-5/stable-diffusion-v1-5"
CONTROLNET = "lllyasviel/control_v11p_sd15_scribble"
"""Drawn white on black; one for line art takes the same."""
STEPS, SIDE, SCALE = 25, 512, 7.5


class Diffusion:
    """A model of the diffusers library."""

    about: ClassVar[str] = "Stable Diffusion on this machine; with a sketch, through a ControlNet"
    usage: ClassVar[str] = "diffusers[:MODEL[#CONTROLNET]]"

    def __init__(self, argument: str) -> None:
        model, _, controlnet = argument.partition("#")
        self._model, self._controlnet = model or MODEL, controlnet or CONTROLNET

    @classmethod
    def lacks(cls) -> MissingError | None:
        """The extra."""
        missing = [name for name in ("diffusers", "transformers") if importlib.util.find_spec(name) is None]
        return (
            MissingError(
                f"the Python package {missing[0]} is not installed", 'Run: pip install "fabcraft[diffusers]"'
            )
            if missing
            else None
        )

    def terms(self, request: Request) -> Terms:
        """The licence."""
        model = f"{self._model} and {self._controlnet}" if request.picture else self._model
        return Terms(
            (
                f"{model}: its licence says what its pictures may be used for (Stable Diffusion: CreativeML OpenRAIL-M)",
            )
        )

    def key(self) -> Mapping[str, str]:
        """The models and how they are run."""
        return {"model": self._model, "controlnet": self._controlnet, "steps": str(STEPS), "side": str(SIDE)}

    def make(self, request: Request, said: Said) -> Answer:
        """The picture, PNG."""
        import torch

        from fabcraft.guidance.clip import import_torchvision

        try:
            import_torchvision()
            from diffusers import AutoPipelineForText2Image, ControlNetModel
            from diffusers.utils import logging
        except (ImportError, RuntimeError) as error:  # packages that do not fit each other
            why = " ".join(str(error).split())[-200:]
            raise MissingError(
                f"diffusers cannot be loaded: ...{why}", 'Run: pip install --upgrade "fabcraft[diffusers]"'
            ) from error

        logging.disable_progress_bar()
        logging.set_verbosity_error()
        device = "cuda" if torch.cuda.is_available() else "cpu"
        named: dict[str, Any] = {"dtype": torch.float16 if device == "cuda" else torch.float32}
        drawn: dict[str, Any] = {}
        if request.picture:
            named["controlnet"] = _loaded(ControlNetModel, self._controlnet, named)
            drawn["image"] = scribble(request.picture)
        pipeline = _loaded(AutoPipelineForText2Image, self._model, named).to(device)
        pipeline.set_progress_bar_config(disable=True)

        def step(_: Any, done: int, __: Any, kept: dict[str, Any]) -> dict[str, Any]:
            said(min(done + 1, STEPS), STEPS)  # some schedulers take one more
            return kept

        made = pipeline(
            prompt=request.prompt,
            num_inference_steps=STEPS,
            guidance_scale=SCALE,
            height=SIDE,
            width=SIDE,
            generator=torch.Generator("cpu").manual_seed(request.seed),
            callback_on_step_end=step,
            **drawn,
        )
        if any(getattr(made, "nsfw_content_detected", None) or ()):
            raise InputError(
                "the model's own filter held the picture back",
                "Say it in other words, or give another --seed.",
            )
        out = io.BytesIO()
        made.images[0].convert("RGB").save(out, "PNG")
        return Answer(out.getvalue(), "picture.png")


def scribble(picture: bytes) -> Any:
    """The sketch as a ControlNet for scribbles or line art wants it: white lines on black, a centred square."""
    from PIL import Image, ImageOps

    grey = Image.open(io.BytesIO(picture)).convert("L")
    square = ImageOps.pad(ImageOps.autocontrast(grey), (SIDE, SIDE), color=255)
    return ImageOps.invert(square).convert("RGB")


def _loaded(kind: Any, name: str, named: Mapping[str, Any]) -> Any:
    """A model from the disk.  Raises `MissingError` with the command that brings it."""
    try:
        return kind.from_pretrained(name, local_files_only=True, **named)
    except (OSError, ValueError, KeyError, RuntimeError, ImportError) as error:
        why = " ".join(str(error).split())[:200]
        if Path(name).is_dir():
            raise InputError(
                f"the folder {name} holds no model that can be loaded: {why}",
                "Give one that diffusers saved.",
            ) from None
        raise MissingError(
            f"the model {name} is not on this machine ({why})", f"Run: hf download {name}"
        ) from None
