"""`render`: pictures of a triangle mesh, differentiable by its vertices, rims included.

Vertices on a graphics card are drawn there, in torch operations (`fabcraft.fit.render_torch`); all others on the CPU, by
the kernels of `fabcraft.fit.shading` and `fabcraft.fit.silhouette`. Both make the same pictures and derivatives.

Mask, depth, normal and shade are box-filtered over black: at a rim, what is seen is weighted by how much of
the pixel it covers (dividing by the mask undoes that against the background). Every output has a derivative
with respect to the vertices: at rims through the edge-driven antialiasing of `fabcraft.fit.silhouette`,
inside through the fragments of `fabcraft.fit.shading`. Border edges of open sheets are rims too, and both
sides of a face are seen. There is no derivative for what is hidden, nor for a line along which two surfaces
cut through each other.

Same input on the same device, same bytes: pixels belong to bands of rows, and sums over bands are taken in a fixed order,
for any number of threads. Set OMP_WAIT_POLICY=PASSIVE before torch is imported (the command line does): the
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
from fabcraft.fit.render_torch import Look, draw
from fabcraft.fit.topology import Topology
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
    """Pictures of a mesh from K cameras, in the dtype and on the device of `vertices`.

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
    direction = np.array(light) / np.linalg.norm(light)
    lights = direction @ views.views[:, :3, :3]
    if vertices.is_cuda:
        towards = torch.from_numpy(lights).to(vertices.device)
        look = Look(towards, float(ambient), views.orthographic, tuple(outputs))
        ids, drawn = draw(vertices, topology, views, look)
        return Images(ids, **drawn)
    scene = _Scene(topology, views, lights, float(ambient), tuple(outputs))
    face_id, *pictures = _Render.apply(vertices.to("cpu"), scene)
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

    @property
    def lit(self) -> bool:
        """Whether the vertices need normals."""
        return "normal" in self.outputs or "shaded" in self.outputs


class _Render(torch.autograd.Function):
    """Face ids and the four pictures from vertices (V, 3); unwanted pictures have no rows."""

    @staticmethod
    def forward(ctx: Any, vertices: Tensor, scene: _Scene) -> tuple[Tensor, ...]:
        ctx.set_materialize_grads(False)
        cameras, topology = scene.cameras, scene.topology
        points = np.array(vertices.detach().numpy(), dtype=np.float64, order="C")
        corners = np.ascontiguousarray(cameras.project(torch.from_numpy(points)).numpy())
        keys = _depth_keys(corners[..., 2], cameras.orthographic)
        normals, lengths = np.empty((len(points) if scene.lit else 0, 3)), np.empty(len(points))
        if scene.lit:
            shading.vertex_normals(points, topology.faces, normals, lengths)
        size, bands = (len(corners), cameras.height, cameras.width), bands_for(len(corners))
        face_id, nearest = np.empty(size, np.int32), np.empty(size, np.float64)
        zbuffer(corners, keys, topology.faces, bands, face_id, nearest)
        surface = (corners, keys, normals, topology.faces)
        look = (scene.lights, scene.ambient, cameras.orthographic)
        pictures = _blank(size, scene.outputs)
        shading.shade(*surface, *look, bands, face_id, *pictures)
        crossings = _blended(surface, topology.edges, look, face_id, nearest, pictures)
        ctx.saved = surface, topology.edges, look, bands, face_id, crossings
        ctx.scene, ctx.rest, ctx.dtype = scene, (points, lengths), vertices.dtype
        ids = torch.from_numpy(face_id)
        ctx.mark_non_differentiable(ids)
        return ids, *(torch.from_numpy(picture) for picture in pictures)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor | None) -> tuple[Tensor, None]:
        surface, edges, look, bands, face_id, crossings = ctx.saved
        points, lengths = ctx.rest
        normals, faces, cameras = surface[2], surface[3], ctx.scene.cameras
        given = [
            blank if grad is None else grad.contiguous().numpy()
            for blank, grad in zip(_blank((len(face_id), 0, 0), ()), grads[1:], strict=True)
        ]
        tasks = len(face_id) * bands
        by_points, by_normals = np.empty((tasks, *points.shape)), np.empty((tasks, *normals.shape))
        rows = cameras.views[:, :3, :3].copy()
        rows[:, :2] *= 0.5 * cameras.height * cameras.focals[:, None, None]
        centre = np.array([0.5 * cameras.width, 0.5 * cameras.height])
        silhouette.backward(
            *surface,
            edges,
            *look,
            bands,
            face_id,
            *crossings,
            *given,
            rows,
            centre,
            NEAR,
            by_points,
            by_normals,
        )
        total = by_points.sum(0)
        if len(normals):
            shading.vertex_normals_backward(points, faces, normals, lengths, by_normals, total)
        return torch.from_numpy(total).to(ctx.dtype), None


def _depth_keys(depth: Float64[np.ndarray, "K V"], orthographic: bool) -> Float64[np.ndarray, "K V"]:
    """Linear over the picture and smaller for what is nearer: z, or -1 / z (NaN behind the camera)."""
    if orthographic:
        return np.ascontiguousarray(depth)
    return np.where(depth > NEAR, -1.0 / np.maximum(depth, NEAR), np.nan)


def _blank(size: tuple[int, int, int], outputs: Sequence[str]) -> list[np.ndarray]:
    """Memory for the four pictures, without rows for those not in `outputs`."""
    shapes = {name: size if name in outputs else (size[0], 0, 0) for name in OUTPUTS}
    return [np.empty(shape + (3,) * (name == "normal"), np.float32) for name, shape in shapes.items()]


def _blended(
    surface: tuple[np.ndarray, ...],
    edges: np.ndarray,
    look: tuple[np.ndarray, float, bool],
    face_id: np.ndarray,
    nearest: np.ndarray,
    pictures: Sequence[np.ndarray],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Antialias the pictures; the crossings of every view: pixels (K, N, 3), places (K, N, 2), their number (K,)."""
    views, height, width = face_id.shape
    counts, room = np.full(views, -1), 4 * (height + width)
    pixels, places = np.empty((views, room, 3), np.int32), np.empty((views, room, 2))
    silhouette.blend(*surface, edges, *look, face_id, nearest, pixels, places, counts, *pictures)
    if views and (missing := -int(counts.min())) > 0:  # a ragged silhouette: make room for the views left out
        more = ((0, 0), (0, missing - room), (0, 0))
        pixels, places = np.pad(pixels, more), np.pad(places, more)
        silhouette.blend(*surface, edges, *look, face_id, nearest, pixels, places, counts, *pictures)
    return pixels, places, counts
