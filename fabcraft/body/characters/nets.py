"""A symmetric signed distance becomes an even triangle mesh: surface nets, then relaxed on the surface.

Surface nets (Gibson 1998) put a vertex in every cell that the surface crosses and a quad across every crossed edge, so
there are no needles; where two sheets pass a cell each gets a vertex of its own (Nielson 2004, dual marching cubes).  A few
rounds of "to the middle of the neighbours, back onto the surface" make the quads even.
Only x >= 0 is sampled, with a layer of cells astride x = 0: the mesh is its own mirror image to the last bit.
"""

from itertools import product

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.sparse import coo_matrix

from fabcraft.body.characters.shapes import Shape
from fabcraft.mesh import Mesh

_ROUNDS = 6
_BLOCK = 4
"""Nodes are worked out in blocks of this many cells a side, and only in blocks that the surface may cross."""

_CORNERS = np.array(list(product((0, 1), repeat=3)))
"""Corners of a cell; corner (i, j, k) is bit 4 i + 2 j + k of its pattern."""


def symmetric_mesh(shape: Shape, bounds: Float64[np.ndarray, "2 3"], cell_mm: float) -> Mesh:
    """The surface of `shape`, its own mirror image in x = 0, inside `bounds` (mm); edges about `cell_mm` long."""
    origin, values = _sampled(shape, bounds, cell_mm)
    places, quads, seam = _surface_net(values)
    points = _relaxed(shape, origin + cell_mm * places, quads, seam, cell_mm)
    faces = _triangles(points, quads)
    other = np.arange(len(points))
    other[~seam] = len(points) + np.arange((~seam).sum())
    mirrored = points[~seam] * [-1.0, 1.0, 1.0]
    every = np.concatenate([faces, other[faces][:, ::-1]])
    return Mesh(np.concatenate([points, mirrored]), every.astype(np.int32))


def _sampled(
    shape: Shape, bounds: np.ndarray, cell_mm: float
) -> tuple[np.ndarray, Float64[np.ndarray, "X Y Z"]]:
    """Place of the first node, and the distance at every node near the surface (its sign alone elsewhere).

    The first layers of nodes lie half a cell on either side of x = 0.
    """
    first = np.floor(bounds[0] / cell_mm - 1.0) - 0.5
    first[0] = -0.5
    blocks = np.ceil((bounds[1] / cell_mm + 1.5 - first) / _BLOCK).astype(int)
    corner = _BLOCK * np.stack(np.meshgrid(*map(np.arange, blocks), indexing="ij"), axis=-1).reshape(-1, 3)
    middle = shape.distance(cell_mm * (first + corner + 0.5 * (_BLOCK - 1)))
    near = np.flatnonzero(np.abs(middle) < 1.5 * cell_mm * _BLOCK)
    inner = np.stack(np.meshgrid(*[np.arange(_BLOCK)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    values = np.repeat(middle[:, None], _BLOCK**3, axis=1)
    nodes = cell_mm * (first + corner[near, None] + inner)
    values[near] = shape.distance(nodes.reshape(-1, 3)).reshape(len(near), -1)
    grid = values.reshape(*blocks, _BLOCK, _BLOCK, _BLOCK).transpose(0, 3, 1, 4, 2, 5)
    return cell_mm * first, grid.reshape(*(_BLOCK * blocks))


def _surface_net(
    values: Float64[np.ndarray, "X Y Z"],
) -> tuple[Float64[np.ndarray, "N 3"], Int64[np.ndarray, "Q 4"], Bool[np.ndarray, " N"]]:
    """Vertices in cells from node 0, quads counter-clockwise seen from outside, and which vertices lie on x = 0."""
    inside = values < 0.0
    cells = tuple(count - 1 for count in values.shape)
    pattern = np.zeros(cells, dtype=np.int64)
    for bit, (i, j, k) in enumerate(_CORNERS):
        pattern |= inside[i : i + cells[0], j : j + cells[1], k : k + cells[2]].astype(np.int64) << bit
    patches = _patches()
    found: list[np.ndarray] = []
    at: list[np.ndarray] = []
    corners: list[np.ndarray] = []
    for axis in range(3):
        step = np.eye(3, dtype=np.int64)[axis]
        node = np.argwhere(np.diff(inside, axis=axis))
        start, end = values[tuple(node.T)], values[tuple((node + step).T)]
        place = node + step * (start / (start - end))[:, None]
        j, k = np.eye(3, dtype=np.int64)[[(axis + 1) % 3, (axis + 2) % 3]]
        turn = np.stack([0 * j, j, j + k, k])  # where the edge lies in the four cells round it
        cell = node[:, None] - turn
        # an edge in the layer of nodes behind x = 0 belongs to the mirror image
        whole = ((cell >= 0) & (cell < cells)).all((1, 2))
        cell, place, start = cell[whole], place[whole], start[whole]
        flat = np.ravel_multi_index(tuple(np.moveaxis(cell, -1, 0)), cells)
        key = 4 * flat + patches[pattern.reshape(-1)[flat], 4 * axis + np.arange(4)]
        found.append(key.reshape(-1))
        at.append(np.repeat(place, 4, axis=0))
        corners.append(np.where((start < 0.0)[:, None], key[:, [2, 3, 0, 1]], key[:, [2, 1, 0, 3]]))
    used, which = np.unique(np.concatenate(found), return_inverse=True)
    share = coo_matrix((np.ones(len(which)), (which, np.arange(len(which)))))
    points = (share @ np.concatenate(at)) / np.bincount(which)[:, None]
    seam = used < 4 * cells[1] * cells[2]
    points[seam, 0] = 0.5
    return points, np.searchsorted(used, np.concatenate(corners)), seam


def _patches() -> Int64[np.ndarray, "256 12"]:
    """For every pattern of inside corners, which sheet of the surface crosses each of a cell's edges.

    Edge 4 a + n runs along axis a; n counts its places round the cell as `turn` does.  On a side of the cell with four
    crossed edges the two inside corners are kept apart, so that neighbouring cells agree.
    """
    table = np.zeros((256, 12), dtype=np.int64)
    ends = np.zeros((12, 2), dtype=np.int64)
    for axis in range(3):
        along, j, k = (np.eye(3, dtype=np.int64)[(axis + n) % 3] for n in range(3))
        for place, start in enumerate((0 * j, j, j + k, k)):
            ends[4 * axis + place] = (start @ [4, 2, 1], (start + along) @ [4, 2, 1])
    edge_of = {frozenset(pair): number for number, pair in enumerate(ends.tolist())}
    rings = []
    for axis in range(3):
        along, j, k = (np.eye(3, dtype=np.int64)[(axis + n) % 3] for n in range(3))
        rings += [
            [int((side + turn) @ [4, 2, 1]) for turn in (0 * j, j, j + k, k)] for side in (0 * j, along)
        ]
    for pattern in range(256):
        inside = [bool(pattern >> corner & 1) for corner in range(8)]
        label = list(range(12))
        for ring in rings:
            edges = [edge_of[frozenset((ring[n], ring[(n + 1) % 4]))] for n in range(4)]
            crossed = [n for n in range(4) if inside[ring[n]] != inside[ring[(n + 1) % 4]]]
            pairs = (
                [(n - 1, n) for n in range(4) if inside[ring[n]]] if len(crossed) == 4 else [tuple(crossed)]
            )
            for one, other in (pair for pair in pairs if pair):
                low, high = sorted((label[edges[one]], label[edges[other]]))
                label = [low if old == high else old for old in label]
        crossed = [number for number, (a, b) in enumerate(ends.tolist()) if inside[a] != inside[b]]
        names = sorted({label[number] for number in crossed})
        for number in crossed:
            table[pattern, number] = names.index(label[number])
    return table


def _relaxed(
    shape: Shape, points: np.ndarray, quads: np.ndarray, seam: np.ndarray, cell_mm: float
) -> np.ndarray:
    """Every vertex to the middle of its neighbours and back onto the surface, again and again; the seam stays at x = 0."""
    pairs = np.concatenate([quads, np.roll(quads, -1, axis=1)]).reshape(2, -1)
    graph = coo_matrix((np.ones(pairs.shape[1]), pairs), shape=(len(points),) * 2).tocsr()
    graph = ((graph + graph.T) > 0).astype(np.float64).tocoo()
    # a seam vertex has its other neighbours in the mirror image: those off the seam count twice
    graph.data[seam[graph.row] & ~seam[graph.col]] = 2.0
    mean = graph.tocsr()
    degree = np.asarray(mean.sum(1))
    for _ in range(_ROUNDS):
        points = points + 0.7 * (mean @ points / degree - points)
        points[seam, 0] = 0.0
        points = _onto(shape, points, cell_mm)
    points = _onto(shape, _onto(shape, points, cell_mm), cell_mm)
    points[seam, 0] = 0.0
    return points


_TETRAHEDRON = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])


def _onto(shape: Shape, points: np.ndarray, cell_mm: float) -> np.ndarray:
    """One Newton step towards the surface; value and gradient from the corners of a small tetrahedron."""
    step = 0.01 * cell_mm
    around = (points[:, None] + step * _TETRAHEDRON).reshape(-1, 3)
    found = shape.distance(around).reshape(-1, 4)
    gradient = found @ _TETRAHEDRON / (4.0 * step)
    square = np.maximum((gradient**2).sum(1), 0.05)
    move = -(found.mean(1) / square)[:, None] * gradient
    length = np.linalg.norm(move, axis=1, keepdims=True)
    return points + move * np.minimum(1.0, 0.5 * cell_mm / np.maximum(length, 1e-12))


def _triangles(points: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Every quad parted by the diagonal that leaves the larger smallest angle."""
    either = np.stack([quads[:, [0, 1, 2, 0, 2, 3]], quads[:, [1, 2, 3, 1, 3, 0]]]).reshape(2, -1, 2, 3)
    least = _least_angles(points[either]).min(2)
    return either[(least[1] > least[0] + 1e-9).astype(int), np.arange(len(quads))].reshape(-1, 3)


def _least_angles(corners: np.ndarray) -> np.ndarray:
    """Smallest angle, radians, of triangles (..., 3, 3)."""
    sides = np.roll(corners, -1, axis=-2) - corners
    unit = sides / np.maximum(np.linalg.norm(sides, axis=-1, keepdims=True), 1e-12)
    cosine = -(unit * np.roll(unit, 1, axis=-2)).sum(-1)
    return np.arccos(np.clip(cosine, -1.0, 1.0)).min(-1)
