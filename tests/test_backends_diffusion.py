"""Stable Diffusion on this machine: pipelines with random weights, made on the spot; nothing is downloaded."""

import io
import json
import os
from pathlib import Path

import numpy as np
import pytest
from backed import png
from PIL import Image

from fabcraft.backends import diffusion
from fabcraft.backends.answer import checked_picture
from fabcraft.backends.backend import Request
from fabcraft.backends.diffusion import Diffusion, scribble
from fabcraft.errors import InputError, MissingError


def test_a_sketch_is_given_as_white_lines_on_black():
    seen = np.asarray(scribble(png(96)))
    assert seen.shape == (diffusion.SIDE, diffusion.SIDE, 3)
    assert seen[0, 0].max() == 0 and seen.max() == 255
    wide = Image.new("RGB", (200, 50), "white")
    wide.putpixel((100, 25), (0, 0, 0))
    out = io.BytesIO()
    wide.save(out, "PNG")
    assert np.asarray(scribble(out.getvalue()))[:100].max() == 0, "what is beside a narrow picture is empty"


def test_a_missing_extra_is_exit_3_with_the_line_to_type(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    lacking = Diffusion.lacks()
    assert lacking is not None and lacking.exit_code == 3 and "pip install" in lacking.next_step


def test_the_licence_is_told():
    assert "OpenRAIL" in Diffusion("").terms(Request()).said[0]
    assert "me/net" in Diffusion("me/sd#me/net").terms(Request(picture=b"x")).said[0]


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a tiny Stable Diffusion and a tiny ControlNet of random weights."""
    pytest.importorskip("diffusers", reason="the extra diffusers is not installed")
    transformers = pytest.importorskip("transformers", reason="the extra diffusers is not installed")
    import torch

    from fabcraft.guidance.clip import import_torchvision

    import_torchvision()
    from diffusers import (
        AutoencoderKL,
        ControlNetModel,
        PNDMScheduler,
        StableDiffusionPipeline,
        UNet2DConditionModel,
    )

    torch.manual_seed(0)
    folder = tmp_path_factory.mktemp("models")
    letters = [*"abcdefghijklmnopqrstuvwxyz,", *(f"{c}</w>" for c in "abcdefghijklmnopqrstuvwxyz,")]
    vocabulary = {text: at for at, text in enumerate([*letters, "<|startoftext|>", "<|endoftext|>"])}
    (folder / "vocab.json").write_text(json.dumps(vocabulary))
    (folder / "merges.txt").write_text("#version: 0.2\n")
    tokenizer = transformers.CLIPTokenizer(
        str(folder / "vocab.json"), str(folder / "merges.txt"), model_max_length=77
    )
    text = transformers.CLIPTextModel(
        transformers.CLIPTextConfig(
            vocab_size=len(vocabulary),
            hidden_size=32,
            intermediate_size=37,
            num_hidden_layers=2,
            num_attention_heads=4,
            bos_token_id=len(vocabulary) - 2,
            eos_token_id=len(vocabulary) - 1,
            pad_token_id=len(vocabulary) - 1,
        )
    )
    blocks = {
        "block_out_channels": (4, 8),
        "layers_per_block": 1,
        "norm_num_groups": 2,
        "cross_attention_dim": 32,
    }
    unet = UNet2DConditionModel(
        sample_size=8,
        in_channels=4,
        out_channels=4,
        down_block_types=("DownBlock2D", "CrossAttnDownBlock2D"),
        up_block_types=("CrossAttnUpBlock2D", "UpBlock2D"),
        **blocks,
    )
    vae = AutoencoderKL(
        block_out_channels=(4, 4, 4, 8),
        norm_num_groups=2,
        down_block_types=("DownEncoderBlock2D",) * 4,
        up_block_types=("UpDecoderBlock2D",) * 4,
        latent_channels=4,
    )
    StableDiffusionPipeline(
        vae,
        text,
        tokenizer,
        unet,
        PNDMScheduler(skip_prk_steps=True),
        None,
        None,
        requires_safety_checker=False,
    ).save_pretrained(folder / "sd")
    ControlNetModel(
        down_block_types=("DownBlock2D", "CrossAttnDownBlock2D"),
        conditioning_embedding_out_channels=(2, 4, 4, 8),
        **blocks,
    ).save_pretrained(folder / "net")
    return folder


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few steps and small pictures, and no network at all."""
    import socket

    def refused(*arguments, **named):
        raise AssertionError("the network was used")

    monkeypatch.setattr(diffusion, "STEPS", 2)
    monkeypatch.setattr(diffusion, "SIDE", 64)
    monkeypatch.setattr(socket.socket, "connect", refused)
    monkeypatch.setattr(socket, "getaddrinfo", refused)


def drawn(models: Path, **asked) -> np.ndarray:
    steps: list[tuple[int, int]] = []
    backend = Diffusion(f"{models / 'sd'}#{models / 'net'}")
    answer = backend.make(Request(prompt="a cat", **asked), lambda done, of: steps.append((done, of)))
    assert checked_picture(answer, "diffusers") == "png"
    assert steps[-1] == (2, 2)
    with Image.open(io.BytesIO(answer.data)) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def test_words_become_a_picture_the_same_for_the_same_seed(models, quick):
    first = drawn(models)
    assert first.shape == (64, 64, 3) and np.ptp(first) > 0
    assert np.array_equal(first, drawn(models))
    assert not np.array_equal(first, drawn(models, seed=1))


def test_a_sketch_goes_through_the_controlnet(models, quick):
    assert drawn(models, picture=png()).shape == (64, 64, 3)


def test_a_model_that_is_not_here_is_exit_3_with_the_line_to_type(models, quick, tmp_path, monkeypatch):
    monkeypatch.setitem(os.environ, "HF_HUB_OFFLINE", "1")
    for asked, picture in (("nobody/no-such-model", b""), (f"{models / 'sd'}#nobody/no-such-net", png())):
        with pytest.raises(MissingError) as caught:
            Diffusion(asked).make(Request(picture, "a cat"), lambda done, of: None)
        assert caught.value.next_step.startswith("Run: hf download nobody/no-such")
    with pytest.raises(InputError, match="no model"):
        Diffusion(str(tmp_path)).make(Request(b"", "a cat"), lambda done, of: None)
