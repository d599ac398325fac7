"""The encoder: from a file or the cache and never from the network, frozen, differentiable to the pixels."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import tiny_clip
import torch
from torch.nn import functional

from fabcraft.errors import InputError
from fabcraft.guidance import clip
from fabcraft.guidance.background import jittered
from fabcraft.guidance.clip import DEFAULT, KNOWN, ClipModel, load_clip, open_clip, weights_of


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_clip.save(tmp_path_factory.mktemp("tiny"))


@pytest.fixture(scope="module")
def model(checkpoint: Path) -> ClipModel:
    return load_clip(checkpoint)


def pictures(count: int, side: int = 40, seed: int = 0) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(seed).uniform(0, 1, (count, side, side)).astype(np.float32))


def test_a_checkpoint_with_its_config_is_the_network_that_was_saved(checkpoint, model):
    network = open_clip().CLIP(**tiny_clip.CONFIG).eval()
    network.load_state_dict(tiny_clip.state())
    pixels = pictures(2, 32).unsqueeze(1).expand(-1, 3, -1, -1)
    mean, std = (torch.tensor(tiny_clip.PREPROCESSING[key])[:, None, None] for key in ("mean", "std"))
    expected = network.encode_image((pixels - mean) / std)
    assert torch.allclose(model.encode_images(pictures(2, 32), unit=False), expected, atol=1e-5)
    assert (model.size, model.interpolation) == ((32, 32), "bicubic")


@pytest.mark.parametrize("name", ["tiny.safetensors", "tiny.pt"])
def test_a_checkpoint_is_found_by_its_folder_too(name, tmp_path, model):
    path = tiny_clip.save(tmp_path, name=name)
    assert torch.equal(load_clip(path.parent).encode_text(["a cat"]), model.encode_text(["a cat"]))


def test_the_encoder_is_float32_and_frozen_and_its_weights_get_no_gradient(model):
    images = pictures(1).requires_grad_()
    model.encode_images(images).sum().backward()
    assert images.grad is not None and images.grad.abs().sum() > 0
    for weight in model.network.parameters():
        assert weight.dtype == torch.float32 and not weight.requires_grad and weight.grad is None
    assert not model.network.training


def test_loading_leaves_the_random_numbers_of_torch_alone(checkpoint):
    torch.manual_seed(3)
    before = torch.random.get_rng_state()
    load_clip(checkpoint)
    assert torch.equal(torch.random.get_rng_state(), before)


def test_vectors_have_length_one_unless_asked_otherwise(model):
    for vectors in (model.encode_text(["a cat", "a dog mask"]), model.encode_images(pictures(3))):
        assert torch.allclose(vectors.norm(dim=-1), torch.ones(len(vectors)))
    raw = model.encode_images(pictures(3), unit=False)
    assert not torch.allclose(raw.norm(dim=-1), torch.ones(3), atol=0.01)
    assert torch.allclose(functional.normalize(raw, dim=-1), model.encode_images(pictures(3)))


def test_the_gradient_of_the_pixels_and_of_the_mask_agrees_with_differences(model):
    images, mask = pictures(1).requires_grad_(), pictures(1, seed=1).requires_grad_()
    toward = model.encode_text(["a cat"])

    def score(images, mask):
        return (model.encode_images(images, mask).double() @ toward.double().T).sum()

    score(images, mask).backward()
    for given, other in ((images, 0), (mask, 1)):
        way = torch.sign(given.grad)
        moved = [
            [
                value + sign * 2e-3 * way if place == other else value
                for place, value in enumerate((images, mask))
            ]
            for sign in (1, -1)
        ]
        with torch.no_grad():
            slope = (score(*moved[0]) - score(*moved[1])) / 4e-3
        assert slope == pytest.approx(float((given.grad * way).sum()), rel=0.02)


def test_a_picture_is_seen_before_its_background(model):
    images, mask = torch.zeros(1, 32, 32), torch.zeros(1, 32, 32)
    behind = jittered([5], model.size)
    assert torch.allclose(model.encode_images(images, mask, behind), model.encode_images(behind), atol=1e-6)
    white = model.encode_images(torch.ones(1, 32, 32))
    assert torch.allclose(model.encode_images(images, mask), white, atol=1e-6)


def test_a_larger_picture_is_resized_without_aliasing(model):
    fine = (torch.arange(320) % 2).float().expand(1, 320, 320).contiguous()
    grey = torch.full((1, 320, 320), 0.5)
    assert torch.allclose(model.encode_images(fine), model.encode_images(grey), atol=0.02)


def test_patches_at_the_stride_of_the_patch_are_the_networks_own(model):
    images = pictures(2, 32)
    own = model.network.visual.forward_intermediates(
        model._prepared(images, None, None), indices=1, output_fmt="NLC", intermediates_only=True
    )["image_intermediates"][0]
    assert torch.allclose(model.patch_features(images, stride=8).flatten(1, 2), own, atol=1e-6)


def test_dense_patches_are_a_quarter_apart_and_cover_the_picture(model):
    assert (model.patch, model.dense_stride) == (8, 2)
    assert model.patch_features(pictures(2)).shape == (2, 13, 13, 32)


def test_positions_of_dense_patches_agree_with_the_table_where_patches_coincide(model):
    table = model.network.visual.positional_embedding
    dense = model._positions(13, 13)
    assert torch.equal(dense[0], table[0])
    coinciding = dense[1:].reshape(13, 13, -1)[::4, ::4].flatten(0, 1)
    assert torch.allclose(coinciding, table[1:], atol=1e-6)


def test_the_strides_of_common_encoders_keep_within_the_tokens(model):
    strides = {}
    for size, patch in ((224, 32), (256, 32), (224, 16), (224, 14)):
        config = {**tiny_clip.CONFIG["vision_cfg"], "image_size": size, "patch_size": patch}
        network = open_clip().CLIP(**{**tiny_clip.CONFIG, "vision_cfg": config})
        other = ClipModel("", network, None, (size, size), *[(0.5,) * 3] * 2, "bicubic", torch.device("cpu"))
        strides[size, patch] = other.dense_stride
    assert strides == {(224, 32): 8, (256, 32): 8, (224, 16): 8, (224, 14): 7}


def test_an_encoder_without_patches_compares_pictures_but_has_no_dense_features(tmp_path):
    vision = {"image_size": 64, "layers": [1, 1, 1, 1], "width": 16, "head_width": 16}
    path = tiny_clip.save(tmp_path, {**tiny_clip.CONFIG, "vision_cfg": vision})
    model = load_clip(path)
    assert model.encode_images(pictures(2)).shape == (2, 16)
    with pytest.raises(InputError, match="ModifiedResNet"):
        model.patch_features(pictures(2))


def test_backgrounds_belong_to_their_camera_and_seed():
    some = jittered([3, 4, 5, 6, 7, 8], (32, 32))
    assert torch.equal(some[1:2], jittered([4], (32, 32)))
    assert not torch.equal(some[0], some[1]) and not torch.equal(some[:1], jittered([3], (32, 32), seed=1))
    assert some.min() >= 0 and some.max() <= 1


def test_pictures_that_are_not_square_and_unusable_prompts_are_refused(model):
    with pytest.raises(InputError, match="square"):
        model.encode_images(torch.zeros(1, 20, 30))
    for prompt in ("", "word " * 40):
        with pytest.raises(InputError, match="pieces of words"):
            model.encode_text(["a cat", prompt])


def test_a_checkpoint_without_its_config_is_refused(tmp_path):
    path = tiny_clip.save(tmp_path)
    (tmp_path / "open_clip_config.json").unlink()
    with pytest.raises(InputError, match="has no open_clip_config"):
        load_clip(path)


@pytest.mark.parametrize(
    "told", ["[]", "{}", '{"model_cfg": {}, "preprocess_cfg": {}}', "not json", '{"model_cfg": 3}']
)
def test_a_config_that_is_none_is_refused(told, tmp_path):
    path = tiny_clip.save(tmp_path)
    (tmp_path / "open_clip_config.json").write_text(told)
    with pytest.raises(InputError, match="no config"):
        load_clip(path)


def test_weights_of_another_shape_or_with_code_in_them_are_refused(tmp_path):
    path = tiny_clip.save(tmp_path)
    other = {**tiny_clip.CONFIG, "embed_dim": 8}
    told = {"model_cfg": other, "preprocess_cfg": tiny_clip.PREPROCESSING}
    (tmp_path / "open_clip_config.json").write_text(json.dumps(told))
    with pytest.raises(InputError, match="does not hold"):
        load_clip(path)
    torch.save({"weights": Path("a")}, tmp_path / "evil.pt")
    with pytest.raises(InputError, match="does not hold"):
        load_clip(tmp_path / "evil.pt")


@pytest.mark.parametrize(
    "change",
    [
        {"text_cfg": {**tiny_clip.CONFIG["text_cfg"], "hf_tokenizer_name": "some/tokenizer"}},
        {"vision_cfg": {**tiny_clip.CONFIG["vision_cfg"], "timm_model_name": "hf_hub:some/model"}},
        {"multimodal_cfg": {}},
    ],
)
def test_an_encoder_that_would_fetch_more_is_refused(change, tmp_path):
    path = tiny_clip.save(tmp_path)
    told = {"model_cfg": {**tiny_clip.CONFIG, **change}, "preprocess_cfg": tiny_clip.PREPROCESSING}
    (tmp_path / "open_clip_config.json").write_text(json.dumps(told))
    with pytest.raises(InputError, match="weights list"):
        load_clip(path)


def test_an_unknown_name_is_answered_with_a_close_one():
    with pytest.raises(InputError, match="ViT-B-32-quickgelu/openai"):
        load_clip("ViT-B-32-quickgelu/opnai")
    with pytest.raises(InputError, match="does not exist"):
        load_clip("/nowhere/tiny.safetensors")


def test_every_known_encoder_has_a_place_to_come_from():
    assert DEFAULT in KNOWN
    for name in KNOWN:
        wanted = weights_of(name)
        assert wanted.repository.count("/") == 1 and wanted.files[0].endswith(".safetensors")


NO_NETWORK = """
import socket
def refused(*arguments, **named):
    raise AssertionError("the network was used")
socket.socket.connect = socket.socket.connect_ex = socket.create_connection = socket.getaddrinfo = refused
from fabcraft.guidance import clip
"""

FROM_CACHE = """
import sys
from fabcraft.errors import MissingError
try:
    clip.load_clip()
except MissingError as error:
    print(error.exit_code, error.next_step)
library = clip.open_clip()
library.add_model_config(sys.argv[1])
library.pretrained._PRETRAINED["tiny-test"] = {"random": library.pretrained._pcfg(hf_hub="someone/tiny/")}
model = clip.load_clip("tiny-test/random")
print([round(value, 5) for value in model.encode_text(["a cat"])[0].tolist()], model.mean[0])
"""


def test_weights_come_from_the_cache_or_not_at_all_and_never_from_the_network(tmp_path, model):
    folder = tmp_path / "hub" / "models--someone--tiny"
    tiny_clip.save(folder / "snapshots" / ("0" * 40), name="open_clip_model.safetensors")
    (folder / "refs").mkdir()
    (folder / "refs" / "main").write_text("0" * 40)
    config = tmp_path / "tiny-test.json"
    config.write_text(json.dumps(tiny_clip.CONFIG))
    environment = {name: value for name, value in os.environ.items() if not name.startswith("HF_")}
    environment |= {"HF_HOME": str(tmp_path), "HF_HUB_OFFLINE": "0"}  # the hub itself would go there
    command = [sys.executable, "-c", NO_NETWORK + FROM_CACHE, str(config)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, env=environment)
    assert done.returncode == 0, done.stderr
    expected = [round(value, 5) for value in model.encode_text(["a cat"])[0].tolist()]
    assert done.stdout.splitlines() == [f"3 fabcraft weights fetch {DEFAULT}", f"{expected} {0.48145466}"]


def test_importing_the_module_imports_neither_open_clip_nor_the_hub():
    program = "import sys, fabcraft.guidance.clip, fabcraft.guidance.text\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert not {"open_clip", "torchvision", "huggingface_hub"} & set(done.stdout.split())


def test_the_operators_of_torchvision_are_declared_once_and_only_when_they_are_missing():
    open_clip()
    open_clip()
    assert clip.import_torchvision.cache_info().misses == 1
    declared = clip.import_torchvision()
    import torchvision

    assert (declared is None) == torchvision.extension._has_ops()
    assert str(torch.ops.torchvision.nms.default._schema).startswith(
        "torchvision::nms(Tensor dets, Tensor scores"
    )
