"""Speed of the renderer, as a ratio to a plain torch peer measured in the same run.

The peer takes visibility from the same z-buffer and interpolates depth and normal with torch operations; it
has no antialiasing, so it does less. Run: pytest tests/benchmarks --benchmark-only
"""

from time import perf_counter

import numpy as np
import pytest
import torch

from fabcraft.fit.camera import Cameras, bank, front, stack
from fabcraft.fit.render import Topology, render
from fabcraft.geometry.plane import Plane
from fabcraft.geometry.raster import rasterize

FRONT = stack([front(Plane(-144.0, 144.0, 1.0, 288, 288))])
AROUND = stack(bank(8, (0.0, 0.0, 0.0), 105.0, resolution=224))


def globe(rows=100, columns=50):
    """A bumpy open tube of about 10,000 faces, 190 mm wide."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, rows), np.linspace(0.1, 3.0, columns + 1), indexing="ij")
    radius = 90 + 6 * np.sin(5 * u) * np.sin(7 * v)
    points = np.stack([np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)], -1) * radius[..., None]
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns), indexing="ij")
    a, b = i * (columns + 1) + j, (i + 1) * (columns + 1) + j
    faces = np.concatenate([np.stack([a, b, b + 1], -1), np.stack([a, b + 1, a + 1], -1)]).reshape(-1, 3)
    return torch.tensor(points.reshape(-1, 3), dtype=torch.float32), faces.astype(np.int32)


def torch_peer(vertices: torch.Tensor, faces: torch.Tensor, cameras: Cameras) -> torch.Tensor:
    """Sum of absolute depth and normal over the covered pixels, by torch operations."""
    corners = vertices[faces]
    across = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = torch.zeros_like(vertices).index_add(0, faces.reshape(-1), across.repeat_interleave(3, 0))
    normals = torch.nn.functional.normalize(normals, dim=1)
    total = vertices.new_zeros(())
    for screen in cameras.project(vertices):
        key = screen.detach().double().numpy().copy()
        if not cameras.orthographic:
            key[:, 2] = -1 / key[:, 2]
        seen = rasterize(key, faces.numpy().astype(np.int32), cameras.width, cameras.height)
        row, column = np.nonzero(seen.face_id >= 0)
        shown = faces[torch.from_numpy(seen.face_id[row, column]).long()]
        centre = torch.from_numpy(np.stack([column + 0.5, row + 0.5], 1)).to(vertices.dtype)
        ways = screen[shown][:, :, :2] - centre[:, None]
        areas = torch.stack([cross(ways[:, 1], ways[:, 2]), cross(ways[:, 2], ways[:, 0])], 1)
        weights = areas / cross(ways[:, 1] - ways[:, 0], ways[:, 2] - ways[:, 0])[:, None]
        weights = torch.cat([weights, 1 - weights.sum(1, keepdim=True)], 1)
        if not cameras.orthographic:
            weights = torch.nn.functional.normalize(weights / screen[shown][:, :, 2], p=1, dim=1)
        normal = torch.nn.functional.normalize((weights[..., None] * normals[shown]).sum(1), dim=1)
        total = total + normal.abs().sum() + (weights * screen[shown][:, :, 2]).sum(1).abs().sum()
    return total


def cross(a, b):
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def median_seconds(function, rounds=9):
    function()
    times = []
    for _ in range(rounds):
        start = perf_counter()
        function()
        times.append(perf_counter() - start)
    return float(np.median(times))


@pytest.mark.parametrize("cameras", [FRONT, AROUND], ids=["front-288px", "eight-views-224px"])
def test_a_step_is_faster_than_plain_torch_without_antialiasing(benchmark, cameras):
    vertices, faces = globe()
    vertices.requires_grad_()
    topology, indices = Topology.of(faces), torch.from_numpy(faces).long()

    def ours():
        images = render(vertices, topology, cameras, ("mask", "depth", "normal"))
        total = images.mask.sum() + images.depth.abs().sum() + images.normal.abs().sum()
        torch.autograd.grad(total, vertices)

    def theirs():
        torch.autograd.grad(torch_peer(vertices, indices, cameras), vertices)

    ours()
    benchmark.pedantic(ours, rounds=15, warmup_rounds=2)
    ratio = median_seconds(ours) / median_seconds(theirs)
    benchmark.extra_info["ratio_to_torch"] = round(ratio, 3)
    print(f"\nratio to plain torch: {ratio:.2f}")  # noqa: T201
    assert ratio < 1.0
