"""The renderer's derivative against central differences of a supersampled render without antialiasing."""

import numpy as np
import pytest
import torch
from measure import Row
from scenes import SIZES, around, torus

from fabcraft.fit.camera import Cameras
from fabcraft.fit.render import LIGHT, Topology, render
from fabcraft.geometry.raster import rasterize

FINE = 4
STEP_MM = 0.5


def supersampled(vertices: np.ndarray, faces: np.ndarray, cameras: Cameras) -> dict[str, np.ndarray]:
    """Box-filtered mask and shade, (K, H, W), of FINE² points a pixel, from the z-buffer and NumPy alone."""
    large = Cameras(cameras.views, cameras.focals, False, FINE * cameras.width, FINE * cameras.height)
    across = np.cross(
        vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]]
    )
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], across)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    lights = np.array(LIGHT) / np.linalg.norm(LIGHT) @ cameras.views[:, :3, :3]
    pictures = {"mask": [], "shaded": []}
    for screen, light in zip(large.project(torch.from_numpy(vertices)).numpy(), lights, strict=True):
        seen = rasterize(
            np.column_stack([screen[:, :2], -1 / screen[:, 2]]), faces, large.width, large.height
        )
        hit = seen.face_id >= 0
        shown = faces[seen.face_id[hit]]
        weights = seen.barycentric[hit].astype(float) / screen[shown, 2]
        normal = np.einsum("nc,nci->ni", weights, normals[shown])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        for name, values in {"mask": 1.0, "shaded": 0.25 + 0.75 * np.maximum(0, normal @ light)}.items():
            whole = np.zeros(hit.shape)
            whole[hit] = values
            pictures[name].append(whole.reshape(cameras.height, FINE, cameras.width, FINE).mean((1, 3)))
    return {name: np.stack(made) for name, made in pictures.items()}


@pytest.mark.parametrize("faces", SIZES)
def test_directional_derivatives_are_those_of_a_supersampled_render(rows, faces):
    points, triangles = torus(*SIZES[faces])
    cameras, random = around(4), np.random.default_rng(0)
    vertices = torch.tensor(points, requires_grad=True)
    images = render(vertices, Topology.of(triangles), cameras, ("mask", "shaded"))
    moved = points @ np.diag([1.05, 0.97, 1.02]) + [2.0, -1.0, 3.0]
    targets = {name: torch.from_numpy(made) for name, made in supersampled(moved, triangles, cameras).items()}
    down, across = torch.meshgrid(torch.linspace(0, 3, 224), torch.linspace(0, 3, 224), indexing="ij")
    pairs = {(name, kind): [] for name in targets for kind in ("sum", "L2 loss")}
    for _ in range(8):
        way = np.sin(points @ random.normal(size=(3, 3)) / 40 + random.uniform(0, 6, 3))
        way = way @ random.normal(size=(3, 3))
        weight = 1 + 0.5 * torch.sin(across * random.normal() + down * random.normal() + random.uniform(0, 6))
        ahead = supersampled(points + STEP_MM * way, triangles, cameras)
        behind = supersampled(points - STEP_MM * way, triangles, cameras)
        for (name, kind), found in pairs.items():

            def total(picture, name=name, kind=kind, weight=weight):
                return ((picture - targets[name]).square() if kind == "L2 loss" else picture * weight).sum()

            (slope,) = torch.autograd.grad(total(getattr(images, name)), vertices, retain_graph=True)
            difference = total(torch.from_numpy(ahead[name])) - total(torch.from_numpy(behind[name]))
            found.append(((slope.numpy() * way).sum(), difference.item() / (2 * STEP_MM)))
    peer = f"differences of a {FINE} x {FINE} supersampled render"
    failed = []
    for (name, kind), found in pairs.items():
        ours, theirs = np.array(found).T
        told = f"{name} gradient, {'smoothly weighted sum' if kind == 'sum' else kind}, {faces} faces"
        slope, correlation = ours @ theirs / (theirs @ theirs), np.corrcoef(ours, theirs)[0, 1]
        rows.append(
            Row(f"{told}: slope", float(slope), "0.97..1.03" if name == "mask" else "0.95..1.05", peer)
        )
        rows.append(Row(f"{told}: correlation", float(correlation), ">= 0.995", peer))
        failed += [row for row in rows[-2:] if kind == "sum" and not row.met]
    assert not failed, failed
