"""A label engraved on a hidden face: on the skin side where there is one, or under the object.

The text is laid along the surface, not projected onto it: its base line is walked over the surface in small steps, so that
inside a ring it keeps its width and depth.  A place is taken only where the surface is smooth and wide enough, and where a
ray through the wall leaves the printer's least wall under the engraving.
"""

from dataclasses import dataclass

import manifold3d
import numpy as np
from jaxtyping import Bool, Float64

from fabcraft.geometry.crossing import self_intersecting_faces
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.sampling import area_samples
from fabcraft.mesh import Mesh
from fabcraft.profile import PrinterProfile
from fabcraft.solid.letters import HIGH, checked, outline, strokes, width_mm
from fabcraft.solid.manifolds import to_manifold, to_mesh, try_manifold

HEIGHTS_MM = (8.0, 6.0, 5.0, 4.0, 3.2, 2.4, 2.0, 1.6)
"""Heights of the letters, the largest that has room is taken."""
_LEAST_STROKES = 4.0
"""A letter's height over its stroke: lower, the bars of an E run together."""
_STROKE_SHARE = 8.0
"""Large letters have a stroke of their height over this: thinner looks scratched."""
_ABOVE_MM = 0.4
"""How far the cutter reaches out of the surface."""
_PLACES, _ANGLES = 80, 18
_BEND = np.cos(np.radians(20.0))
"""Least cosine between the normals of two neighbouring rows of the text, a stroke's width or more apart."""
_TILT = np.cos(np.radians(15.0))
"""Least cosine between the normals at the text's upper and lower edge and its middle."""
_FINE_MM = 0.5
_THICK_MM, _START_MM, _STEPS = 10.0, 0.05, 40


@dataclass(frozen=True, eq=False)
class Labelled:
    """An object with its label, or why it has none."""

    mesh: Mesh
    said: str
    """Where and how large, or the reason."""
    done: bool
    height_mm: float = 0.0
    wall_mm: float = 0.0
    """Least wall left under it, measured along the normal."""


@dataclass(frozen=True, eq=False)
class _Strip:
    """Rows of the surface under text, for N places at once."""

    points: Float64[np.ndarray, "N R 3"]
    """On the base line, left to right."""
    normals: Float64[np.ndarray, "N R 3"]
    up: Float64[np.ndarray, "N R 3"]
    """Towards the top of the letters, in the surface."""
    good: Bool[np.ndarray, " N"]


def label(mesh: Mesh, text: str, profile: PrinterProfile, hidden: Bool[np.ndarray, " F"]) -> Labelled:
    """`mesh` with `text` engraved on one of its `hidden` faces; unchanged, with the reason, where none has room.

    Raises `InputError` for a text that cannot be engraved.
    """
    text = checked(text)
    depth = profile.min_engrave_mm
    need = depth + max(profile.min_wall_mm, profile.min_wall_supported_mm)
    areas = mesh.face_areas * hidden
    if not areas.sum() > 0.0:
        return Labelled(mesh, f"no label {text}: the object has no hidden face", False)
    faces, weights = area_samples(areas, _PLACES, np.random.default_rng(1))
    seeds = (weights[:, :, None] * mesh.corners[faces]).sum(1)
    surface, normals = SurfaceDistance(mesh), mesh.face_normals
    thickest, centre = 0.0, seeds.mean(0)
    for height in (one for one in HEIGHTS_MM if one >= _LEAST_STROKES * depth - 1e-9):
        stroke = max(profile.min_engrave_mm, height / _STROKE_SHARE)
        wide, high = width_mm(text, height) + 2.0 * stroke, height + 2.0 * stroke
        rows = max(int(np.ceil(wide / max(stroke, 0.8))) | 1, 5)
        starts = np.repeat(seeds, _ANGLES, axis=0), np.repeat(normals[faces], _ANGLES, axis=0)
        angles = np.tile(np.arange(_ANGLES) * np.pi / _ANGLES, len(seeds))
        strip = _walked(surface, normals, *starts, angles, wide / (rows - 1), rows)
        strip, edges = _edged(surface, normals, hidden, strip, 0.5 * high)
        wall = _walls(surface, np.concatenate([strip.points[:, :, None], edges], axis=2), strip)
        thickest = max(thickest, float(wall[strip.good].max(initial=0.0)))
        fit = strip.good & (wall >= need)
        # of the places with room the flattest, then the thickest, then the one nearest to the middle
        flat = np.einsum("nri,nri->nr", strip.normals, strip.normals[:, rows // 2][:, None]).min(1)
        away = np.linalg.norm(strip.points[:, rows // 2] - centre, axis=1)
        order = np.lexsort((away, -np.round(wall), -np.round(flat, 2)))
        for place in order[fit[order]][:6]:
            line = np.array([strip.points[place], strip.normals[place], strip.up[place]])
            made = _engraved(mesh, surface, text, height, stroke, depth, line, wide)
            if made is not None:
                at = ", ".join(f"{one:.0f}" for one in strip.points[place][rows // 2])
                said = f"label {text}, letters {height:g} mm high, {depth:g} mm deep at ({at})"
                return Labelled(made, said, True, height, float(wall[place]) - depth)
    why = (
        f"the thickest place with room for it is {thickest:.1f} mm; {need:.1f} mm are needed to keep the wall"
        if thickest
        else "no hidden face is large and smooth enough"
    )
    return Labelled(mesh, f"no label {text}: {why}", False)


def _walked(
    surface: SurfaceDistance,
    face_normals: Float64[np.ndarray, "F 3"],
    seeds: Float64[np.ndarray, "N 3"],
    normals: Float64[np.ndarray, "N 3"],
    angles: Float64[np.ndarray, " N"],
    step_mm: float,
    rows: int,
) -> _Strip:
    """Base lines through the seeds: from the middle both ways, each step along the surface, then back onto it."""
    steep = np.abs(normals[:, 2]) > 0.9
    upright = np.where(steep[:, None], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])
    right = np.cross(upright, normals)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    other = np.cross(normals, right)
    right = np.cos(angles)[:, None] * right + np.sin(angles)[:, None] * other
    points, found, ways = (np.zeros((len(seeds), rows, 3)) for _ in range(3))
    good = np.ones(len(seeds), dtype=bool)
    middle = rows // 2
    points[:, middle], found[:, middle], ways[:, middle] = seeds, normals, right
    for sign in (1, -1):
        for k in range(1, middle + 1):
            at, before = middle + sign * k, middle + sign * (k - 1)
            aimed = points[:, before] + sign * step_mm * ways[:, before]
            near = surface.closest(aimed)
            points[:, at], found[:, at] = near.points, face_normals[near.faces]
            good &= (found[:, at] * found[:, before]).sum(1) >= _BEND
            good &= near.distances <= 0.5 * step_mm
            way = ways[:, before] - (ways[:, before] * found[:, at]).sum(1)[:, None] * found[:, at]
            ways[:, at] = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    return _Strip(points, found, np.cross(found, ways), good)


def _edged(
    surface: SurfaceDistance,
    face_normals: Float64[np.ndarray, "F 3"],
    hidden: Bool[np.ndarray, " F"],
    strip: _Strip,
    half_mm: float,
) -> tuple[_Strip, Float64[np.ndarray, "N R 2 3"]]:
    """The strips that are smooth and hidden up to the letters' upper and lower edge, and the surface there."""
    sides = strip.points[:, :, None] + half_mm * np.array([1.0, -1.0])[:, None] * strip.up[:, :, None]
    near = surface.closest(sides.reshape(-1, 3))
    shape = sides.shape[:3]
    flat = (face_normals[near.faces].reshape(*shape, 3) * strip.normals[:, :, None]).sum(3) >= _TILT
    level = near.distances.reshape(shape) <= 0.2 * half_mm
    middle = surface.closest(strip.points.reshape(-1, 3)).faces.reshape(strip.points.shape[:2])
    good = strip.good & (flat & level & hidden[near.faces].reshape(shape)).all((1, 2)) & hidden[middle].all(1)
    return _Strip(strip.points, strip.normals, strip.up, good), near.points.reshape(sides.shape)


def _walls(
    surface: SurfaceDistance, points: Float64[np.ndarray, "N R 3 3"], strip: _Strip
) -> Float64[np.ndarray, " N"]:
    """The thinnest wall under each good strip, mm, up to `_THICK_MM`; 0 under the others."""
    thinnest = np.zeros(len(points))
    chosen = points[strip.good]
    if not len(chosen):
        return thinnest
    inward = -np.broadcast_to(strip.normals[strip.good][:, :, None], chosen.shape).reshape(-1, 3)
    way = _through(surface, chosen.reshape(-1, 3), inward)
    thinnest[strip.good] = way.reshape(len(chosen), -1).min(1)
    return thinnest


def _through(
    surface: SurfaceDistance, points: Float64[np.ndarray, "N 3"], inward: Float64[np.ndarray, "N 3"]
) -> Float64[np.ndarray, " N"]:
    """Way from points of the surface along `inward` to the other side, mm: sphere tracing (Hart 1996)."""
    way = np.full(len(points), _START_MM)
    going = np.arange(len(points))
    for _ in range(_STEPS):
        free = surface.closest(points[going] + way[going, None] * inward[going]).distances
        way[going] += free
        going = going[(free > 1e-3) & (way[going] < _THICK_MM)]
        if not len(going):
            break
    return np.minimum(way, _THICK_MM)


def _engraved(
    mesh: Mesh,
    surface: SurfaceDistance,
    text: str,
    height: float,
    stroke: float,
    depth: float,
    line: Float64[np.ndarray, "3 R 3"],
    wide: float,
) -> Mesh | None:
    """The text cut along the base line (points, normals, up); None where the result is no sound manifold."""
    flat = outline(strokes(text, height), stroke)
    tool = manifold3d.Manifold.extrude(flat, depth + _ABOVE_MM).translate((0.0, 0.0, -depth))
    tool = tool.refine_to_length(max(_FINE_MM, height / 2.0 / HIGH))
    along = np.linspace(-0.5 * wide, 0.5 * wide, line.shape[1])

    def laid(vertices: Float64[np.ndarray, "V 3"]) -> Float64[np.ndarray, "V 3"]:
        on, normal, up = (
            np.column_stack([np.interp(vertices[:, 0], along, line[k, :, axis]) for axis in range(3)])
            for k in range(3)
        )
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        foot = surface.closest(on + vertices[:, 1:2] * up).points
        return foot + vertices[:, 2:] * normal

    cutter = tool.warp_batch(laid)
    solid = to_manifold(mesh)
    if cutter.status() != manifold3d.Error.NoError or cutter.is_empty():
        return None
    made = to_mesh((solid - cutter).simplify(0.002), mesh.name)
    whole = try_manifold(made)
    taken = 0.0 if whole is None else solid.volume() - whole.volume()
    wanted = flat.area() * depth
    if whole is None or not 0.6 * wanted <= taken <= 1.4 * wanted or len(self_intersecting_faces(made)):
        return None
    return made
