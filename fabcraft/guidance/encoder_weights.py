"""Where an encoder's weights lie on this machine, and how they come here.

Weights are files of a repository on the Hugging Face Hub, kept in that library's own cache. Its rules hold and none is
added: `HF_HOME`, `HF_HUB_CACHE`, `HF_HUB_OFFLINE` and `HF_TOKEN` are read when `huggingface_hub` is imported, which
happens inside the functions below. Only `fetch` uses the network; `cached` looks at the disk.

A checkpoint of one's own is a file with the `open_clip_config.json` that belongs to it in the same folder. Without that
file nobody knows what its pictures looked like to the network, so it is refused.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fabcraft.errors import InputError, MissingError

CONFIG = "open_clip_config.json"
CHECKPOINTS = (".safetensors", ".bin", ".pt", ".pth")


@dataclass(frozen=True)
class Weights:
    """Files that hold one encoder's weights, any of which is enough."""

    name: str
    """The encoder, as in `fabcraft weights list`."""
    repository: str
    """Owner and name on the Hub."""
    files: tuple[str, ...]
    """File names in the repository, the one to prefer first."""


def cache_folder() -> Path:
    """The folder where the Hub's library keeps what it has fetched; it need not exist."""
    from huggingface_hub import constants

    return Path(constants.HF_HUB_CACHE)


def cached(weights: Weights) -> Path | None:
    """The weights' file on this disk, or None.  Uses no network."""
    from huggingface_hub import try_to_load_from_cache

    found = (try_to_load_from_cache(weights.repository, file) for file in weights.files)
    return next((Path(path) for path in found if isinstance(path, str)), None)


def require_cached(weights: Weights) -> Path:
    """The weights' file on this disk.  Raises `MissingError` with the command that brings it."""
    path = cached(weights)
    if path is None:
        raise MissingError(
            f"the weights of {weights.name} are not on this machine (looked in {cache_folder()})",
            fetch_command(weights.name),
        )
    return path


def fetch_command(name: str) -> str:
    """The line that fetches the weights of the encoder `name`."""
    return f"fabcraft weights fetch {name}"


def fetch(weights: Weights) -> Path:
    """The weights' file on this disk, downloaded when it is not there yet.

    Raises `MissingError` when the Hub cannot be reached, does not hand them out or the disk is full, and `InputError`
    when the repository has no such file.
    """
    path = cached(weights)
    if path is not None:
        return path
    from huggingface_hub import constants, hf_hub_download
    from huggingface_hub.errors import (
        HfHubHTTPError,
        LocalEntryNotFoundError,
        OfflineModeIsEnabled,
        RemoteEntryNotFoundError,
    )

    again = fetch_command(weights.name)
    for file in weights.files:
        try:
            return Path(hf_hub_download(weights.repository, file))
        except RemoteEntryNotFoundError:
            continue
        except (LocalEntryNotFoundError, OfflineModeIsEnabled):
            if constants.HF_HUB_OFFLINE:
                why, again = "HF_HUB_OFFLINE is set", f"HF_HUB_OFFLINE=0 {again}"
            else:
                why = "the Hugging Face Hub cannot be reached"
        except HfHubHTTPError as error:
            why = f"the Hugging Face Hub answered {error.response.status_code} for {weights.repository}"
        except OSError as error:
            why = error.strerror or str(error) or type(error).__name__
        raise MissingError(f"the weights of {weights.name} were not fetched: {why}", again)
    raise InputError(
        f"the repository {weights.repository} has none of {', '.join(weights.files)}",
        "Choose another encoder: fabcraft weights list",
    )


def find_checkpoint(path: Path) -> Path:
    """The checkpoint at `path`, or the only one in the folder `path`, where .safetensors goes before other kinds.

    Raises `InputError` when there is none, or more than one.
    """
    if path.is_file():
        return path
    if not path.is_dir():
        raise InputError(f"the checkpoint {path} does not exist", "Correct the path.")
    found = sorted(one for one in path.glob("*") if one.suffix in CHECKPOINTS)
    safe = [one for one in found if one.suffix == ".safetensors"]
    if len(safe or found) != 1:
        raise InputError(
            f"{path} holds {len(safe or found)} checkpoints, expected one",
            f"Give the path of a checkpoint ({', '.join(CHECKPOINTS)}).",
        )
    return (safe or found)[0]


def config_beside(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The architecture and the preprocessing that belong to a checkpoint.

    Raises `InputError` when the config is not there or not usable.
    """
    file = path.parent / CONFIG
    advice = f"Put the {CONFIG} that came with the checkpoint beside it."
    if not file.is_file():
        raise InputError(f"{path} has no {CONFIG} beside it, so its preprocessing is unknown", advice)
    try:
        told = json.loads(file.read_text(encoding="utf-8"))
        config, preprocessing = dict(told["model_cfg"]), dict(told["preprocess_cfg"])
        dict(config["text_cfg"]), dict(config["vision_cfg"])
        three(preprocessing["mean"]), three(preprocessing["std"])
    except (ValueError, KeyError, TypeError, OSError) as error:
        raise InputError(
            f"{file} is no config of an encoder ({type(error).__name__}: {error})", advice
        ) from None
    return config, preprocessing


def three(values: Sequence[float]) -> tuple[float, float, float]:
    """Exactly three numbers, one for each channel."""
    red, green, blue = (float(value) for value in values)
    return red, green, blue
