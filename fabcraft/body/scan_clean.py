"""A scanned surface becomes orderly: one piece, two faces per edge, outside outward, small holes filled.

The largest opening, as a rule the neck's, stays open.
"""

import numpy as np
from jaxtyping import Int32
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from fabcraft.body.body import fan_closed, rim_loops
from fabcraft.errors import InputError
from fabcraft.mesh import Mesh

MAX_FACES = 36_000
"""Scans are thinned to this; closing them adds a little."""


def cleaned(mesh: Mesh) -> tuple[Mesh, tuple[str, ...]]:
    """(the surface with at most one opening, what was done in sentences).

    Raises `InputError` when nothing like a surface is left.
    """
    notes = []
    if len(mesh.faces) > MAX_FACES:
        notes.append(f"The scan was thinned from {len(mesh.faces):,} to about {MAX_FACES:,} triangles.")
        mesh = _thinned(mesh)
    mesh = _two_faces_an_edge(mesh)
    mesh = _outward(mesh)
    loops = rim_loops(mesh.faces)
    if len(loops) > 1:
        notes.append(f"Small openings of the scan were filled: {len(loops) - 1}.")
        mesh = _filled(mesh, loops[1:])
    return mesh, tuple(notes)


def largest_piece(mesh: Mesh) -> tuple[Mesh, tuple[str, ...]]:
    """(the connected piece with the most faces, a sentence about the others if there are any)."""
    faces, others = _largest(mesh.faces, len(mesh.vertices))
    piece = Mesh(mesh.vertices, faces, mesh.name).submesh(np.arange(len(faces)))
    if not others:
        return piece, ()
    return piece, (f"Loose pieces beside the head were left out: {others}.",)


def _largest(faces: Int32[np.ndarray, "F 3"], count: int) -> tuple[Int32[np.ndarray, "G 3"], int]:
    """The faces of the largest piece, and the number of the others."""
    edges = faces[:, [0, 1, 1, 2]].reshape(-1, 2)
    graph = coo_matrix((np.ones(len(edges)), edges.T), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    sizes = np.bincount(label[faces[:, 0]])
    return faces[label[faces[:, 0]] == sizes.argmax()], int((sizes > 0).sum()) - 1


def _thinned(mesh: Mesh) -> Mesh:
    import fast_simplification

    # copies, since the library takes only arrays that it could write to
    vertices, faces = fast_simplification.simplify(
        mesh.vertices.copy(), mesh.faces.copy(), target_count=MAX_FACES
    )
    return Mesh(np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int32), mesh.name)


def _two_faces_an_edge(mesh: Mesh) -> Mesh:
    """Without the faces at edges that three or more share, until none is left; then the largest piece."""
    faces = np.unique(np.sort(mesh.faces, axis=1), axis=0, return_index=True)[1]
    kept = mesh.faces[np.sort(faces)]
    while len(kept):
        edges = np.sort(kept[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        _, place, uses = np.unique(edges, axis=0, return_inverse=True, return_counts=True)
        crowded = (uses[place.reshape(-1)] > 2).reshape(-1, 3).any(1)
        if not crowded.any():
            break
        kept = kept[~crowded]
    if not len(kept):
        raise InputError(f"{mesh.name} is not a surface", "Repair it in the scanning program.")
    kept, _ = _largest(kept, len(mesh.vertices))
    return _vertices_apart(Mesh(mesh.vertices, kept, mesh.name))


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


def _outward(mesh: Mesh) -> Mesh:
    """All faces wound alike, and outward as far as the closed-up surface encloses a positive volume.

    Raises `InputError` for a surface without two sides.
    """
    import igl

    faces = np.asarray(igl.bfs_orient(mesh.faces.astype(np.int64))[0], dtype=np.int32)
    directed = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(np.int64)
    if len(np.unique(directed @ [2**32, 1])) < len(directed):
        raise InputError(f"{mesh.name} has no inside and outside", "Repair it in the scanning program.")
    mesh = Mesh(mesh.vertices, faces, mesh.name)
    if fan_closed(mesh).volume_mm3 < 0:
        mesh = Mesh(mesh.vertices, faces[:, ::-1], mesh.name)
    return mesh


def _filled(mesh: Mesh, loops: list[np.ndarray]) -> Mesh:
    """These boundary loops closed by fans."""
    vertices, faces = [mesh.vertices], [mesh.faces]
    for index, loop in enumerate(loops):
        centre = np.full(len(loop), len(mesh.vertices) + index)
        vertices.append(mesh.vertices[loop].mean(0)[None])
        faces.append(np.stack([np.roll(loop, -1), loop, centre], axis=1).astype(np.int32))
    return Mesh(np.concatenate(vertices), np.concatenate(faces), mesh.name)
