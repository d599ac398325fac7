"""A scanned surface becomes orderly: at most two faces an edge, wound alike, outside outward.

Openings stay as they are: what becomes of them is decided when it is known what the scan shows (`scan_close`).
"""

import igl
import numpy as np
from jaxtyping import Bool, Int32
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fabcraft.body.body import fan_closed
from fabcraft.errors import InputError
from fabcraft.geometry.edges import edge_uses
from fabcraft.mesh import Mesh
from fabcraft.read.mesh_file import merged

_WELD = 2e-4
"""Share of the size within which the corners of a soup of triangles are the same place."""
_SOUP_SHARE = 0.3
"""A surface with this share of edges of one face is a soup."""


def welded(mesh: Mesh) -> tuple[Mesh, tuple[str, ...]]:
    """(`mesh` with the nearly equal corners of a soup of triangles joined, and no face twice; what was done)."""
    if _open_share(mesh) < _SOUP_SHARE:
        return mesh, ()
    pairs = cKDTree(mesh.vertices).query_pairs(_WELD * float(mesh.size_mm.max()), output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(mesh.vertices),) * 2)
    _, place = connected_components(graph, directed=False)
    _, first = np.unique(place, return_index=True)
    joined = Mesh(*merged(mesh.vertices[first], place[mesh.faces]), mesh.name)
    if not len(joined.faces) or _open_share(joined) >= 0.9 * _open_share(mesh):
        return mesh, ()
    return joined, ("The scan's triangles did not share corners; nearly equal corners were joined.",)


def _open_share(mesh: Mesh) -> float:
    counts = edge_uses(mesh.faces)[1]
    return float((counts == 1).mean()) if len(counts) else 0.0


def orderly(mesh: Mesh) -> tuple[Mesh, tuple[str, ...]]:
    """(the largest sheet of `mesh`, two faces an edge and looking outward; what was done, in sentences).

    Raises `InputError` when nothing like a surface is left, or it has no two sides.
    """
    single = np.sort(np.unique(np.sort(mesh.faces, axis=1), axis=0, return_index=True)[1])
    faces, dropped = mesh.faces[single], 0
    while len(faces):
        edges, counts = edge_uses(faces)
        crowded = (counts[edges] > 2).any(1)
        if not crowded.any():
            break
        dropped += int(crowded.sum())
        faces = faces[~crowded]
    if not len(faces):
        raise InputError(
            f"{mesh.name} is not a surface: no edge joins exactly two of its triangles",
            "Repair it in the scanning program, or export it as a mesh.",
        )
    notes = []
    if dropped:
        notes.append(f"Triangles at edges that three or more share were left out: {dropped}.")
    sheet = _vertices_apart(Mesh(mesh.vertices, faces, mesh.name))
    sheet, turned = outward(sheet.submesh(largest(sheet)))
    return sheet, (*notes, *turned)


def pieces(mesh: Mesh) -> tuple[int, np.ndarray]:
    """(how many pieces that share corners, the piece of every face)."""
    edges = mesh.faces[:, [0, 1, 1, 2]].reshape(-1, 2)
    graph = coo_matrix((np.ones(len(edges)), edges.T), shape=(len(mesh.vertices),) * 2)
    label = connected_components(graph, directed=False)[1][mesh.faces[:, 0]]
    found, number = np.unique(label, return_inverse=True)
    return len(found), number.reshape(-1)


def largest(mesh: Mesh) -> Bool[np.ndarray, " F"]:
    """The faces of the piece with the most area."""
    count, label = pieces(mesh)
    return label == np.bincount(label, mesh.face_areas, count).argmax()


def _vertices_apart(mesh: Mesh) -> Mesh:
    """A vertex where two sheets only touch becomes one vertex for each sheet."""
    faces = mesh.faces
    corner = np.arange(faces.size).reshape(-1, 3)
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    starts = np.where(faces.ravel() == edges[:, 0], corner.ravel(), corner[:, [1, 2, 0]].ravel())
    ends = np.where(faces.ravel() == edges[:, 0], corner[:, [1, 2, 0]].ravel(), corner.ravel())
    order = np.lexsort(edges.T)
    same = (edges[order][1:] == edges[order][:-1]).all(1)
    first, second = order[:-1][same], order[1:][same]
    links = np.concatenate([np.stack([side[first], side[second]], 1) for side in (starts, ends)])
    graph = coo_matrix((np.ones(len(links)), links.T), shape=(faces.size, faces.size))
    _, label = connected_components(graph, directed=False)
    sheets, where = np.unique(label, return_index=True)
    vertices = mesh.vertices[faces.ravel()[where]]
    return Mesh(vertices, np.searchsorted(sheets, label).reshape(-1, 3).astype(np.int32), mesh.name)


def outward(mesh: Mesh) -> tuple[Mesh, tuple[str, ...]]:
    """(all faces wound alike, and outward as far as the closed-up surface encloses a positive volume; a note).

    Raises `InputError` for a surface without two sides.
    """
    faces = np.asarray(igl.bfs_orient(mesh.faces.astype(np.int64))[0], dtype=np.int32)
    directed = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(np.int64)
    if len(np.unique(directed @ [2**32, 1])) < len(directed):
        raise InputError(
            f"{mesh.name} has no inside and outside: following its triangles, one comes back on the other side",
            "Repair it in the scanning program.",
        )
    if fan_closed(Mesh(mesh.vertices, faces, mesh.name)).volume_mm3 < 0:
        faces = faces[:, ::-1]
    share = float(_turned(mesh.faces, faces).mean())
    said = "The scan was inside out; all its triangles were turned round."
    if share <= 0.99:
        said = f"Triangles that looked inward were turned round: {share:.1%}."
    return Mesh(mesh.vertices, faces, mesh.name), (said,) if share else ()


def _turned(before: Int32[np.ndarray, "F 3"], after: Int32[np.ndarray, "F 3"]) -> Bool[np.ndarray, " F"]:
    """Which faces go round the other way."""
    return ~np.any([(np.roll(after, step, axis=1) == before).all(1) for step in range(3)], axis=0)
