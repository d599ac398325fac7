"""A guidance mesh freed of what is not the object: doubled faces, a floor plate, pieces apart, needless triangles.

An image-to-3D model hands over a surface that is open, in thousands of pieces, on a plate and with crumbs around it.  It
need not become a solid: it is only looked at and measured.  What belongs together is told by nearness rather than by
shared edges, so that a mesh of unconnected triangles stays whole.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy.ndimage import label
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fabcraft.errors import InputError
from fabcraft.geometry.sampling import area_samples
from fabcraft.mesh import Mesh
from fabcraft.read.mesh_file import merged

MOST_FACES = 120_000
"""A finer mesh is simplified to this: its triangles are then about as large as a nozzle's bead is wide."""
_WELD = 1e-6  # of the size
_CELLS = 60
"""Pieces apart by more than about a cell, the size over this, are not one object."""
_RIVAL = 0.5
"""A piece apart with that share of the largest one's area belongs to the object, or nobody can say which one is it."""
_SAMPLES = 30_000
_MOST_PLATES = 40  # so many of the largest pieces can be a floor
_FLAT, _BROAD, _BESIDE = 0.04, 0.25, 0.97
"""A plate's thickness over its length, its width over that of the rest, and how much of the rest is on one side."""


@dataclass(frozen=True, eq=False)
class Cleaned:
    """What is left of a guidance mesh."""

    mesh: Mesh
    notes: tuple[str, ...]
    """What was left out, in sentences."""


def cleaned(mesh: Mesh, single: bool = False) -> Cleaned:
    """`mesh` without what is not the object; in its own scale and axes.

    single : of several objects only the largest is kept, as of a pair of slippers.
    Raises `InputError` for a mesh without a surface.
    """
    mesh = _proper(mesh)
    notes: list[str] = []
    count, area = len(mesh.faces), mesh.area_mm2
    mesh, apart = _together(mesh, single)
    plate = _plate(mesh)
    if plate.any():
        notes.append(
            f"A flat plate was left out ({100.0 * mesh.face_areas[plate].sum() / area:.0f} % of the area)."
        )
        mesh, more = _together(mesh.submesh(~plate), single)  # what stood on it
        apart = (apart[0] + more[0], apart[1] + more[1])
    if apart[0]:
        one = apart[0] == 1
        notes.append(
            f"{apart[0]} {'piece that stands' if one else 'pieces that stand'} apart {'was' if one else 'were'} "
            f"left out ({100.0 * apart[1] / area:.1f} % of the area)."
        )
    if len(mesh.faces) > MOST_FACES:
        mesh = simplified(mesh, MOST_FACES)
        notes.append(f"It was simplified from {count:,} to {len(mesh.faces):,} faces.")
    return Cleaned(mesh, tuple(notes))


def _proper(mesh: Mesh) -> Mesh:
    """The mesh with near vertices welded, and every face with an area once."""
    if len(mesh.faces) == 0:
        raise InputError(
            "the guidance mesh has no faces", "Check that the file holds a surface and not only points."
        )
    size = float(mesh.submesh(np.ones(len(mesh.faces), dtype=bool)).size_mm.max())
    if not size > 0.0:
        raise InputError("the guidance mesh has no surface", "Give a mesh with faces.")
    vertices, faces = merged(np.round(mesh.vertices / (_WELD * size)) * (_WELD * size), mesh.faces)
    keys = np.ascontiguousarray(np.sort(faces, axis=1)).view("V12").ravel()
    _, once = np.unique(keys, return_index=True)
    welded = Mesh(vertices, faces[np.sort(once)], mesh.name)
    solid = welded.face_areas > (1e-3 * _WELD * size) * size
    if not solid.any():
        raise InputError("the guidance mesh has no surface", "Give a mesh with faces.")
    return welded.submesh(solid)


def _plate(mesh: Mesh) -> Bool[np.ndarray, " F"]:
    """The faces of a flat piece, square to an axis of the file, with all the rest on one side of it: a floor, a wall."""
    faces = mesh.faces
    count = len(mesh.vertices)
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    piece_of = connected_components(
        coo_array((np.ones(len(ends), dtype=np.int8), ends.T), shape=(count, count)), directed=False
    )[1]
    piece = piece_of[faces[:, 0]]
    areas = np.bincount(piece, mesh.face_areas)
    found, whole = np.zeros(len(faces), dtype=bool), float(areas.sum())
    for index in np.argsort(-areas, kind="stable")[:_MOST_PLATES]:
        own = piece == index
        if areas[index] > 0.5 * whole or own.all():
            continue
        low, high = mesh.corners[own].min((0, 1)), mesh.corners[own].max((0, 1))
        thin = int((high - low).argmin())
        others = mesh.corners[~own & ~found].mean(1)
        rest = np.delete(others.max(0) - others.min(0), thin).max()
        across = np.delete(high - low, thin)
        if high[thin] - low[thin] > _FLAT * across.max() or across.min() < _BROAD * rest:
            continue
        weights, middle = mesh.face_areas[~own & ~found], 0.5 * (low[thin] + high[thin])
        above = float(weights[others[:, thin] > middle].sum() / weights.sum())
        if max(above, 1.0 - above) > _BESIDE:
            found |= own
    return found


def _together(mesh: Mesh, single: bool) -> tuple[Mesh, tuple[int, float]]:
    """(the objects that are kept, (number, area) of the groups of pieces that are not)."""
    chosen, weights = area_samples(mesh.face_areas, _SAMPLES, np.random.default_rng(0))
    points = (weights[:, :, None] * mesh.corners[chosen]).sum(1)
    cell = float(np.ptp(np.quantile(points, (0.02, 0.98), axis=0), axis=0).max()) / _CELLS
    # a face far away must not make the grid endless: what is that far apart is alone in any case
    middle = np.median(points, axis=0)

    def cells(points: Float64[np.ndarray, "N 3"]) -> Int[np.ndarray, "N 3"]:
        return np.clip(np.floor((points - middle) / cell), -_CELLS, _CELLS).astype(np.int64) + _CELLS

    grid = np.zeros((2 * _CELLS + 1,) * 3, dtype=bool)
    grid[tuple(cells(points).T)] = True
    grid[tuple(cells(mesh.vertices).T)] = True
    grid[tuple(cells(mesh.corners.mean(1)).T)] = True
    group_of, _ = label(grid, np.ones((3, 3, 3)))
    corner_groups = group_of[tuple(cells(mesh.vertices).T)][mesh.faces]
    groups = corner_groups.max(1)
    areas = np.bincount(groups, mesh.face_areas)
    kept = areas == areas.max() if single else areas >= _RIVAL * areas.max()
    if kept[groups].all():
        return mesh, (0, 0.0)
    return mesh.submesh(kept[groups]), (int((areas[~kept] > 0.0).sum()), float(areas[~kept].sum()))


def simplified(mesh: Mesh, at_most: int) -> Mesh:
    """A coarser mesh of about `at_most` faces, or the mesh itself; not sound, only to be looked at."""
    if len(mesh.faces) <= at_most:
        return mesh
    import fast_simplification

    vertices, faces = fast_simplification.simplify(
        np.array(mesh.vertices), np.array(mesh.faces), target_count=at_most
    )
    return Mesh(vertices.astype(np.float64), faces.astype(np.int32), mesh.name)
