"""`draw`: the pictures of `fabcraft.fit.render` in torch operations, for a graphics card.

The same pictures and derivatives as on the CPU, in float64. Visibility (`raster_torch`) and the silhouette's crossings
(`silhouette_torch`) have none; everything after them is written so that torch derives it. Over one triangle in one view
each attribute A of a vertex is linear in the picture,

    A(p) = A_2 + b_0(p) (A_0 - A_2) + b_1(p) (A_1 - A_2),

with A = (n, z) in an orthographic view and A = (n / z, 1 / z) in a perspective one: three numbers a triangle and
attribute, handed to its pixels. At a crossing the attributes are linear along the edge.

Same input, same bytes: every sum is taken by `fabcraft.fit.gather`, in a fixed order.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Float64, Int, Int32
from torch import Tensor

from fabcraft.fit.camera import NEAR, Cameras
from fabcraft.fit.gather import Places, take, total
from fabcraft.fit.raster_torch import MOST, zbuffer
from fabcraft.fit.silhouette_torch import Crossings, crossings
from fabcraft.fit.topology import DeviceTopology, Topology

CHANNELS = {"mask": 1, "depth": 1, "normal": 3, "shaded": 1}


@dataclass(frozen=True, eq=False)
class Look:
    """How a surface is shown."""

    lights: Float64[Tensor, "K 3"]
    """World, towards the light, of length 1."""
    ambient: float
    orthographic: bool
    outputs: tuple[str, ...]

    @property
    def lit(self) -> bool:
        """Whether the vertices need normals."""
        return "normal" in self.outputs or "shaded" in self.outputs

    @property
    def attributes(self) -> int:
        """How many numbers a vertex brings: normal and depth, depth alone, or none for a mask."""
        return 4 if self.lit else int("depth" in self.outputs)


def draw(
    vertices: Float[Tensor, "V 3"], topology: Topology, cameras: Cameras, look: Look, most: int = MOST
) -> tuple[Int32[Tensor, "K H W"], dict[str, Tensor]]:
    """Face ids, and the pictures (K, H, W) or (K, H, W, 3) by name, in the dtype of `vertices`.

    most : pairs of a face or an edge and a pixel that are held in memory at a time.
    """
    points, orthographic = vertices.double(), look.orthographic
    mesh = topology.on(vertices.device, len(vertices))
    screen = cameras.project(points)
    with torch.no_grad():
        depth = screen[..., 2]
        hyperbolic = torch.where(depth > NEAR, -1.0 / depth.clamp(min=NEAR), torch.nan)
        keys = depth if orthographic else hyperbolic
        face_id, nearest = zbuffer(screen, keys, mesh.faces, cameras.height, cameras.width, most)
        found = crossings(screen, keys, mesh.edges, face_id, nearest, most)
        shown = _Shown.of(face_id, screen, mesh) if look.attributes else None
    table = _vertex_table(points, screen, mesh, look)
    ends = (found.ends + (found.view * len(vertices))[:, None]).reshape(-1)
    index = torch.cat([shown.corners.reshape(-1), ends]) if shown else ends
    corners, rims = take(table, Places.of(index, len(table))).split([len(index) - len(ends), len(ends)])
    pixels = _pixels(corners, shown, look, face_id)
    flat = _antialiased(pixels, rims, found, shown, look, face_id).to(vertices.dtype)
    parts = flat.reshape(*face_id.shape, -1).split([CHANNELS[name] for name in look.outputs], 3)
    named = dict(zip(look.outputs, parts, strict=True))
    return face_id, {name: part if name == "normal" else part[..., 0] for name, part in named.items()}


@dataclass(frozen=True, eq=False)
class _Shown:
    """The U faces that can be seen, each in one view, and the N pixels that show them, face by face."""

    view: Int[Tensor, " U"]
    corners: Int[Tensor, "U 3"]
    """Rows of the table of all views' vertices."""
    sign: Float64[Tensor, " U"]
    """+1 for a face seen from outside, -1 for one seen from behind."""
    pixels: Int[Tensor, " N"]
    """In the flattened pictures of all views."""
    owner: Places
    """Of the U faces, for every pixel."""

    @staticmethod
    def of(
        face_id: Int32[Tensor, "K H W"], screen: Float64[Tensor, "K V 3"], mesh: DeviceTopology
    ) -> "_Shown":
        """What the face ids show."""
        faces, area = len(mesh.faces), face_id.shape[1] * face_id.shape[2]
        pixels = (face_id.reshape(-1) >= 0).nonzero()[:, 0]
        owner = pixels // area * faces + face_id.reshape(-1)[pixels]
        owner, order = owner.sort(stable=True)
        distinct, counts = owner.unique_consecutive(return_counts=True)
        view = distinct // max(faces, 1)
        corners = mesh.faces[distinct % max(faces, 1)] + (view * screen.shape[1])[:, None]
        a, b, c = screen.reshape(-1, 3)[corners].unbind(1)
        clockwise = _cross(b - a, c - a) < 0.0
        return _Shown(
            view, corners, torch.where(clockwise, 1.0, -1.0).double(), pixels[order], Places.runs(counts)
        )


def _cross(u: Tensor, v: Tensor) -> Tensor:
    return u[..., 0] * v[..., 1] - v[..., 0] * u[..., 1]


def _vertex_table(
    points: Float64[Tensor, "V 3"], screen: Float64[Tensor, "K V 3"], mesh: DeviceTopology, look: Look
) -> Float64[Tensor, "M C"]:
    """(K V, 2 + A): column and row of every vertex in every view, and its attributes."""
    depth, count = screen[..., 2:], len(screen)
    scale = torch.ones_like(depth) if look.orthographic else 1.0 / depth.clamp(min=NEAR)
    parts = [screen[..., :2]]
    if look.lit:
        parts.append(scale * _vertex_normals(points, mesh).expand(count, -1, -1))
    if look.attributes:
        parts.append(depth if look.orthographic else scale)
    return torch.cat(parts, 2).flatten(0, 1)


def _vertex_normals(points: Float64[Tensor, "V 3"], mesh: DeviceTopology) -> Float64[Tensor, "V 3"]:
    """Area-weighted unit normals; 0 where a vertex has none."""
    a, b, c = take(points, mesh.corners).reshape(-1, 3, 3).unbind(1)
    across = torch.linalg.cross(b - a, c - a)
    summed = total(across[:, None].expand(-1, 3, -1).reshape(-1, 3), mesh.corners)
    length = torch.linalg.vector_norm(summed, dim=1, keepdim=True)
    return torch.where(length > 0.0, summed / torch.where(length > 0.0, length, 1.0), 0.0)


def _pixels(
    corners: Float64[Tensor, "P C"], shown: _Shown | None, look: Look, face_id: Int32[Tensor, "K H W"]
) -> Float64[Tensor, "N D"]:
    """The channels of every pixel that shows a face, in the order of `shown`; then those of the background, 0."""
    if shown is None:  # a mask alone
        return (face_id.reshape(-1, 1) >= 0).double()
    first, second, last = corners.reshape(-1, 3, corners.shape[1]).unbind(1)
    (ux, uy, first), (vx, vy, second) = (
        (corner - last).split([1, 1, look.attributes], 1) for corner in (first, second)
    )
    scale = 1.0 / (ux * vy - vx * uy)
    by_column, by_row = (vy * first - uy * second) * scale, (ux * second - vx * first) * scale
    linear = take(torch.cat([last, by_column, by_row], 1), shown.owner)
    column, row, last, by_column, by_row = linear.split([1, 1, *[look.attributes] * 3], 1)
    height, width = face_id.shape[1:]
    place = shown.pixels[:, None] % (height * width)
    seen = last + (place % width + 0.5 - column) * by_column + (place // width + 0.5 - row) * by_row
    owner = shown.owner.index
    channels = _channels(seen, shown.sign[owner], look.lights[shown.view[owner]], look)
    return torch.cat([channels, channels.new_zeros(1, channels.shape[1])])


def _channels(
    seen: Float64[Tensor, "N A"], sign: Float64[Tensor, " N"], light: Float64[Tensor, "N 3"], look: Look
) -> Float64[Tensor, "N D"]:
    """The outputs, side by side, of fragments with the attributes `seen`."""
    made = {"mask": torch.ones_like(seen[:, :1])}
    if look.attributes:
        *normal, depth = seen.split([3, 1] if look.lit else [1], 1)
        made["depth"] = depth if look.orthographic else 1.0 / depth
    if look.lit:
        length = torch.linalg.vector_norm(normal[0], dim=1, keepdim=True)
        has = length > (1e-9 if look.orthographic else 1e-9 * depth)  # where normals cancel out there is none
        made["normal"] = normal[0] * torch.where(has, sign[:, None] / torch.where(has, length, 1.0), 0.0)
        made["shaded"] = look.ambient + (1.0 - look.ambient) * torch.relu(
            (made["normal"] * light).sum(1, True)
        )
    return torch.cat([made[name] for name in look.outputs], 1)


def _antialiased(
    pixels: Float64[Tensor, "N D"],
    rims: Float64[Tensor, "E A"],
    found: Crossings,
    shown: _Shown | None,
    look: Look,
    face_id: Int32[Tensor, "K H W"],
) -> Float64[Tensor, "M D"]:
    """The flattened pictures of all views, their crossings blended in."""
    start, end = rims.reshape(-1, 2, rims.shape[1]).unbind(1)
    (column, row, start), (right, down, change) = (
        part.split([1, 1, look.attributes], 1) for part in (start, end - start)
    )
    steep = (found.axis == 0)[:, None]
    s = (found.line[:, None] + 0.5 - torch.where(steep, row, column)) / torch.where(steep, down, right)
    away = (
        torch.where(steep, column, row) + s * torch.where(steep, right, down) - (found.inside[:, None] + 0.5)
    )
    t = torch.where((found.outer > found.inner)[:, None], away, -away)
    if shown is None:
        flat, outer = pixels, pixels[found.outer]
        rim = torch.ones_like(outer)
    else:
        row = torch.full((face_id.numel(),), len(shown.pixels), device=face_id.device)
        row[shown.pixels] = torch.arange(len(shown.pixels), device=face_id.device)
        flat = pixels.new_zeros(face_id.numel(), pixels.shape[1]).index_copy(0, shown.pixels, pixels[:-1])
        outer = take(pixels, Places.of(row[found.outer], len(pixels)))
        sign = shown.sign[shown.owner.index[row[found.inner]]]
        rim = _channels(start + s * change, sign, look.lights[found.view], look)
    target = torch.where(t[:, 0] < 0.5, found.inner, found.outer)
    return flat + total((0.5 - t) * (outer - rim), Places.of(target, len(flat)))
