"""Places on a user's own mesh for a motif and for strap slots: those of the kind it is like, where it has a wall there; or,
for a motif, the largest patch that faces a direction.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float64
from scipy.ndimage import distance_transform_edt, label

from fabcraft.geometry.heights import front_heights
from fabcraft.geometry.plane import Plane
from fabcraft.geometry.rays import Rays
from fabcraft.mesh import Mesh
from fabcraft.template.picture_space import PictureSpace
from fabcraft.template.template import MotifFrame, StrapHole, Template

_STEEP, _PATCH_PIXELS, _FULL, _RIDGE = 0.85, 160, 0.97, 0.95
"""Least cosine of a patch to the direction, pixels of the mesh's longer side, share of a box that the patch fills, depth of
its middle line over the deepest."""
_STRAP_REACH, _STRAP_RIM = 2.0, 0.5
"""How far from its place a strap slot is looked for, in its depths, and the material needed beside it, in its widths."""


def reanchored(mesh: Mesh, like: Template) -> tuple[MotifFrame, ...]:
    """The places for a motif of the built-in template, on the own mesh's outer side; those that miss it are left out."""
    found = []
    for frame in like.motifs:
        space = PictureSpace(frame)
        half = 0.5 * max(frame.size_mm)
        plane = Plane.around(np.array([[-half, -half], [half, half]]), half / 20.0, 0.0)
        heights = front_heights(space.seen(mesh), plane)
        here = float(plane.sample(np.where(np.isfinite(heights), heights, 1e6), np.zeros((1, 2)))[0])
        if frame.reading == "motif" and abs(here) < half:  # farther away it is another part of the object
            found.append(replace(frame, origin=frame.origin + here * frame.outward))
    return tuple(found)


def restrapped(mesh: Mesh, like: Template) -> tuple[StrapHole, ...]:
    """The strap slots of the built-in template, in the own mesh's wall; none where a side has no wall all round its slot."""
    rays = Rays(mesh)
    found = [_in_wall(rays, hole) for hole in like.straps]
    return tuple(hole for hole in found if hole is not None) if all(found) else ()


def _in_wall(rays: Rays, hole: StrapHole) -> StrapHole | None:
    """The hole moved along its way through to the middle of the wall that is nearest there."""
    across, reach = np.cross(hole.through, hole.along), _STRAP_REACH * hole.depth_mm
    half = 0.5 * np.array([hole.length_mm, hole.width_mm]) + _STRAP_RIM * hole.width_mm
    corners = np.array(
        [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (0.8, 0.8), (-0.8, 0.8), (0.8, -0.8), (-0.8, -0.8)]
    )
    places = hole.centre + (corners * half) @ np.stack([hole.along, across])
    ways = np.tile(hole.through, (len(places), 1))
    before, after = (rays.distances(places - side * reach * ways, side * ways) for side in (1.0, -1.0))
    thick = 2.0 * reach - before - after
    if not (np.isfinite(thick) & (thick > 0.0) & (thick < hole.depth_mm)).all():
        return None
    centre = hole.centre + (before[0] + 0.5 * thick[0] - reach) * hole.through
    return replace(hole, centre=centre, depth_mm=float(hole.depth_mm + np.ptp(before) + np.ptp(after)))


def front_frame(mesh: Mesh, ahead: Float64[np.ndarray, "3"]) -> tuple[MotifFrame, ...]:
    """The largest visible patch that faces `ahead`, as a place for a motif; none where nothing does."""
    frame = _facing(mesh.bounds.mean(0), ahead, (1.0, 1.0))
    seen = PictureSpace(frame).seen(mesh)
    plane = Plane.around(seen.vertices[:, [0, 2]], float(seen.size_mm[[0, 2]].max()) / _PATCH_PIXELS, 1.0)
    heights = front_heights(seen, plane)
    with np.errstate(invalid="ignore"):  # beside the mesh heights are infinite
        rise = np.stack(np.gradient(heights, plane.pixel_mm))
        flat = np.isfinite(heights) & (1.0 / np.sqrt(1.0 + (rise**2).sum(0)) > _STEEP)
    patches, count = label(flat)
    if not count:
        return ()
    patch = patches == 1 + int(np.argmax(np.bincount(patches.ravel())[1:]))
    deep = distance_transform_edt(np.pad(patch, 1))[1:-1, 1:-1]
    ridge = np.argwhere(deep > _RIDGE * deep.max())  # of a long patch, its middle line
    row, column = ridge[np.linalg.norm(ridge - ridge.mean(0), axis=1).argmin()]
    tall, wide = _box(patch, int(row), int(column), int(0.7 * deep[row, column]))
    around = np.s_[row - tall : row + tall + 1, column - wide : column + wide + 1]
    x, z = plane.to_mm(np.array([[column + 0.5, row + 0.5]]))[0]
    slope_up, slope_across = (float(np.nanmean(side[around][patch[around]])) for side in rise)
    normal = frame.outward - slope_across * frame.right + slope_up * frame.up  # rows count downwards
    origin = frame.origin + x * frame.right + z * frame.up + float(heights[row, column]) * frame.outward
    size = (2.0 * wide + 1.0) * plane.pixel_mm, (2.0 * tall + 1.0) * plane.pixel_mm
    return (_facing(origin, normal / np.linalg.norm(normal), size),)


def _box(patch: Bool[np.ndarray, "H W"], row: int, column: int, start: int) -> tuple[int, int]:
    """Half height and half width, pixels, of the largest box around a pixel that the patch fills."""
    half = [start, start]
    growing = [True, True]
    while any(growing):
        for side in (0, 1):
            tall, wide = half[0] + (side == 0), half[1] + (side == 1)
            inside = min(row - tall, column - wide) >= 0
            box = patch[max(row - tall, 0) : row + tall + 1, max(column - wide, 0) : column + wide + 1]
            growing[side] = growing[side] and inside and box.shape == (2 * tall + 1, 2 * wide + 1)
            growing[side] = growing[side] and bool(box.mean() >= _FULL)
            half[side] += growing[side]
    return half[0], half[1]


def _facing(
    origin: Float64[np.ndarray, "3"], outward: Float64[np.ndarray, "3"], size: tuple[float, float]
) -> MotifFrame:
    """A flat picture that faces `outward`, upright; of one that faces up or down the wearer's back is up."""
    upright = np.array([0.0, 0.0, 1.0] if abs(outward[2]) < 0.9 else [0.0, 1.0, 0.0])
    up = upright - (upright @ outward) * outward
    up = up / np.linalg.norm(up)
    return MotifFrame("front", origin, np.cross(up, outward), up, size, 0.5 * min(size))
