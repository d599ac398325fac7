"""PNG pictures of object and body without a graphics card: a z-buffer, then deferred studio light.

One sample grid of `supersample`² points per pixel is rasterised, shaded in linear light and averaged, so
edges are smooth. Equal input gives equal bytes.
"""

import io
import typing
from collections.abc import Sequence
from dataclasses import dataclass

import numba as nb
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int32, Integer, UInt8
from PIL import Image

from fabcraft.geometry.raster import rasterize
from fabcraft.mesh import Mesh
from fabcraft.write.backdrop import backdrop, lay_floor_shadow
from fabcraft.write.camera import VIEWS, Camera, View, camera_for
from fabcraft.write.colours import OBJECT, Colour, to_bytes, to_linear, to_srgb
from fabcraft.write.normals import corner_groups, corner_normals
from fabcraft.write.shading import KEY, Surface, lit, occlusion_map, shadow_share, tone_mapped

_LAMP_PIXELS = 900


@dataclass(frozen=True, eq=False)
class Item:
    """One mesh in a picture."""

    mesh: Mesh
    colour: Colour = OBJECT
    """sRGB in [0, 1], where there are no vertex colours."""
    vertex_colours: Float64[np.ndarray, "V 3"] | None = None
    """sRGB in [0, 1] per vertex."""
    smooth: bool = True
    """Smooth but for creases; False shows every face flat."""
    gloss: float = 0.35
    """0 chalk, 1 polished."""


@dataclass(frozen=True, eq=False)
class _Scene:
    """All items in one list of triangles, with what each corner carries."""

    points: Float64[np.ndarray, "V 3"]
    faces: Int32[np.ndarray, "F 3"]
    normals: Float32[np.ndarray, "G 3"]
    corner_normal: Integer[np.ndarray, "F 3"]
    colours: Float32[np.ndarray, "V 3"]
    gloss: Float32[np.ndarray, " F"]


@dataclass(frozen=True, eq=False)
class _Samples:
    """What the camera sees: one row per covered sample."""

    covered: Bool[np.ndarray, "H W"]
    local: Float32[np.ndarray, "P 3"]
    """Position in the camera's frame, from the middle of the scene, mm."""
    surface: Surface


def scene_picture(
    items: Sequence[Item],
    view: View = VIEWS["three_quarter"],
    size: tuple[int, int] = (900, 900),
    *,
    supersample: int = 2,
    frame_on: Mesh | None = None,
    shadows: bool = True,
) -> UInt8[np.ndarray, "H W 3"]:
    """The picture (H, W, 3) sRGB of `items` on a light background.

    size : (width, height) in pixels.  frame_on : what fills the picture; everything when None.
    supersample : samples per pixel side, 2 or 3.  shadows : off for maps, whose colours should stay readable.
    """
    width, height = size
    fine = (width * supersample, height * supersample)
    items = [item for item in items if len(item.mesh.faces)]
    light = backdrop(*fine)
    if not items:
        return _finished(light, supersample)
    scene = _scene(items)
    camera = camera_for(view, scene.points[np.unique(scene.faces)], fine, frame_on)
    samples = _seen(scene, camera)
    if view.elevation_deg > 3.0:
        lay_floor_shadow(light, scene.points, scene.faces, camera, samples.covered)
    shadow = _key_shadow(scene, camera, samples) if shadows else np.ones(len(samples.local), np.float32)
    occlusion = _occlusion(camera, samples, supersample)
    if not shadows:
        occlusion = 0.5 + 0.5 * occlusion
    light[samples.covered] = tone_mapped(lit(samples.surface, shadow, occlusion))
    return _finished(light, supersample)


def png_bytes(image: UInt8[np.ndarray, "H W 3"]) -> bytes:
    """The picture as a PNG with a fixed compression and no time stamp."""
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "PNG", compress_level=6)
    return buffer.getvalue()


def _scene(items: Sequence[Item]) -> _Scene:
    """The items' triangles and attributes one after the other."""
    points, faces, normals, corner_normal, colours, gloss = [], [], [], [], [], []
    vertex_count = group_count = 0
    for item in items:
        mesh = item.mesh
        groups = corner_groups(mesh) if item.smooth else np.arange(3 * len(mesh.faces)).reshape(-1, 3)
        smooth, groups = corner_normals(mesh, groups)
        shade = np.broadcast_to(item.colour, (len(mesh.vertices), 3))
        colours.append(to_linear(shade if item.vertex_colours is None else item.vertex_colours))
        points.append(mesh.vertices)
        faces.append(mesh.faces + vertex_count)
        normals.append(smooth)
        corner_normal.append(groups + group_count)
        gloss.append(np.full(len(mesh.faces), item.gloss))
        vertex_count += len(mesh.vertices)
        group_count += len(smooth)
    return _Scene(
        np.concatenate(points),
        np.concatenate(faces).astype(np.int32),
        np.concatenate(normals).astype(np.float32),
        np.concatenate(corner_normal),
        np.concatenate(colours).astype(np.float32),
        np.concatenate(gloss).astype(np.float32),
    )


def _seen(scene: _Scene, camera: Camera) -> _Samples:
    """Rasterise, and interpolate position, normal and colour with perspective-correct weights."""
    pixels = camera.project(scene.points)
    raster = rasterize(pixels, scene.faces, camera.width, camera.height)
    covered = raster.face_id >= 0
    face = raster.face_id[covered]
    axes = camera.axes.astype(np.float32)
    a, b, c = (scene.points[scene.faces[:, corner]] for corner in range(3))
    local, normals, to_camera, colours = (np.empty((len(face), 3), np.float32) for _ in range(4))
    _interpolate(
        face,
        raster.barycentric[covered],
        (-pixels[:, 2]).astype(np.float32),
        scene.faces,
        scene.corner_normal,
        ((scene.points - camera.centre) @ camera.axes.T).astype(np.float32),
        scene.normals @ axes.T,
        scene.colours,
        np.cross(b - a, c - a).astype(np.float32) @ axes.T,
        np.float32(camera.distance_mm),
        (local, normals, to_camera, colours),
    )
    surface = Surface(normals, to_camera, normals @ axes[:, 2], colours, scene.gloss[face])
    return _Samples(covered, local, surface)


@nb.njit(cache=True, nogil=True, error_model="numpy")
@typing.no_type_check
def _interpolate(
    face, barycentric, nearness, faces, corner_normal, places, normals, colours, planes, distance, made
):
    """Fill made: place, normal, unit direction to the eye and colour (P, 3) of every sample, in the camera's frame.

    nearness (V,): the negative depth key.  planes (F, 3): towards the front of every face.
    """
    place, normal, eye, colour = made
    near = np.isfinite(distance)
    for sample in range(len(face)):
        at = face[sample]
        i, j, k = faces[at]
        u, v, w = barycentric[sample]
        if near:
            # linear in the image is 1/w; weights on the surface are b_i / w_i, normalised (key = -1 / w)
            u, v, w = u * nearness[i], v * nearness[j], w * nearness[k]
            total = u + v + w
            u, v, w = u / total, v / total, w / total
        f, g, h = corner_normal[at]
        square = away = np.float32(0.0)
        for axis in range(3):
            place[sample, axis] = u * places[i, axis] + v * places[j, axis] + w * places[k, axis]
            colour[sample, axis] = u * colours[i, axis] + v * colours[j, axis] + w * colours[k, axis]
            normal[sample, axis] = u * normals[f, axis] + v * normals[g, axis] + w * normals[h, axis]
            eye[sample, axis] = -place[sample, axis] if near else 0.0
            square += normal[sample, axis] ** 2
        eye[sample, 2] += distance if near else 1.0
        for axis in range(3):
            away += eye[sample, axis] ** 2
        eye[sample] /= np.sqrt(away)
        front = (
            planes[at, 0] * eye[sample, 0] + planes[at, 1] * eye[sample, 1] + planes[at, 2] * eye[sample, 2]
        )
        # Both sides are lit: an open sheet seen from behind shows its back. The face decides, not the smooth
        # normal, which may lean away at a silhouette.
        normal[sample] /= max(np.sqrt(square), np.float32(1e-9)) * np.float32(-1.0 if front < 0.0 else 1.0)


def _occlusion(camera: Camera, samples: _Samples, supersample: int) -> Float32[np.ndarray, " P"]:
    """Ambient light that arrives, computed on every `supersample`-th sample and spread."""
    shape = samples.covered.shape
    depth = np.full(shape, 1e6, np.float32)
    depth[samples.covered] = -samples.local[:, 2]
    normals = np.zeros((*shape, 3), np.float32)
    normals[samples.covered] = samples.surface.normals
    step = slice(None, None, supersample)
    pixel_mm = supersample / camera.scale
    radius = 0.11 * min(shape) / camera.scale
    coarse = occlusion_map(
        depth[step, step], normals[step, step], samples.covered[step, step], pixel_mm, radius
    )
    spread = np.repeat(np.repeat(coarse, supersample, 0), supersample, 1)
    return spread[: shape[0], : shape[1]][samples.covered]


def _key_shadow(scene: _Scene, camera: Camera, samples: _Samples) -> Float32[np.ndarray, " P"]:
    """Share of the key light at every sample, from an orthographic shadow map."""
    towards = np.asarray(KEY) @ camera.axes
    azimuth = np.degrees(np.arctan2(towards[0], -towards[1]))
    elevation = np.degrees(np.arcsin(np.clip(towards[2] / np.linalg.norm(towards), -1.0, 1.0)))
    lamp = camera_for(View(azimuth, elevation, 0.0, 0.01), scene.points, (_LAMP_PIXELS, _LAMP_PIXELS))
    depth = rasterize(lamp.project(scene.points), scene.faces, _LAMP_PIXELS, _LAMP_PIXELS).depth
    # The lamp is orthographic: camera frame to lamp pixels is affine, read off four points.
    frame = camera.centre + np.concatenate([np.zeros((1, 3)), camera.axes])
    origin, *steps = lamp.project(frame)
    matrix = (np.stack(steps) - origin).astype(np.float32)
    normals = samples.surface.normals
    grazing = 1.0 - np.clip(normals @ (camera.axes @ lamp.axes[2]).astype(np.float32), 0.0, 1.0)
    # Start a little off the surface, more where light grazes, so that a facet does not shadow itself.
    start = samples.local + normals * ((1.5 + 3.0 * grazing) / np.float32(lamp.scale))[:, None]
    rows, columns = np.nonzero(samples.covered)
    turn = ((rows % 4) * 4 + columns % 4).astype(np.float32) * np.float32(2 * np.pi * 5 / 16)
    bias = np.full(len(start), 4.0 / lamp.scale, np.float32)
    return shadow_share(start @ matrix + origin.astype(np.float32), depth, bias, 6.0, turn)


def _finished(light: Float[np.ndarray, "H W 3"], supersample: int) -> UInt8[np.ndarray, "H2 W2 3"]:
    """Samples averaged in linear light, then sRGB bytes."""
    height, width = light.shape[0] // supersample, light.shape[1] // supersample
    steps = range(supersample)
    samples = [light[row::supersample, column::supersample] for row in steps for column in steps]
    return to_bytes(
        to_srgb(sum(samples, np.zeros((height, width, 3), np.float32)) / np.float32(len(samples)))
    )
