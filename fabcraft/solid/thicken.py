"""From a surface to an object: closed, manifold, as thick as the wall asks, clear of the body.

1. clean the surface, 2. take it apart into solids and sheets, 3. find where solids are too thin, 4. make
a medial surface of thin spots and sheets, 5. push it clear of the body, 6. evaluate the field of the
wall near its surface, 7. marching cubes, union with the untouched solids, simplify, drop specks, 8.
verify.

Only sheets and thin spots are made anew. A solid that is thick enough, clear of the body and sound
passes through exactly, with all its detail; one that crosses itself or has gaps is rebuilt from its
winding number.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import manifold3d
import numpy as np
from scipy.spatial import cKDTree

from fabcraft.errors import InputError, SolidError
from fabcraft.geometry.crossing import self_intersecting_faces
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.edges import split_edges
from fabcraft.geometry.voxels import BAND_CELLS, Grid, isosurface, narrow_band, samples
from fabcraft.mesh import Mesh
from fabcraft.solid.carve import carve, clearance_min_mm
from fabcraft.solid.manifolds import part_count, to_manifold, to_mesh, try_manifold, union, without_specks
from fabcraft.solid.patches import Kind, Piece, inward_thickness, pieces, touching
from fabcraft.solid.repair import clean, repair
from fabcraft.solid.sheet import KeepOut, PerPoint, SheetSide, WallField, make_sheet, wall_band
from fabcraft.solid.simplify import simplify_manifold
from fabcraft.solid.thin import ThinSpots, thin_spots

_MOST_NODES = 120e6
_FINEST_MM = 0.05
_PATIENCE, _COARSER = 200_000, 0.5
"""Above so many cells over a surface they grow, to that share of the wall: a flat wall comes out as exact, a rim rounder."""
_CHORD_MM = 0.03
_REFINED_MM = 4.0
_ROD = 0.75
"""Twice the volume over area times thickness, below which a solid is a rod: 0.5 for one, 1 for a sheet."""


@dataclass(frozen=True)
class SolidSettings:
    """How a surface becomes an object."""

    wall_mm: float = 1.2
    """Thickness of the wall given to sheets, and least thickness of solids."""
    clearance_mm: float = 0.5
    """Distance kept from the body, when there is one."""
    cell_mm: float | None = None
    """Side of a grid cell; a third of the wall unless given, more for large surfaces and where the grid would not fit in
    memory."""
    simplify_mm: float = 0.02
    """How far the surface may move when triangles are merged; 0 keeps every triangle."""
    minimum_part_mm3: float | None = None
    """Bodies and voids below this volume are dropped; a ball of 0.9 times the wall unless given."""

    def __post_init__(self) -> None:
        if not 0 < self.wall_mm < 100:
            raise InputError(f"the wall is {self.wall_mm} mm; expected 0 to 100", "Give millimetres.")
        if self.clearance_mm < 0 or self.simplify_mm < 0 or (self.minimum_part_mm3 or 0) < 0:
            raise InputError("clearance, simplify and minimum part must not be negative", "Give 0 or more.")
        if self.cell_mm is not None and not _FINEST_MM <= self.cell_mm <= 0.5 * self.wall_mm:
            raise InputError(
                f"cells of {self.cell_mm:g} mm cannot show a wall of {self.wall_mm:g} mm",
                f"Give {_FINEST_MM} to {0.5 * self.wall_mm:g} mm, or leave it out.",
            )

    @property
    def speck_mm3(self) -> float:
        """Volume below which a body is dropped, mm³."""
        if self.minimum_part_mm3 is not None:
            return self.minimum_part_mm3
        return 4 / 3 * np.pi * (0.45 * self.wall_mm) ** 3

    def cell_for(self, bounds: np.ndarray, area_mm2: float = 0.0) -> float:
        """The cell for an object of these bounds and surface, mm.  Raises `SolidError` when none shows the wall."""
        if self.cell_mm is not None:
            return self.cell_mm
        finest = self._finest_for(bounds)
        patient = min(float(np.sqrt(area_mm2 / _PATIENCE)), self.wall_mm * _COARSER)
        cell = max(self.wall_mm / 3, patient, finest)
        if cell > 0.5 * self.wall_mm:
            size = " x ".join(f"{side:.0f}" for side in bounds[1] - bounds[0])
            raise SolidError(
                f"a wall of {self.wall_mm:g} mm is too fine for an object of {size} mm",
                f"Use a wall of {2 * cell:.1f} mm or more, or check the unit of the input.",
            )
        return cell

    def finer(self, cell_mm: float, bounds: np.ndarray) -> float:
        """Half the cell, as far as the grid then fits in memory."""
        return min(cell_mm, max(0.5 * cell_mm, self._finest_for(bounds)))

    def _finest_for(self, bounds: np.ndarray) -> float:
        room = np.prod(bounds[1] - bounds[0] + 4 * self.wall_mm)
        return max(float((room / _MOST_NODES) ** (1 / 3)), _FINEST_MM)


@dataclass(frozen=True, eq=False)
class SolidResult:
    """A closed manifold and how it came about."""

    mesh: Mesh
    notes: tuple[str, ...]
    """What a user should know, in sentences."""
    numbers: Mapping[str, float] = field(default_factory=dict)
    """Measured: parts, genus, volume_mm3, self_intersections, cell_mm, simplify_mm, sheets, solids, specks,
    pushed_mm, thin_area_mm2, and with a body clearance_slack_mm (least distance less the clearance)."""


def solidify(
    surface: Mesh,
    settings: SolidSettings,
    body: SurfaceDistance | None = None,
    side: SheetSide | None = None,
    clearance_mm: float | PerPoint | None = None,
) -> SolidResult:
    """The surface as an object of at least the wall's thickness, at the clearance from the body.

    side : material added to the sheets on one side, by place (a designed sheet: it is cleaned, not repaired).
    clearance_mm : instead of the settings' clearance, a number or a function of points (N, 3) to (N,) mm.
    Raises `SolidError` when no closed manifold comes out, `InputError` for settings out of range.
    """
    cleaned = clean(surface) if side else repair(surface)
    keep = _keep_out(settings, body, clearance_mm)
    work = _Work(
        settings, settings.cell_for(cleaned.mesh.bounds, cleaned.mesh.area_mm2), keep, side or SheetSide()
    )
    parts = pieces(cleaned.mesh, settings.wall_mm)
    made = [work.sheet(piece.mesh) if piece.kind is Kind.SHEET else work.solid(piece) for piece in parts]
    kept = [solid for solid in made if solid is not None]
    if not kept:
        raise SolidError(
            f"nothing of {surface.name or 'the surface'} is left as a solid",
            "The body fills it, or it encloses no volume; check the input and its place on the body.",
        )
    whole, specks = without_specks(union(kept), settings.speck_mm3)
    mesh, tolerance = simplify_manifold(whole, settings.simplify_mm, surface.name)
    notes = [*cleaned.notes, *work.notes]
    if specks:
        notes.append(f"{specks} bodies or voids below {settings.speck_mm3:.2g} mm³ dropped")
    numbers = {
        **work.numbers,
        "sheets": float(sum(piece.kind is Kind.SHEET for piece in parts)),
        "solids": float(sum(piece.kind is not Kind.SHEET for piece in parts)),
        "specks": float(specks),
        "simplify_mm": tolerance,
    }
    return SolidResult(mesh, tuple(notes), numbers | _verified(mesh, keep, settings.simplify_mm + _CHORD_MM))


def _keep_out(
    settings: SolidSettings, body: SurfaceDistance | None, clearance_mm: float | PerPoint | None
) -> KeepOut | None:
    """The body with its clearance, enlarged by what simplification and the chords of the grid may take from it."""
    if body is None:
        return None
    wanted = settings.clearance_mm if clearance_mm is None else clearance_mm
    spare = settings.simplify_mm + _CHORD_MM
    if callable(wanted):
        return KeepOut(body, lambda points: wanted(points) + spare)
    return KeepOut(body, lambda points: np.full(len(points), wanted + spare))


def _verified(mesh: Mesh, keep: KeepOut | None, spare_mm: float) -> dict[str, float]:
    """What holds of the result, measured on it.  Raises `SolidError` when it is not a closed manifold."""
    solid = to_manifold(mesh)
    numbers = {
        "parts": float(part_count(solid)),
        "genus": float(sum(body.genus() for body in solid.decompose())),
        "volume_mm3": mesh.volume_mm3,
        "self_intersections": float(len(self_intersecting_faces(mesh))),
    }
    if keep is not None:
        numbers["clearance_slack_mm"] = clearance_min_mm(mesh, keep) + spare_mm
    return numbers


def _is_rod(solid: Mesh) -> bool:
    """Whether a solid is as thin across as it is through: its volume is A t / 4, a sheet's is A t / 2."""
    through = inward_thickness(solid, solid.corners.mean(1), solid.face_normals)
    areas = np.where(np.isfinite(through), solid.face_areas, 0.0)
    return bool(2.0 * solid.volume_mm3 < _ROD * float(areas @ np.where(areas > 0.0, through, 0.0)))


class _Work:
    """One run: its settings, and the notes and numbers that come up on the way."""

    def __init__(
        self, settings: SolidSettings, cell_mm: float, keep: KeepOut | None, side: SheetSide
    ) -> None:
        self.settings, self.cell_mm, self.keep, self.side = settings, cell_mm, keep, side
        self.notes: list[str] = []
        self.numbers: dict[str, float] = {"cell_mm": cell_mm, "pushed_mm": 0.0, "thin_area_mm2": 0.0}

    def sheet(self, surface: Mesh) -> manifold3d.Manifold | None:
        """A wall around a sheet."""
        return self._wall(surface, self.side)

    def solid(self, piece: Piece) -> manifold3d.Manifold | None:
        """A solid made sound, carved clear of the body, thickened where it is thin."""
        exact = try_manifold(piece.mesh) if piece.kind is Kind.SOLID else None
        if exact is not None and touching(piece.mesh):
            exact = union(exact.decompose())
        sound = exact is not None and len(self_intersecting_faces(piece.mesh)) == 0
        solid = exact if sound else self._rebuilt(piece.mesh)
        assert solid is not None
        carved = self.keep is not None and clearance_min_mm(to_mesh(solid), self.keep) < 0
        if carved and self.keep is not None:
            solid = carve(solid, self.keep, self.cell_mm)
            self.notes.append("material nearer to the body than the clearance was carved away")
            if solid.is_empty():
                return None
        thin = self._thin(to_mesh(solid)) if sound or carved else None
        if thin is None:
            return solid
        thick = self._wall(thin.medial, SheetSide(), rod=_is_rod(to_mesh(solid)))
        if thick is None:
            return solid
        if thin.firm is None:
            return thick
        # Short edges first, or the union fans long slivers from the seam to the far corners of flat sides.
        return union([solid.refine_to_length(_REFINED_MM), thick])

    def _thin(self, mesh: Mesh) -> ThinSpots | None:
        """What is thinner than the wall, and a note of it."""
        thin = thin_spots(mesh, self.settings.wall_mm)
        if thin is not None:
            self.numbers["thin_area_mm2"] += thin.area_mm2
            self.notes.append(f"{thin.area_mm2:.0f} mm² thinner than {self.settings.wall_mm:g} mm thickened")
        return thin

    def _rebuilt(self, surface: Mesh) -> manifold3d.Manifold:
        """The inside by winding number, and the wall of its thin spots, in one field.

        One field, because a wall thinner than a cell, made first, would come out of the grid in rags.  Where all around
        is thin the wall holds all of the inside, and nobody has to ask for it.
        """
        self.notes.append("a part with gaps or faces through each other was rebuilt on the grid")
        half = 0.5 * self.settings.wall_mm
        thin = self._thin(surface)
        sheet = None if thin is None else make_sheet(thin.medial, half, self.keep)
        wall = None if sheet is None else WallField(sheet, half, SheetSide(), self.keep)
        inside = SurfaceDistance(surface)
        firm = None
        if thin is not None and thin.firm is not None:
            firm = cKDTree(samples(thin.firm.corners, self.cell_mm)[0], balanced_tree=False)
        reach = self.settings.wall_mm + 3.0 * self.cell_mm

        def holds(points: np.ndarray) -> np.ndarray:
            # where one side of a wall has gone through the other it is inside out, and no less material
            return np.abs(inside.winding(points)) > 0.5

        def signed(points: np.ndarray) -> np.ndarray:
            return np.where(holds(points), -1.0, 1.0) * inside.closest(points).distances

        def field(points: np.ndarray) -> np.ndarray:
            if wall is None:
                return signed(points)
            value = wall(points)
            if firm is not None:
                near = np.isfinite(firm.query(points, distance_upper_bound=reach, workers=2)[0])
                value[near] = np.minimum(value[near], signed(points[near]))
                # where skins cross, what is thick may pass for thin: what the wall leaves out is asked for its side
                left = np.flatnonzero(~near & (value > 0.0))
                left = left[holds(points[left])]
                value[left] = -inside.closest(points[left]).distances
            return value

        bounds = (
            surface.bounds
            if sheet is None
            else np.stack(
                [
                    np.minimum(surface.bounds[0], sheet.mesh.bounds[0] - half),
                    np.maximum(surface.bounds[1], sheet.mesh.bounds[1] + half),
                ]
            )
        )
        grid = Grid.around(bounds, self.cell_mm, 2 * self.cell_mm)
        marked = np.zeros(grid.shape, bool)
        # Long slivers first cut short: samples are even along the longest edge of a face.
        points = samples(split_edges(surface, 5.0).corners, self.cell_mm)[0]
        grid.near(points, BAND_CELLS * self.cell_mm, marked)
        if sheet is not None:
            points = samples(sheet.mesh.corners, self.cell_mm)[0]
            grid.near(points, half + BAND_CELLS * self.cell_mm, marked)
        return to_manifold(isosurface(grid, narrow_band(grid, marked, field), surface.name))

    def _wall(self, surface: Mesh, side: SheetSide, rod: bool = False) -> manifold3d.Manifold | None:
        """The wall around a surface.  rod : round a line it bends so much that chords and simplifying would make it thin."""
        half, cell = 0.5 * self.settings.wall_mm, self.cell_mm
        if rod:
            cell = self.settings.finer(cell, surface.bounds)
            half += self.settings.simplify_mm + cell**2 / (8.0 * half)
        sheet = make_sheet(surface, half, self.keep)
        self.numbers["pushed_mm"] = max(self.numbers["pushed_mm"], sheet.pushed_mm)
        grid, marked = wall_band(sheet, half, side, cell)
        volume = narrow_band(grid, marked, WallField(sheet, half, side, self.keep))
        if not (volume < 0).any():
            return None
        return to_manifold(isosurface(grid, volume, surface.name))
