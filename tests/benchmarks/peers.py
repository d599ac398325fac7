"""Other ways to make the renderer's pictures: its own maths in plain torch, and DEODR.

The torch peer takes visibility from fabcraft's z-buffer and does everything else with torch and NumPy operations:
perspective weights, interpolated normals, Lambert shade, the walk along the silhouette edges, the blend.
"""

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from fabcraft.fit.camera import Cameras
from fabcraft.fit.render import LIGHT, Topology
from fabcraft.geometry.raster import rasterize

AMBIENT = 0.25


def torch_render(vertices: Tensor, topology: Topology, cameras: Cameras) -> tuple[Tensor, Tensor]:
    """Mask and shade, (K, H, W) each, of perspective views of (V, 3) float64 vertices."""
    faces = torch.from_numpy(topology.faces.astype(np.int64))
    corners = vertices[faces]
    across = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = torch.zeros_like(vertices).index_add(0, faces.reshape(-1), across.repeat_interleave(3, 0))
    normals = torch.nn.functional.normalize(normals, dim=1)
    lights = torch.from_numpy(np.array(LIGHT) / np.linalg.norm(LIGHT) @ cameras.views[:, :3, :3])
    pictures = [
        _view(screen, normals, light, faces, topology, cameras)
        for screen, light in zip(cameras.project(vertices), lights, strict=True)
    ]
    masks, shades = zip(*pictures, strict=True)
    return torch.stack(masks), torch.stack(shades)


def _view(
    screen: Tensor, normals: Tensor, light: Tensor, faces: Tensor, topology: Topology, cameras: Cameras
) -> tuple[Tensor, Tensor]:
    height, width = cameras.height, cameras.width
    flat = screen.detach().numpy()
    keyed = np.column_stack([flat[:, :2], -1 / flat[:, 2]])
    seen = rasterize(keyed, topology.faces, width, height)
    face_id = seen.face_id.reshape(-1)
    pixels = np.flatnonzero(face_id >= 0)
    shown = faces[torch.from_numpy(face_id[pixels]).long()]
    centre = torch.from_numpy(np.stack([pixels % width + 0.5, pixels // width + 0.5], 1))
    ways = screen[shown][:, :, :2] - centre[:, None]
    areas = torch.stack([_cross(ways[:, 1], ways[:, 2]), _cross(ways[:, 2], ways[:, 0])], 1)
    whole = _cross(ways[:, 1] - ways[:, 0], ways[:, 2] - ways[:, 0])
    weights = areas / whole[:, None]
    weights = torch.cat([weights, 1 - weights.sum(1, keepdim=True)], 1)
    facing = -torch.sign(whole.detach())
    where = torch.from_numpy(pixels)
    lit = _lit(weights, screen[shown][:, :, 2], normals[shown], facing, light)
    shade = torch.zeros(height * width, dtype=screen.dtype).index_put((where,), lit)
    mask = torch.zeros(height * width, dtype=screen.dtype).index_fill(0, where, 1.0)
    found = (
        *_crossings(flat, keyed[:, 2], topology, seen.face_id, seen.depth),
        torch.from_numpy(topology.edges.astype(np.int64)),
    )
    mask, shade = _blend(mask, shade, screen, normals, light, faces, face_id, found, width)
    return mask.reshape(height, width), shade.reshape(height, width)


def _cross(a, b):
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _lit(weights: Tensor, depths: Tensor, normals: Tensor, facing: Tensor, light: Tensor) -> Tensor:
    """Lambert shade of N fragments from picture-linear weights (N, C), depths (N, C) and normals (N, C, 3)."""
    weights = torch.nn.functional.normalize(weights / depths, p=1, dim=1)
    normal = torch.nn.functional.normalize((weights[..., None] * normals).sum(1), dim=1)
    return AMBIENT + (1 - AMBIENT) * torch.relu((normal * facing[:, None]) @ light)


def _crossings(
    screen: np.ndarray, key: np.ndarray, topology: Topology, face_id: np.ndarray, nearest: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Edge, axis, line, inner and outer pixel of the silhouette crossings that count, one a pair of pixels."""
    height, width = face_id.shape
    edges = topology.edges
    a, b, o, p = edges.T
    side = _side(screen, a, b, o)
    second = np.where(p >= 0, _side(screen, a, b, np.maximum(p, 0)), 0.0)
    rim = np.flatnonzero((side != 0) & ((p < 0) | (side * second >= 0)))
    dx, dy = (screen[b[rim]] - screen[a[rim]])[:, :2].T
    axis = np.where(abs(dy) >= abs(dx), 0, 1)
    ends = np.stack([screen[a[rim], 1 - axis], screen[b[rim], 1 - axis]])
    limit = np.where(axis == 0, height, width)
    first = np.clip(np.ceil(ends.min(0) - 0.5), 0, limit).astype(int)
    count = np.maximum(np.clip(np.ceil(ends.max(0) - 0.5), 0, limit).astype(int) - first, 0)
    pick = np.repeat(np.arange(len(rim)), count)
    line = np.arange(len(pick)) - np.repeat(np.cumsum(count) - count, count) + first[pick]
    edge, axis = rim[pick], axis[pick]
    along_a, along_b = screen[a[edge], 1 - axis], screen[b[edge], 1 - axis]
    across_a, across_b = screen[a[edge], axis], screen[b[edge], axis]
    s = (line + 0.5 - along_a) / (along_b - along_a)
    across = across_a + s * (across_b - across_a)
    turned = side[edge] * (along_b - along_a)
    positive = np.where(axis == 0, turned < 0, turned > 0)
    near = np.ceil(across - 0.5).astype(int)
    inside, outside = np.where(positive, near, near - 1), np.where(positive, near - 1, near)
    keep = (np.minimum(inside, outside) >= 0) & (
        np.maximum(inside, outside) < np.where(axis == 0, width, height)
    )
    edge, axis, line, s, across = (values[keep] for values in (edge, axis, line, s, across))
    inside, outside = inside[keep], outside[keep]
    inner = np.where(axis == 0, line * width + inside, inside * width + line)
    outer = np.where(axis == 0, line * width + outside, outside * width + line)
    edge_key = key[a[edge]] + s * (key[b[edge]] - key[a[edge]])
    slack = np.maximum(
        _slope(screen, key, a[edge], b[edge], o[edge]),
        np.where(p[edge] >= 0, _slope(screen, key, a[edge], b[edge], np.maximum(p[edge], 0)), 0.0),
    )
    near = nearest.reshape(-1)
    seen = (face_id.reshape(-1)[inner] >= 0) & (edge_key < near[outer]) & (near[inner] <= edge_key + slack)
    edge, axis, line, inner, outer, edge_key = (x[seen] for x in (edge, axis, line, inner, outer, edge_key))
    t = abs(across - inside - 0.5)[seen]
    order = np.lexsort((edge, edge_key, -t, outer, inner))
    new = np.ones(len(order), bool)
    new[1:] = (np.diff(inner[order]) != 0) | (np.diff(outer[order]) != 0)
    kept = order[new]
    return edge[kept], axis[kept], line[kept], inner[kept], outer[kept]


def _side(screen, a, b, c):
    return _cross(screen[b] - screen[a], screen[c] - screen[a])


def _slope(screen, key, a, b, c):
    with np.errstate(divide="ignore", invalid="ignore"):
        area = _side(screen, a, b, c)
        ku, kv = key[b] - key[a], key[c] - key[a]
        kx = (ku * (screen[c, 1] - screen[a, 1]) - kv * (screen[b, 1] - screen[a, 1])) / area
        ky = (kv * (screen[b, 0] - screen[a, 0]) - ku * (screen[c, 0] - screen[a, 0])) / area
        return np.nan_to_num(abs(kx) + abs(ky), nan=0.0)


def _blend(mask, shade, screen, normals, light, faces, face_id, found, width):
    """The pictures with every crossing's share moved; differentiable."""
    edge, axis, line, inner, outer, ends = *(torch.from_numpy(values) for values in found[:5]), found[5]
    a, b = ends[edge, :2].unbind(1)
    flat = screen[:, :2]
    along_a, along_b = (
        flat[a].gather(1, (1 - axis)[:, None])[:, 0],
        flat[b].gather(1, (1 - axis)[:, None])[:, 0],
    )
    across_a, across_b = flat[a].gather(1, axis[:, None])[:, 0], flat[b].gather(1, axis[:, None])[:, 0]
    s = (line + 0.5 - along_a) / (along_b - along_a)
    across = across_a + s * (across_b - across_a)
    inside = torch.where(axis == 0, inner % width, inner // width)
    t = (across - inside - 0.5).abs()
    owner = faces[torch.from_numpy(face_id).long()[inner]]
    corners = flat.detach()[owner]
    facing = -torch.sign(_cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    pair = torch.stack([a, b], 1)
    rim = _lit(torch.stack([1 - s, s], 1), screen[pair][:, :, 2], normals[pair], facing, light)
    target = torch.where(t < 0.5, inner, outer)
    return (
        mask.index_add(0, target, (0.5 - t) * (mask[outer] - 1.0)),
        shade.index_add(0, target, (0.5 - t) * (shade[outer] - rim)),
    )


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
