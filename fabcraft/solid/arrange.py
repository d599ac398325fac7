"""Several parts on the plate: laid side by side by their shadows, a gap between them, the whole in the middle of the bed.

Bottom-left packing on a raster (Jakobs 1996): the largest shadow first, each where it comes lowest, then farthest left, in
one of four turns.  What does not fit on a plate any more goes onto the next one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from scipy.ndimage import distance_transform_edt
from scipy.signal import fftconvolve

from fabcraft.geometry.raster import silhouette_mask
from fabcraft.mesh import Mesh
from fabcraft.profile import PrinterProfile

GAP_MM = 5.0
"""Between parts: room for brims and supports, judgement (PrusaSlicer arranges at 6 mm)."""
PLATE_GAP_MM = 30.0
"""Between the plates in a file that holds several."""
_PIXEL_MM = 1.0
_TURNS = (0.0, 90.0, 45.0, 135.0)
_TRIED = ((0, 1, 2, 3), (0,), (1,), (2,), (3,))


@dataclass(frozen=True, eq=False)
class Arranged:
    """Parts in their places, mm: the first plate's in the build volume, further plates to the right of it."""

    meshes: tuple[Mesh, ...]
    """In the order given."""
    plates: tuple[int, ...]
    """The plate that each lies on, from 0."""

    @property
    def count(self) -> int:
        """Number of plates."""
        return max(self.plates) + 1


def arrange(meshes: Sequence[Mesh], profile: PrinterProfile, gap_mm: float = GAP_MM) -> Arranged:
    """The meshes, each as it stands, on as few plates as the packing finds; one too large has a plate of its own."""
    width, depth = (int(side // _PIXEL_MM) for side in profile.build_mm[:2])
    shadows = [[_shadow(_turned(mesh, turn), 0.5 * gap_mm) for turn in _TURNS] for mesh in meshes]
    # the greedy choice of a turn can block the bed: packings with fewer turns are tried as well
    tried = [_packed(shadows, (depth, width), gap_mm, turns) for turns in _TRIED]
    places = min(tried, key=lambda found: max(place[0] for place in found))
    placed = [_at(meshes[one], *places[one][1:]) for one in range(len(meshes))]
    plates = tuple(places[one][0] for one in range(len(meshes)))
    return Arranged(tuple(_centred(placed, plates, profile)), plates)


def _packed(
    shadows: Sequence[Sequence[Bool[np.ndarray, "_ _"]]],
    bed: tuple[int, int],
    gap_mm: float,
    turns: tuple[int, ...],
) -> list[tuple[int, int, int, float]]:
    """(plate, row, column, turn in degrees) of every part, with only these of `_TURNS`."""
    order = sorted(range(len(shadows)), key=lambda one: (-int(shadows[one][0].sum()), one))
    # half a gap is grown all round a shadow: at the edge of the bed that half is not needed
    edge = int(np.ceil(0.5 * gap_mm / _PIXEL_MM)) + 1
    taken: list[Bool[np.ndarray, "_ _"]] = []
    places = [(0, 0, 0, 0.0)] * len(shadows)
    for one in order:
        found = None
        for plate in range(len(taken) + 1):
            if plate == len(taken):
                taken.append(np.zeros((bed[0] + 2 * edge, bed[1] + 2 * edge), dtype=bool))
            found = _lowest(taken[plate], [shadows[one][turn] for turn in turns])
            if found is not None or not taken[plate].any():
                break
        if found is None:  # larger than the bed: nothing shares its plate
            taken[plate][:] = True
            places[one] = (plate, 0, 0, 0.0)
            continue
        row, column, which = found
        shadow = shadows[one][turns[which]]
        taken[plate][row : row + shadow.shape[0], column : column + shadow.shape[1]] |= shadow
        places[one] = (plate, row, column, _TURNS[turns[which]])
    return places


def _turned(mesh: Mesh, degrees: float) -> Mesh:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return mesh.with_vertices(mesh.vertices @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))


def _shadow(mesh: Mesh, grown_mm: float) -> Bool[np.ndarray, "H W"]:
    """Pixels within `grown_mm` of the mesh seen from above, its lower left corner at the grown margin."""
    margin = int(np.ceil(grown_mm / _PIXEL_MM)) + 1
    lower, upper = mesh.bounds[:, :2]
    width, height = (int(np.ceil(side)) + 2 * margin + 1 for side in (upper - lower) / _PIXEL_MM)
    pixels = (mesh.vertices[:, :2] - lower) / _PIXEL_MM + margin
    seen = silhouette_mask(pixels, mesh.faces, width, height) > 0.0
    # a pixel more than asked: one that is only grazed between the samples counts too
    near: Bool[np.ndarray, "H W"] = distance_transform_edt(~seen) * _PIXEL_MM <= grown_mm + _PIXEL_MM
    return near


def _lowest(
    taken: Bool[np.ndarray, "H W"], shadows: Sequence[Bool[np.ndarray, "_ _"]]
) -> tuple[int, int, int] | None:
    """(row, column, turn) of the place whose far edge is lowest, then farthest left; None where there is no room."""
    best: tuple[tuple[int, int], tuple[int, int, int]] | None = None
    for turn, shadow in enumerate(shadows):
        if shadow.shape[0] > taken.shape[0] or shadow.shape[1] > taken.shape[1]:
            continue
        overlap = fftconvolve(taken.astype(float), shadow[::-1, ::-1].astype(float), mode="valid")
        rows, columns = np.nonzero(overlap < 0.5)
        if not len(rows):
            continue
        first = int(np.lexsort((columns, rows))[0])
        place = int(rows[first]), int(columns[first])
        cost = place[0] + shadow.shape[0], place[1] + shadow.shape[1]
        if best is None or cost < best[0]:
            best = cost, (*place, turn)
    return None if best is None else best[1]


def _at(mesh: Mesh, row: int, column: int, degrees: float) -> Mesh:
    turned = _turned(mesh, degrees)
    lower = turned.bounds[0]
    return turned.with_vertices(turned.vertices - lower + [column * _PIXEL_MM, row * _PIXEL_MM, 0.0])


def _centred(meshes: Sequence[Mesh], plates: Sequence[int], profile: PrinterProfile) -> list[Mesh]:
    """Every plate's parts with the middle of their box in the middle of its bed."""
    moved = list(meshes)
    for plate in range(max(plates) + 1):
        here = [one for one, at in enumerate(plates) if at == plate]
        bounds = np.array([meshes[one].bounds[:, :2] for one in here])
        middle = 0.5 * (bounds[:, 0].min(0) + bounds[:, 1].max(0))
        wanted: Float64[np.ndarray, "2"] = 0.5 * np.array(profile.build_mm[:2])
        shift = [*(wanted - middle), 0.0]
        shift[0] += plate * (profile.build_mm[0] + PLATE_GAP_MM)
        for one in here:
            moved[one] = meshes[one].with_vertices(meshes[one].vertices + shift)
    return moved
