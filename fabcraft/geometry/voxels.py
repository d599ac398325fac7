"""A surface from a scalar field on a cubic grid, where the field is worked out only near the surface.

Convention: the field is negative inside; the grid is indexed (x, y, z); nodes sit half a cell off multiples
of the cell, so that a symmetry plane or a flat face at a round coordinate does not fall on nodes. Steps:

1. `samples` covers triangles with points, `Grid.near` marks the nodes around points;
2. `narrow_band` evaluates the field there, follows the surface where it leaves the marked nodes, and gives
   every other node the sign of the connected region it lies in;
3. `isosurface` runs marching cubes (Lewiner et al. 2003, scikit-image), millimetres, faces outward.

Everything is deterministic. Memory is about 9 bytes a node; grids above `MAX_CELLS` are refused.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int64
from scipy import ndimage
from skimage.measure import marching_cubes

from fabcraft.errors import SolidError
from fabcraft.mesh import Mesh

MAX_CELLS = 400_000_000
"""Above this a grid would need more than 4 GiB."""

BAND_CELLS = 1.0
"""How far from where the surface should pass nodes are marked: the edges that it cuts are no longer, and where it passes
elsewhere it is followed."""

Field = Callable[[Float64[np.ndarray, "N 3"]], Float64[np.ndarray, " N"]]

# A node value this small (in cells) is moved off zero: a surface through a node makes triangles without area.
_OFF_ZERO = 1e-3


@dataclass(frozen=True)
class Grid:
    """A box of nodes: node (i, j, k) sits at `origin + cell * (i, j, k)`, mm."""

    origin: tuple[float, float, float]
    cell_mm: float
    shape: tuple[int, int, int]

    @staticmethod
    def around(bounds: Float64[np.ndarray, "2 3"], cell_mm: float, margin_mm: float) -> "Grid":
        """The grid over `bounds` with `margin_mm` and two cells to spare; `SolidError` if too large."""
        if not cell_mm > 0:
            raise SolidError(f"the cell is {cell_mm} mm; it must be above zero", "Give a larger cell_mm.")
        first = np.floor((bounds[0] - margin_mm) / cell_mm - 2)
        last = np.ceil((bounds[1] + margin_mm) / cell_mm + 2)
        shape = last - first
        if shape.prod() > MAX_CELLS:
            raise SolidError(
                f"{shape[0]:.0f} x {shape[1]:.0f} x {shape[2]:.0f} cells of {cell_mm:g} mm would be "
                f"needed; at most {MAX_CELLS / 1e6:.0f} million cells fit in memory",
                f"Use cells of {cell_mm * (shape.prod() / MAX_CELLS) ** (1 / 3) * 1.05:.2f} mm or more, "
                "or check the unit of the input.",
            )
        x, y, z = (first + 0.5) * cell_mm
        i, j, k = shape.astype(int)
        return Grid((float(x), float(y), float(z)), cell_mm, (int(i), int(j), int(k)))

    @property
    def size(self) -> int:
        """Number of nodes."""
        return int(np.prod(self.shape, dtype=np.int64))

    @property
    def strides(self) -> Int64[np.ndarray, "3"]:
        """Step of the flat index along x, y and z."""
        return np.array([self.shape[1] * self.shape[2], self.shape[2], 1], dtype=np.int64)

    def positions(self, flat: Int64[np.ndarray, " N"]) -> Float64[np.ndarray, "N 3"]:
        """Where the nodes of flat index `flat` are, mm."""
        return np.stack(np.unravel_index(flat, self.shape), 1) * self.cell_mm + np.array(self.origin)

    def near(
        self, points: Float64[np.ndarray, "N 3"], reach_mm: float, marked: Bool[np.ndarray, "X Y Z"]
    ) -> None:
        """Set `marked` for every node within `reach_mm` of a point, and some up to one cell further."""
        nodes = np.rint((points - np.array(self.origin)) / self.cell_mm).astype(np.int64)
        hit = np.zeros(self.size, bool)
        hit[np.clip(nodes, 0, np.array(self.shape) - 1) @ self.strides] = True
        flat = np.flatnonzero(hit)
        # Rounding to a node moves a point by up to half a cell's diagonal.
        reach = reach_mm / self.cell_mm + 0.87
        span = np.arange(-int(reach), int(reach) + 1)
        ball = np.stack(np.meshgrid(span, span, span, indexing="ij"), -1).reshape(-1, 3)
        ball = ball[(ball**2).sum(1) <= reach**2]
        inner = self._away_from_border(flat, int(reach))
        view = marked.reshape(-1)
        for offset in ball @ self.strides:
            view[flat[inner] + offset] = True
        at = np.stack(np.unravel_index(flat[~inner], self.shape), 1)
        for offset in ball:
            moved = at + offset
            moved = moved[((moved >= 0) & (moved < self.shape)).all(1)]
            view[moved @ self.strides] = True

    def _away_from_border(self, flat: np.ndarray, nodes: int) -> np.ndarray:
        at = np.stack(np.unravel_index(flat, self.shape), 1)
        return np.all((at >= nodes) & (at < np.array(self.shape) - nodes), axis=1)


def samples(
    corners: Float64[np.ndarray, "F 3 3"], spacing_mm: float
) -> tuple[Float64[np.ndarray, "S 3"], Int64[np.ndarray, " S"]]:
    """Points at most `spacing_mm` apart that cover every triangle, borders included, and the face of each."""
    edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(1)
    steps = np.maximum(np.ceil(edges / spacing_mm), 1).astype(np.int64)
    points, owners = [], []
    for step in np.unique(steps):
        faces = np.flatnonzero(steps == step)
        i, j = (axis.reshape(-1) for axis in np.meshgrid(np.arange(step + 1), np.arange(step + 1)))
        i, j = i[i + j <= step], j[i + j <= step]
        weights = np.stack([i, j, step - i - j], 1) / step
        points.append(np.einsum("sk,fkx->fsx", weights, corners[faces]).reshape(-1, 3))
        owners.append(np.repeat(faces, len(weights)))
    if not points:
        return np.zeros((0, 3)), np.zeros(0, np.int64)
    return np.concatenate(points), np.concatenate(owners)


def narrow_band(grid: Grid, marked: Bool[np.ndarray, "X Y Z"], field: Field) -> Float32[np.ndarray, "X Y Z"]:
    """The field on the whole grid, exact on `marked` nodes and wherever else the surface turned out to pass.

    Other nodes carry plus or minus one cell, by the sign of the region around them. Where a region's border
    shows both signs the surface has left the marked nodes; it is followed there until every region has one
    sign. The region that touches the border of the grid is outside.  `marked` is extended in place.
    """
    volume = np.empty(grid.shape, np.float32)
    values, known = volume.reshape(-1), marked.reshape(-1)
    values[known] = _evaluate(grid, field, np.flatnonzero(known))
    while True:
        regions, count = ndimage.label(~marked)
        flat_regions = regions.reshape(-1)
        region, negative, neighbour = _borders(grid, np.flatnonzero(known), values, known, flat_regions)
        inside = _inside_regions(regions, count, region, negative)
        front = _around(grid, neighbour[inside[region] != negative], known)
        if len(front) == 0:
            break
        while len(front):
            values[front] = _evaluate(grid, field, front)
            known[front] = True
            region, negative, neighbour = _borders(grid, front, values, known, flat_regions)
            front = _around(grid, neighbour[inside[region] != negative], known)
    sign = np.where(inside, -1, 1).astype(np.float32) * np.float32(grid.cell_mm)
    np.copyto(volume, sign[regions], where=~marked)
    return volume


def _evaluate(grid: Grid, field: Field, flat: np.ndarray) -> np.ndarray:
    """The field at nodes, in pieces that bound the memory, and never exactly zero."""
    values = np.empty(len(flat), np.float32)
    for start in range(0, len(flat), 500_000):
        piece = flat[start : start + 500_000]
        values[start : start + 500_000] = field(grid.positions(piece))
    if not np.isfinite(values).all():
        raise SolidError("the thickness function gave a value that is not a number", "Check its input.")
    least = _OFF_ZERO * grid.cell_mm
    small = np.abs(values) < least
    values[small] = np.where(values[small] < 0, -least, least)
    return values


def _borders(
    grid: Grid, band: np.ndarray, volume: np.ndarray, marked: np.ndarray, regions: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For every pair of a known node and an unknown neighbour: region, sign of the known, the neighbour."""
    found = []
    for stride, nodes in zip(grid.strides, grid.shape, strict=True):
        place = band // stride % nodes
        for step, last in ((1, nodes - 1), (-1, 0)):
            known = band[place != last]
            neighbour = known + step * stride
            unknown = ~marked[neighbour]
            neighbour, known = neighbour[unknown], known[unknown]
            found.append((regions[neighbour], volume[known] < 0, neighbour))
    region, negative, neighbours = (np.concatenate(column) for column in zip(*found, strict=True))
    return region, negative, neighbours


def _inside_regions(regions: np.ndarray, count: int, region: np.ndarray, negative: np.ndarray) -> np.ndarray:
    """Whether each region (0 unused) is inside: the majority of its border, unless it meets the grid's."""
    votes = np.bincount(region, np.where(negative, 1.0, -1.0), count + 1)
    inside = votes > 0
    for axis in range(3):
        for side in (0, -1):
            inside[np.unique(np.take(regions, side, axis))] = False
    return inside


def _around(grid: Grid, flat: np.ndarray, marked: np.ndarray) -> np.ndarray:
    """`flat` and its 26 neighbours, as far as they are not marked yet."""
    at = np.stack(np.unravel_index(flat, grid.shape), 1)
    steps = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1], [-1, 0, 1], indexing="ij"), -1).reshape(-1, 3)
    moved = (at[:, None] + steps).reshape(-1, 3)
    moved = moved[((moved >= 0) & (moved < grid.shape)).all(1)]
    found = np.unique(moved @ grid.strides)
    return found[~marked[found]]


_LEAST_NODE_SHARE = 0.004


def isosurface(grid: Grid, volume: Float[np.ndarray, "X Y Z"], name: str = "") -> Mesh:
    """The surface where `volume` is zero, closed, faces away from the negative side, mm.

    Raises `SolidError` when nothing is negative.
    """
    if not (volume < 0).any():
        raise SolidError("the surface is empty: no point of the grid lies inside", "Use a thicker wall.")
    # A surface that passes a node almost exactly makes needles there; moved by up to 0.4 % of a cell it does not.
    least = _LEAST_NODE_SHARE * grid.cell_mm
    volume = np.where(np.abs(volume) < least, np.where(volume < 0, -least, least), volume).astype(np.float32)
    vertices, faces, _, _ = marching_cubes(volume, 0.0, gradient_direction="descent", allow_degenerate=True)
    return Mesh(
        vertices.astype(np.float64) * grid.cell_mm + np.array(grid.origin), faces.astype(np.int32), name
    )
