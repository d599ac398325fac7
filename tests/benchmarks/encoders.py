"""CLIP's ViT-B/32 at its full size, with random weights: what an encoder costs does not depend on what it has learnt."""

import pytest
import torch

from fabcraft.guidance.clip import ClipModel, open_clip


def full_size(device: str) -> ClipModel:
    """The encoder, frozen, on a device; skips the benchmark where open_clip does not load."""
    try:
        library = open_clip()
    except ImportError as error:
        pytest.skip(f"open_clip does not load: {error}")
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        network = library.create_model("ViT-B-32", pretrained=None, precision="fp32")
    return ClipModel(
        name="ViT-B-32, random",
        network=network.float().eval().requires_grad_(False).to(device),
        tokenizer=library.get_tokenizer("ViT-B-32"),
        size=(224, 224),
        mean=(0.481, 0.458, 0.408),
        std=(0.269, 0.261, 0.276),
        interpolation="bicubic",
        device=torch.device(device),
    )
