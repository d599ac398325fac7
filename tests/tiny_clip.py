"""A small random CLIP, made on the spot: a vision transformer of 32 px pictures and a text tower, with its config.

And what such an encoder is shown: views of a mesh, as a fit would hand them to a guidance.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from scipy.spatial import ConvexHull

from fabcraft.fit.camera import orbit, stack
from fabcraft.fit.render import OUTPUTS, render
from fabcraft.guidance.guidance import Views

CONFIG = {
    "embed_dim": 16,
    "vision_cfg": {"image_size": 32, "patch_size": 8, "width": 32, "head_width": 16, "layers": 2},
    "text_cfg": {"context_length": 16, "vocab_size": 49408, "width": 16, "heads": 2, "layers": 1},
}
PREPROCESSING = {"mean": [0.4, 0.5, 0.6], "std": [0.25, 0.3, 0.35], "interpolation": "bicubic"}


def state(config: dict = CONFIG, seed: int = 0) -> dict[str, torch.Tensor]:
    """Random weights, the same for the same seed."""
    from fabcraft.guidance.clip import open_clip

    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = open_clip().CLIP(**config)
        return {name: value.contiguous() for name, value in network.state_dict().items()}


def save(folder: Path, config: dict = CONFIG, name: str = "tiny.safetensors", seed: int = 0) -> Path:
    """The checkpoint's path in `folder`, with `open_clip_config.json` beside it."""
    from safetensors.torch import save_file

    folder.mkdir(parents=True, exist_ok=True)
    told = {"model_cfg": config, "preprocess_cfg": PREPROCESSING}
    (folder / "open_clip_config.json").write_text(json.dumps(told))
    path = folder / name
    (save_file if path.suffix == ".safetensors" else torch.save)(state(config, seed), path)
    return path


def globe(rows: int = 8, columns: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """(V, 3) vertices and (F, 3) faces of a sphere of radius 1."""
    polar = np.pi * np.arange(1, rows) / rows
    around = 2 * np.pi * np.arange(columns) / columns
    ring = np.sin(polar)[:, None, None] * np.stack([np.cos(around), np.sin(around)], -1)
    points = np.dstack([ring, np.broadcast_to(np.cos(polar)[:, None], ring.shape[:2])]).reshape(-1, 3)
    vertices = np.vstack([points, [0, 0, 1.0], [0, 0, -1.0]])
    faces = ConvexHull(vertices).simplices.astype(np.int32)
    inward = np.linalg.det(vertices[faces]) < 0
    faces[inward] = faces[inward, ::-1]
    return vertices, faces


def seen(
    vertices: torch.Tensor,
    faces: np.ndarray,
    azimuth_deg: Sequence[float],
    elevation_deg: Sequence[float] | float = 0.0,
    *,
    camera: Sequence[int] | None = None,
    pixels: int = 48,
    outputs: Sequence[str] = ("shaded", "mask"),
) -> Views:
    """What a guidance sees of a mesh from around it, as a fit would hand it over."""
    count = len(azimuth_deg)
    elevations = np.broadcast_to(np.asarray(elevation_deg, float), count).copy()
    cameras = stack(
        [
            orbit((0.0, 0.0, 0.0), 4.0, float(azimuth), float(elevation), 40.0, pixels)
            for azimuth, elevation in zip(azimuth_deg, elevations, strict=True)
        ]
    )
    images = render(vertices, faces, cameras, outputs)
    visible = torch.zeros(count, len(vertices), dtype=torch.bool)
    for view, ids in enumerate(images.face_id):
        visible[view, faces[np.unique(ids[ids >= 0].numpy())].ravel()] = True
    return Views(
        step=0,
        steps=1,
        camera=np.arange(count) if camera is None else np.asarray(camera),
        azimuth_deg=np.asarray(azimuth_deg, float),
        elevation_deg=elevations,
        positions=vertices,
        faces=torch.tensor(faces),
        pixels=cameras.project(vertices.detach())[..., :2],
        visible=visible,
        **{name: images.of(name) for name in outputs},
    )


def part(views: Views, rows: Sequence[int]) -> Views:
    """Some of the views, as a chunk of their own."""
    chosen = list(rows)
    per_view = ("camera", "azimuth_deg", "elevation_deg", "pixels", "visible", *OUTPUTS)
    taken = {name: getattr(views, name) for name in per_view}
    return replace(views, **{name: value[chosen] for name, value in taken.items() if value is not None})
