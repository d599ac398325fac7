"""A thick object hollowed: a wall is kept all round, and every cavity drains through two holes at its low points.

The cavity is the set of points deeper than the wall, opened by a ball (Serra 1982): what is too narrow to drain stays
solid, and its inside is round.  Made on a grid from the exact distance to the surface, so that the wall is kept.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import manifold3d
import numpy as np
from jaxtyping import Bool, Float64

from fabcraft.errors import InputError, SolidError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.edges import split_edges
from fabcraft.geometry.voxels import Grid, isosurface, narrow_band, samples
from fabcraft.mesh import Mesh
from fabcraft.solid.manifolds import to_manifold, to_mesh

WALL_MM = 2.0
"""Wall of a hollow part unless another is asked, or the printer's own is more: judgement, usual for resin."""
HOLE_MM = 3.5
"""Drain hole where the profile names none (filament): the resin and powder profiles' most common one."""
LEAST_CAVITY_MM3 = 1000.0
"""Less is not worth two holes: judgement."""
HOLES = 2
_CHORD_MM = 0.06
_MOST_NODES = 40e6
_BAND = 1.8
_TRIES = 4
_LOW_SHARE = 0.25
"""Holes are looked for in the lowest quarter of a cavity first."""
_SEGMENTS = 32

Clean = Callable[[Float64[np.ndarray, "N 3"]], Bool[np.ndarray, " N"]]
"""Whether points of the surface lie on the side that is to be kept clean."""


@dataclass(frozen=True, eq=False)
class Hollowed:
    """A hollowed object."""

    mesh: Mesh
    """As it was where nothing could be hollowed."""
    cavities: int
    holes: tuple[tuple[float, float, float], ...]
    """Where the drain holes come out, mm."""
    numbers: Mapping[str, float] = field(default_factory=dict)
    """Measured: hollow_wall_mm (the least), hollow_saved_mm3, drain_hole_mm."""


def hollow(mesh: Mesh, wall_mm: float, hole_mm: float, clean: Clean | None = None) -> Hollowed:
    """The closed `mesh` as it lies (z up) with its inside taken out, at least `wall_mm` of wall kept.

    hole_mm : diameter of the two drain holes of every cavity.  clean : where holes should not come out.
    Raises `InputError` for a wall or hole that is none, `SolidError` when a cavity cannot be drained.
    """
    for name, value in (("wall", wall_mm), ("drain hole", hole_mm)):
        if not 0.2 <= value <= 50.0:
            raise InputError(f"a {name} of {value:g} mm was asked to hollow with", "Give 0.2 to 50 mm.")
    surface = SurfaceDistance(mesh)
    cavities, least = _walled(mesh, surface, wall_mm, 0.75 * hole_mm)
    if not cavities:
        return Hollowed(mesh, 0, ())
    solid = to_manifold(mesh)
    holes: list[tuple[float, float, float]] = []
    for cavity in cavities:
        solid = solid - to_manifold(cavity)
        for other in _drills(cavity, surface, hole_mm, clean):
            solid = solid - other.cutter
            holes.append(other.place)
    if any(shell.volume() < 0.0 for shell in solid.decompose()):
        raise SolidError("a cavity is left without a way out", "Leave out --hollow, or give another wall.")
    made = to_mesh(solid, mesh.name)
    numbers = {
        "hollow_wall_mm": least,
        "hollow_saved_mm3": mesh.volume_mm3 - made.volume_mm3,
        "drain_hole_mm": hole_mm,
    }
    return Hollowed(made, len(cavities), tuple(holes), numbers)


def _walled(mesh: Mesh, surface: SurfaceDistance, wall_mm: float, ball_mm: float) -> tuple[list[Mesh], float]:
    """The cavities and the least wall around them, measured; what the grid took from it is given back."""
    spare = _CHORD_MM
    for _ in range(_TRIES):
        cavities = _cavities(mesh, surface, wall_mm + spare, ball_mm)
        if not cavities:
            return [], np.inf
        inner = np.concatenate([split_edges(one, 1.0).vertices for one in cavities])
        least = float(surface.closest(inner).distances.min())
        if least >= wall_mm:
            return cavities, least
        spare += wall_mm - least + _CHORD_MM
    raise SolidError(f"a wall of {wall_mm:g} mm could not be kept", "Give a thicker wall (--hollow-wall).")


def _cavities(mesh: Mesh, surface: SurfaceDistance, wall_mm: float, ball_mm: float) -> list[Mesh]:
    """What can be taken out, the largest first: all that balls of radius `ball_mm` reach inside the wall."""
    room = float(np.prod(mesh.size_mm + 4.0))
    cell = max(wall_mm / 3.0, ball_mm / 3.0, (room / _MOST_NODES) ** (1 / 3))
    depth = wall_mm + ball_mm
    middle = _level(mesh, lambda points: surface.signed(points) + depth, mesh.face_normals, -depth, cell)
    if middle is None:
        return []
    kernel = SurfaceDistance(middle)
    grown = _level(middle, lambda points: kernel.signed(points) - ball_mm, middle.face_normals, ball_mm, cell)
    assert grown is not None
    shells = [one.simplify(_CHORD_MM / 2) for one in to_manifold(grown).decompose()]
    # a cavity around an island of solid has a shell inside its own: they belong together and are cut as one
    if any(shell.volume() < 0.0 for shell in shells):
        shells = [to_manifold(grown).simplify(_CHORD_MM / 2)]
    worth = [shell for shell in shells if shell.volume() >= LEAST_CAVITY_MM3]
    return [to_mesh(shell) for shell in sorted(worth, key=lambda shell: -shell.volume())]


def _level(
    mesh: Mesh,
    field: Callable[[Float64[np.ndarray, "N 3"]], Float64[np.ndarray, " N"]],
    normals: Float64[np.ndarray, "F 3"],
    offset_mm: float,
    cell_mm: float,
) -> Mesh | None:
    """The surface where `field` is zero, which lies about `offset_mm` outside `mesh`; None where there is none."""
    grid = Grid.around(mesh.bounds, cell_mm, max(offset_mm, 0.0) + 2 * cell_mm)
    marked = np.zeros(grid.shape, bool)
    even = split_edges(mesh, 5.0)
    points, owners = samples(even.corners, cell_mm)
    grid.near(points + offset_mm * even.face_normals[owners], _BAND * cell_mm, marked)
    volume = narrow_band(grid, marked, field)
    return isosurface(grid, volume) if (volume < 0).any() else None


@dataclass(frozen=True, eq=False)
class _Drill:
    """One drain hole."""

    cutter: manifold3d.Manifold
    place: tuple[float, float, float]


def _drills(cavity: Mesh, surface: SurfaceDistance, hole_mm: float, clean: Clean | None) -> list[_Drill]:
    """Two holes from the cavity to the outside: at its lowest place, and as far from that as low places go."""
    points = np.unique(split_edges(cavity, 2.0).vertices, axis=0)
    found = surface.closest(points)
    through = found.distances < 2.5 * np.percentile(found.distances, 10.0)
    hidden = np.zeros(len(points), dtype=bool) if clean is None else clean(found.points)
    lowest, height = points[:, 2].min(), max(float(np.ptp(points[:, 2])), 1e-9)
    for allowed in (through & ~hidden, through, np.ones(len(points), dtype=bool)):
        if allowed.any():
            break
    rise = np.where(allowed, (points[:, 2] - lowest) / height, np.inf)
    first = int(np.argmin(rise))
    away = np.linalg.norm(points - points[first], axis=1)
    low = rise <= max(_LOW_SHARE, float(rise[first]) + 0.05)
    if away[low].max() < 2.0 * hole_mm:
        low = np.isfinite(rise)
    second = int(np.argmax(np.where(low, away, -1.0)))
    chosen = [first, second] if away[second] >= 1.5 * hole_mm else [first]
    return [_drill(points[one], found.points[one], hole_mm) for one in chosen]


def _drill(inner: Float64[np.ndarray, "3"], outer: Float64[np.ndarray, "3"], hole_mm: float) -> _Drill:
    """A round hole along the shortest way through the wall, begun inside the cavity."""
    way = outer - inner
    length = float(np.linalg.norm(way))
    along = way / length
    across = np.linalg.svd(along[None])[2][1:]
    if np.linalg.det(np.stack([*across, along])) < 0.0:
        across = across[::-1]
    inside, beyond = 0.75 * hole_mm, 0.5 * hole_mm
    rod = manifold3d.Manifold.cylinder(inside + length + beyond, 0.5 * hole_mm, 0.5 * hole_mm, _SEGMENTS)
    place = np.column_stack([across[0], across[1], along, inner - inside * along])
    return _Drill(rod.transform(place), (float(outer[0]), float(outer[1]), float(outer[2])))
