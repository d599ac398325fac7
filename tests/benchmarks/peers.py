"""Other ways to make the renderer's pictures: its own maths in torch operations, and DEODR."""

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from fabcraft.fit.camera import Cameras
from fabcraft.fit.render import LIGHT, Topology
from fabcraft.fit.render_torch import Look, draw

AMBIENT = 0.25


def torch_render(vertices: Tensor, topology: Topology, cameras: Cameras) -> tuple[Tensor, Tensor]:
    """Mask and shade, (K, H, W) each, of (V, 3) vertices of any device, by the renderer in torch operations."""
    lights = torch.from_numpy(np.array(LIGHT) / np.linalg.norm(LIGHT) @ cameras.views[:, :3, :3])
    look = Look(lights.to(vertices.device), AMBIENT, cameras.orthographic, ("mask", "shaded"))
    _, pictures = draw(vertices, topology, cameras, look)
    return pictures["mask"], pictures["shaded"]


def deodr_renderer(
    faces: np.ndarray, vertices: np.ndarray, cameras: Cameras
) -> Callable[[Tensor], tuple[Tensor, Tensor]]:
    """Mask and shade, (K, H, W) each, of (V, 3) float64 vertices, by DEODR; it shades a vertex, linear in the picture."""
    from deodr.pytorch import CameraPytorch, ColoredTriMeshPytorch, Scene3DPytorch

    class TwoChannels(Scene3DPytorch):
        """One colour is always 1, the other one the light."""

        def _compute_vertices_colors_with_illumination(self):
            lit = AMBIENT + (1 - AMBIENT) * torch.relu(self.mesh.vertex_normals @ self.light_directional)
            return torch.stack([torch.ones_like(lit), lit], 1)

    colours = torch.ones(len(vertices), 2, dtype=torch.float64)
    mesh = ColoredTriMeshPytorch(faces.copy(), torch.from_numpy(vertices), colors=colours)
    scene = TwoChannels()
    scene.integer_pixel_centers = False
    scene.set_mesh(mesh)
    scene.set_background_color(np.zeros(2))
    lights = torch.from_numpy(np.array(LIGHT) / np.linalg.norm(LIGHT) @ cameras.views[:, :3, :3])
    views = []
    for view, focal in zip(cameras.views, cameras.focals, strict=True):
        scale = 0.5 * focal * cameras.height
        inner = np.array([[scale, 0, 0.5 * cameras.width], [0, scale, 0.5 * cameras.height], [0, 0, 1]])
        views.append(CameraPytorch(view[:3].copy(), inner, cameras.height, cameras.width))

    def draw(points: Tensor) -> tuple[Tensor, Tensor]:
        pictures = []
        for camera, light in zip(views, lights, strict=True):
            mesh.set_vertices(points)
            scene.set_light(light, torch.zeros((), dtype=torch.float64))
            pictures.append(scene.render(camera))
        return tuple(torch.stack(pictures).unbind(-1))

    return draw
