"""From whatever a file holds to a surface that the solid room can work with.

`clean` welds, drops faces that say nothing, and turns the faces of each patch the same way. `repair`
also closes small holes of otherwise closed parts and wraps triangle soup. Openings are never filled: a
mask's eyes and a ring's finger hole are the object.

The wrap is CGAL's alpha wrap (Portaneri et al., "Alpha Wrapping with an Offset", 2022) through pymeshlab, one
cluster of soup at a time, so that separate parts stay separate.
"""

from dataclasses import dataclass

import igl
import numpy as np
from jaxtyping import Bool, Int, Int32, Int64
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import pdist

from fabcraft.errors import MissingError, SolidError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.edges import components, edge_uses
from fabcraft.geometry.voxels import Grid, samples
from fabcraft.mesh import Mesh
from fabcraft.solid.stitch import near_corners, without_t_junctions

_WELD_MM = 1e-5
_SOUP_WELD_MM = (0.05, 0.2)
_SOUP_SHARE = 0.3
_WRAP_KEEPS_MM = 0.01
_HOLE_MM, _HOLE_SHARE = 4.0, 0.05


@dataclass(frozen=True, eq=False)
class Repaired:
    """A cleaned surface and what was done to it."""

    mesh: Mesh
    notes: tuple[str, ...]


def repair(mesh: Mesh) -> Repaired:
    """Clean, wrap what is soup, close small holes.  Raises `SolidError` when no face is left."""
    cleaned = clean(mesh)
    notes = list(cleaned.notes)
    mesh = cleaned.mesh
    if open_share(mesh) > _SOUP_SHARE and len(mesh.faces) >= 100:
        before = open_share(mesh)
        mesh = clean(wrap(mesh)).mesh
        notes.append(f"{before:.0%} of the edges have one face: the triangle soup was wrapped")
    mesh, holes = fill_defects(mesh)
    if holes:
        notes.append(f"{holes} small holes closed")
    return Repaired(mesh, tuple(notes))


def clean(mesh: Mesh) -> Repaired:
    """Weld (1e-5 mm; soup wider), drop degenerate and repeated faces, split T-junctions, turn patches the same way."""
    notes = []
    welded = _weld(mesh)
    for wide_mm in _SOUP_WELD_MM:
        if open_share(welded) <= _SOUP_SHARE:
            break
        wider = _told_once(*near_corners(welded, wide_mm), mesh.name)
        if open_share(wider) < open_share(welded):
            notes = [f"vertices welded at {wide_mm} mm, because faces did not share vertices"]
            welded = wider
    if len(welded.faces) == 0:
        raise SolidError(
            f"{mesh.name or 'the mesh'} has no face with an area ({len(mesh.faces)} faces given)",
            "Check the unit of the file.",
        )
    if len(welded.faces) < len(mesh.faces):
        notes.append(f"{len(mesh.faces) - len(welded.faces)} degenerate or repeated faces dropped")
    welded, put_in = without_t_junctions(welded)
    if put_in:
        notes.append(f"{put_in} corners that lay on a neighbour's edge joined to it")
    turned = _oriented(welded)
    flipped = int((_parity(turned, welded.faces) < 0).sum())
    if flipped:
        notes.append(f"{flipped} faces turned round")
    return Repaired(Mesh(welded.vertices, turned, mesh.name), tuple(notes))


def open_share(mesh: Mesh) -> float:
    """Share of the edges that have one face only."""
    _, counts = edge_uses(mesh.faces)
    return float((counts == 1).mean()) if len(counts) else 0.0


def fill_defects(mesh: Mesh) -> tuple[Mesh, int]:
    """Close the holes of every component whose holes are all small, and count them.

    Small: diameter at most 4 mm or 5 % of the component's diagonal, and at most 30 % of it. A component
    with one larger opening is a sheet: its small holes are screws, straps and pores, and stay.
    """
    labels = components(mesh.faces)
    edges, counts = edge_uses(mesh.faces)
    boundary = counts[edges] == 1
    added_vertices: list[np.ndarray] = []
    added_faces: list[np.ndarray] = []
    holes = 0
    for label in np.unique(labels[boundary.any(1)]):
        mine = labels == label
        half_edges = _half_edges(mesh.faces[mine], boundary[mine])
        points = mesh.vertices[mesh.faces[mine]].reshape(-1, 3)
        size = float(np.linalg.norm(np.ptp(points, axis=0)))
        limit = min(max(_HOLE_MM, _HOLE_SHARE * size), 0.3 * size)
        loops = _loops(half_edges)
        if any(_diameter(mesh.vertices[np.unique(loop)]) > limit for loop in loops):
            continue
        for loop in loops:
            centre = len(mesh.vertices) + len(added_vertices)
            added_vertices.append(mesh.vertices[np.unique(loop)].mean(0))
            added_faces.append(np.column_stack([loop[:, ::-1], np.full(len(loop), centre)]))
            holes += 1
    if not holes:
        return mesh, 0
    vertices = np.concatenate([mesh.vertices, np.array(added_vertices)])
    faces = np.concatenate([mesh.faces, *added_faces]).astype(np.int32)
    return Mesh(vertices, faces, mesh.name), holes


def _diameter(points: np.ndarray) -> float:
    """Largest distance between two points, mm; the diagonal of their box where they are many."""
    if len(points) > 500:
        return float(np.linalg.norm(np.ptp(points, axis=0)))
    return float(pdist(points).max(initial=0.0))


def wrap(mesh: Mesh, alpha_mm: float = 1.0, offset_mm: float = 0.1) -> Mesh:
    """A closed surface close around the triangles that spans gaps below `alpha_mm`, by cluster.

    offset_mm : how far the wrap is held off while it is made.  Raises `MissingError` without pymeshlab.
    """
    try:
        import pymeshlab
    except ImportError as error:
        raise MissingError(
            "wrapping a triangle soup needs pymeshlab", "Run `pip install pymeshlab`."
        ) from error
    clusters = _clusters(mesh, alpha_mm)
    vertices, faces, count = [], [], 0
    for cluster in range(int(clusters.max()) + 1):
        part = mesh.submesh(clusters == cluster)
        meshes = pymeshlab.MeshSet(verbose=False)
        meshes.add_mesh(pymeshlab.Mesh(np.array(part.vertices), np.array(part.faces)))
        meshes.generate_alpha_wrap(alpha=pymeshlab.PureValue(alpha_mm), offset=pymeshlab.PureValue(offset_mm))
        wrapped = meshes.current_mesh()
        vertices.append(_drawn_back(wrapped.vertex_matrix(), part, offset_mm))
        faces.append(wrapped.face_matrix() + count)
        count += len(vertices[-1])
    return Mesh(np.concatenate(vertices), np.concatenate(faces).astype(np.int32), mesh.name)


def _drawn_back(points: np.ndarray, part: Mesh, offset_mm: float) -> np.ndarray:
    """The wrap's vertices back on the triangles that they were held off from; those over a gap stay."""
    near = SurfaceDistance(part).closest(points)
    held = (near.distances < 1.5 * offset_mm)[:, None]
    # Not quite on it: two sides of a sheet must not become one.
    back = points + (1.0 - _WRAP_KEEPS_MM / np.maximum(near.distances, _WRAP_KEEPS_MM))[:, None] * (
        near.points - points
    )
    return np.where(held, back, points)


def _clusters(mesh: Mesh, gap_mm: float) -> np.ndarray:
    """The cluster of every face: faces with points in neighbouring cells of `gap_mm` belong together."""
    from scipy.ndimage import label

    points, owners = samples(mesh.corners, gap_mm)
    grid = Grid.around(mesh.bounds, gap_mm, gap_mm)
    cells = np.rint((points - np.array(grid.origin)) / gap_mm).astype(int)
    occupied = np.zeros(grid.shape, bool)
    occupied[tuple(cells.T)] = True
    # A face lies in one region, because its samples are at most a cell apart.
    regions = label(occupied, structure=np.ones((3, 3, 3)))[0][tuple(cells.T)]
    found = np.zeros(len(mesh.faces), np.int64)
    found[owners] = regions
    return np.unique(found, return_inverse=True)[1].reshape(-1)


def _weld(mesh: Mesh) -> Mesh:
    """Vertices on the same lattice point of 1e-5 mm become one; faces without area or said twice go."""
    keys = np.rint(mesh.vertices / _WELD_MM).astype(np.int64)
    _, first, merged = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    # Keep the order of first appearance, so that a clean mesh comes back vertex by vertex.
    order = np.argsort(first, kind="stable")
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    return _told_once(mesh.vertices[first[order]], rank[merged.reshape(-1)][mesh.faces], mesh.name)


def _told_once(vertices: np.ndarray, faces: np.ndarray, name: str) -> Mesh:
    """The mesh without faces that lost a corner or come twice, and without unused vertices."""
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(1)]
    _, single = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    welded = Mesh(vertices, faces[np.sort(single)].astype(np.int32), name)
    return welded.submesh(np.arange(len(welded.faces))) if len(welded.faces) else welded


def _oriented(mesh: Mesh) -> Int32[np.ndarray, "F 3"]:
    """Every patch turned one way: the way that most of its area already looks."""
    turned, patch = (array.astype(np.int64) for array in igl.bfs_orient(np.array(mesh.faces, dtype=np.int64)))
    parity = _parity(turned, mesh.faces)
    votes = np.bincount(patch, parity * mesh.face_areas)
    flip = parity * np.where(votes[patch] < 0, -1, 1) < 0
    return np.where(flip[:, None], mesh.faces[:, ::-1], mesh.faces).astype(np.int32)


def _parity(turned: Int[np.ndarray, "F 3"], faces: Int[np.ndarray, "F 3"]) -> Int64[np.ndarray, " F"]:
    """+1 where a face of `turned` looks the way of the same face in `faces`, -1 where it does not."""
    same: Bool[np.ndarray, " F"] = np.zeros(len(faces), bool)
    for shift in range(3):
        same |= (np.roll(turned, shift, axis=1) == faces).all(1)
    return np.where(same, 1, -1)


def _half_edges(faces: Int32[np.ndarray, "F 3"], chosen: Bool[np.ndarray, "F 3"]) -> Int32[np.ndarray, "H 2"]:
    return np.stack([faces, np.roll(faces, -1, axis=1)], 2)[chosen]


def _loops(half_edges: Int32[np.ndarray, "H 2"]) -> list[Int32[np.ndarray, "L 2"]]:
    """The half-edges by connected boundary."""
    used, compact = np.unique(half_edges, return_inverse=True)
    start, end = compact.reshape(-1, 2).T
    graph = coo_matrix((np.ones(len(start), np.int8), (start, end)), shape=(len(used),) * 2)
    label = connected_components(graph, directed=False)[1][start]
    return [half_edges[label == number] for number in range(int(label.max(initial=-1)) + 1)]
