"""`render`: pictures of a triangle mesh on the CPU, differentiable by its vertices, rims included.

Mask, depth, normal and shade are box-filtered over black: at a rim, what is seen is weighted by how much of
the pixel it covers (dividing by the mask undoes that against the background). Every output has a derivative
with respect to the vertices: at rims through the edge-driven antialiasing of `fabcraft.fit.silhouette`,
inside through the fragments of `fabcraft.fit.shading`. Border edges of open sheets are rims too, and both
sides of a face are seen. There is no derivative for what is hidden, nor for a line along which two surfaces
cut through each other.

Same input, same bytes: pixels belong to bands of rows, and sums over bands are taken in a fixed order, for
any number of threads. Set OMP_WAIT_POLICY=PASSIVE before torch is imported (the command line does): the
kernels and torch each keep threads, and where these wait by spinning on a busy machine a step takes several
times as long.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Float64, Int32, Integer
from torch import Tensor

from fabcraft.errors import InputError
from fabcraft.fit import shading, silhouette
from fabcraft.fit.camera import NEAR, Camera, Cameras, stack
from fabcraft.fit.silhouette import Topology
from fabcraft.geometry.raster import bands_for, zbuffer

OUTPUTS = ("mask", "depth", "normal", "shaded")
LIGHT = (-0.35, -0.5, -0.8)
"""Over the photographer's left shoulder; view space: right, down, away from the camera."""


@dataclass(frozen=True, eq=False)
class Images:
    """Pictures of K views; what was not asked for is None. Black (0) where nothing is seen."""

    face_id: Int32[Tensor, "K H W"]
    """The face seen at every pixel centre; -1 where there is none. Has no derivative."""
    mask: Float[Tensor, "K H W"] | None = None
    """Share of the pixel that is covered; may leave 0..1 a little where several rims meet in a pixel."""
    depth: Float[Tensor, "K H W"] | None = None
    """Depth of `Camera.project`, mm."""
    normal: Float[Tensor, "K H W 3"] | None = None
    """Unit normal in world axes, interpolated between vertices and turned towards the camera."""
    shaded: Float[Tensor, "K H W"] | None = None
    """Lambert shade, 0..1."""

    def of(self, name: str) -> Tensor:
        """The pictures of one kind.  Raises `InputError` when it was not asked for."""
        pictures = getattr(self, name)
        if pictures is None:
            raise InputError(f"'{name}' was not rendered", "Name it in `outputs`.")
        return pictures


def render(
    vertices: Float[Tensor, "V 3"],
    faces: Topology | Integer[np.ndarray, "F 3"],
    cameras: Camera | Sequence[Camera] | Cameras,
    outputs: Sequence[str] = OUTPUTS,
    *,
    light: tuple[float, float, float] = LIGHT,
    ambient: float = 0.25,
) -> Images:
    """Pictures of a mesh from K cameras, in the dtype and on the device of `vertices` (computed on the CPU).

    vertices : (V, 3), mm; the derivative goes there.
    faces : `Topology.of(faces)`, made once for a connectivity; plain (F, 3) indices cost a sort a call.
    outputs : which of "mask", "depth", "normal" and "shaded" to make; fewer are faster.
    light : direction towards the light in view space (right, down, away from the camera), any length but 0.
    ambient : shade of what the light does not reach, 0..1.

    Raises `InputError` for an unknown output.
    """
    if unknown := set(outputs) - set(OUTPUTS):
        raise InputError(f"no output {sorted(unknown)}, expected some of {OUTPUTS}", "Correct the names.")
    topology = faces if isinstance(faces, Topology) else Topology.of(faces)
    views = (
        cameras
        if isinstance(cameras, Cameras)
        else stack([cameras] if isinstance(cameras, Camera) else cameras)
    )
    points = vertices.to("cpu", torch.float64)
    lit = "normal" in outputs or "shaded" in outputs
    normals = _VertexNormals.apply(points, topology) if lit else points.new_zeros(0, 3)
    direction = np.array(light) / np.linalg.norm(light)
    scene = _Scene(topology, views, direction @ views.views[:, :3, :3], float(ambient), tuple(outputs))
    face_id, *pictures = _Render.apply(views.project(points), normals, scene)
    made = dict(zip(OUTPUTS, pictures, strict=True))
    return Images(face_id.to(vertices.device), **{name: made[name].to(vertices) for name in outputs})


@dataclass(frozen=True, eq=False)
class _Scene:
    """What a render depends on besides the vertices. `lights` (K, 3): world, towards the light."""

    topology: Topology
    cameras: Cameras
    lights: Float64[np.ndarray, "K 3"]
    ambient: float
    outputs: tuple[str, ...]


class _VertexNormals(torch.autograd.Function):
    """Area-weighted unit vertex normals (V, 3) of the vertices (V, 3)."""

    @staticmethod
    def forward(ctx: Any, vertices: Tensor, topology: Topology) -> Tensor:
        points = np.ascontiguousarray(vertices.detach().numpy())
        normals, lengths = np.empty_like(points), np.empty(len(points))
        shading.vertex_normals(points, topology.faces, normals, lengths)
        ctx.save_for_backward(vertices)
        ctx.saved = topology.faces, normals.copy(), lengths
        return torch.from_numpy(normals)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None]:
        points = np.ascontiguousarray(ctx.saved_tensors[0].detach().numpy())
        faces, normals, lengths = ctx.saved
        by_points = np.zeros_like(points)
        shading.vertex_normals_backward(points, faces, normals, lengths, grads[0].numpy().copy(), by_points)
        return torch.from_numpy(by_points), None


class _Render(torch.autograd.Function):
    """Face ids and the four pictures from screen (K, V, 3) and normals (V, 3); unwanted ones have no rows."""

    @staticmethod
    def forward(ctx: Any, screen: Tensor, normals: Tensor, scene: _Scene) -> tuple[Tensor, ...]:
        ctx.set_materialize_grads(False)
        cameras, topology = scene.cameras, scene.topology
        corners = np.ascontiguousarray(screen.detach().numpy())
        directions = np.ascontiguousarray(normals.detach().numpy())
        keys = _depth_keys(corners[..., 2], cameras.orthographic)
        size, bands = (len(corners), cameras.height, cameras.width), bands_for(len(corners))
        face_id, nearest = np.empty(size, np.int32), np.empty(size, np.float64)
        zbuffer(corners, keys, topology.faces, bands, face_id, nearest)
        look = (scene.lights, scene.ambient, cameras.orthographic)
        pictures = _blank(size, scene.outputs)
        shading.shade(corners, keys, directions, topology.faces, *look, bands, face_id, *pictures)
        crossings = _crossings(corners, keys, topology.edges, face_id, nearest)
        surface = (corners, keys, directions, topology.faces)
        silhouette.blend(*surface, topology.edges, *look, face_id, *crossings, *pictures)
        ctx.saved = surface, topology.edges, look, bands, face_id, crossings
        made = tuple(torch.from_numpy(picture) for picture in pictures)
        ids = torch.from_numpy(face_id)
        ctx.mark_non_differentiable(ids)
        return ids, *made

    @staticmethod
    def backward(ctx: Any, *grads: Tensor | None) -> tuple[Tensor, Tensor, None]:
        surface, edges, look, bands, face_id, crossings = ctx.saved
        corners, directions = surface[0], surface[2]
        given = [
            blank if grad is None else grad.contiguous().numpy()
            for blank, grad in zip(_blank((len(corners), 0, 0), ()), grads[1:], strict=True)
        ]
        tasks = len(corners) * bands
        by_screen = np.zeros((tasks, *corners.shape[1:]))
        by_normals = np.zeros((tasks, *directions.shape))
        if any(grad.size for grad in given[1:]):  # the mask does not change inside
            shading.shade_backward(*surface, *look, bands, face_id, *given, by_screen, by_normals)
        silhouette.blend_backward(
            *surface, edges, *look, bands, face_id, *crossings, *given, by_screen, by_normals
        )
        by_view = by_screen.reshape(len(corners), bands, *corners.shape[1:]).sum(1)
        return torch.from_numpy(by_view), torch.from_numpy(by_normals.sum(0)), None


def _depth_keys(depth: Float64[np.ndarray, "K V"], orthographic: bool) -> Float64[np.ndarray, "K V"]:
    """Linear over the picture and smaller for what is nearer: z, or -1 / z (NaN behind the camera)."""
    if orthographic:
        return np.ascontiguousarray(depth)
    return np.where(depth > NEAR, -1.0 / np.maximum(depth, NEAR), np.nan)


def _blank(size: tuple[int, int, int], outputs: Sequence[str]) -> list[np.ndarray]:
    """Memory for the four pictures, without rows for those not in `outputs`."""
    shapes = {name: size if name in outputs else (size[0], 0, 0) for name in OUTPUTS}
    return [np.empty(shape + (3,) * (name == "normal"), np.float32) for name, shape in shapes.items()]


def _crossings(
    corners: np.ndarray, keys: np.ndarray, edges: np.ndarray, face_id: np.ndarray, nearest: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The silhouette crossings of every view: pixels (K, N, 3), places (K, N, 2), their number (K,)."""
    views, height, width = face_id.shape
    counts = np.empty(views, np.int64)
    silhouette.count_crossings(corners, edges, height, width, counts)
    most = int(counts.max(initial=0))
    pixels, places = np.empty((views, most, 3), np.int32), np.empty((views, most, 2))
    silhouette.find_crossings(corners, keys, edges, face_id, nearest, pixels, places, counts)
    return pixels, places, counts
