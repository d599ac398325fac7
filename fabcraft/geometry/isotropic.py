"""Even triangles of a wanted edge length on a given surface: MeshLab's explicit isotropic remeshing.

Each round splits edges above 4/3 of the length, collapses those below 4/5, flips towards six edges a vertex, smooths
tangentially and projects back onto the surface given (Botsch and Kobbelt, "A Remeshing Approach to Multiresolution
Modeling", 2004; Alliez et al. 2003). Borders stay on their curves. The same input gives the same mesh.

Where a finer length is wanted in places (a rim, a bead), the coarse part is meshed first, then each part of half the
length, overlapping what was meshed before, so that the triangles grow evenly.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float64, Int32
from scipy.spatial import cKDTree

from fabcraft.errors import InputError, MissingError, SolidError
from fabcraft.geometry.edges import distinct_edges
from fabcraft.mesh import Mesh

Lengths = Callable[[Float64[np.ndarray, "N 3"]], Float64[np.ndarray, " N"]]
"""Wanted edge length at points, mm; it should change by no more than about half of the way."""

_ROUNDS = 6
_NO_CREASE_DEG = 180.0
_MEAN_SHARE = 0.96
"""Asked for this share of a length, MeshLab's mean edge is that length."""
_MOST_LOST = 0.1
"""A closed surface whose volume changes by a larger share is no longer the same shape."""
_OFF_PLANE = 0.15
"""Before it is cut in the plane of symmetry, a surface's vertices are moved off it by this share of an edge."""
_LEAST_SHARE = 0.5
"""Where parts of several lengths meet, edges below 4/5 of this share of the shortest are collapsed at the end."""
_FACES_USED = 3.0
"""Faces that remeshing starts from, over those that it makes."""
_RINGS = 2
"""Faces round the chosen ones that are given along: only those next to them can change."""
_ROUNDING = 1e-6
"""What has stayed where it was may have moved by this share of an edge."""
_OVERLAP = 1.4
"""A part is meshed together with neighbours that want up to this many times the longest length of the part."""


def isotropic(
    mesh: Mesh,
    edge_mm: float,
    *,
    finer: Lengths | None = None,
    crease_deg: float = _NO_CREASE_DEG,
    mirrored: bool = False,
    rounds: int = _ROUNDS,
) -> Mesh:
    """The surface of `mesh` in near-equilateral triangles whose edges are about `edge_mm` long on average.

    mesh : a manifold, closed or with borders; its own edges may be of any length.
    finer : places that want shorter edges than `edge_mm`.
    crease_deg : edges where the surface turns by more stay edges; the default keeps none, for smooth surfaces.
    mirrored : the half at x > 0 is remeshed and reflected, so that every vertex has an exact mirror image; what is given
    may end anywhere at x < 0.
    Genus and borders stay.  Raises `InputError` for a length that is not above zero and for branching surfaces,
    `SolidError` when details are so much smaller than `edge_mm` that a handle or a tenth of the volume would be lost,
    and `MissingError` without pymeshlab.
    """
    if not edge_mm > 0.0:
        raise InputError(f"an edge length of {edge_mm} mm was asked", "Give a length above 0.")
    if len(mesh.faces) == 0:
        raise InputError(f"mesh {mesh.name or '(unnamed)'} has no faces to remesh", "Give a surface.")
    thin = _thinned(mesh, edge_mm, finer)
    given = _positive_half(thin) if mirrored else thin
    euler, bordered, branching = _topology(given.faces)
    if branching:
        raise InputError(
            f"{mesh.name or 'the surface'} has edges with more than two faces",
            "Repair it first (fabcraft solid).",
        )
    even = given
    passes = _passes(given, edge_mm, finer)
    for length_mm, chosen in passes:
        even = _remeshed(even, length_mm, crease_deg, rounds, chosen)
    if len(passes) > 1:  # a seam between two passes keeps what short edges the surface had there
        even = _remeshed(even, _LEAST_SHARE * passes[-1][0], crease_deg, 2, None, split=False)
    # a half that ends in the plane x = 0 encloses a volume with it, as its cap adds nothing to the divergence
    closed = mirrored or not bordered
    lost = closed and abs(even.volume_mm3 - given.volume_mm3) > _MOST_LOST * abs(given.volume_mm3)
    if lost or _topology(even.faces) != (euler, bordered, False):
        raise SolidError(
            f"{mesh.name or 'the surface'} cannot be meshed with edges of {edge_mm:g} mm: its details are too small",
            "Ask for shorter edges.",
        )
    return reflected(even, 0.1 * edge_mm) if mirrored else even


def _thinned(mesh: Mesh, edge_mm: float, finer: Lengths | None) -> Mesh:
    """The surface with no more faces than remeshing can use: quadrics keep the shape and halve the work."""
    corners = mesh.corners
    wanted = np.full(len(corners), edge_mm) if finer is None else np.minimum(finer(corners.mean(1)), edge_mm)
    useful = _FACES_USED * float((mesh.face_areas / (0.433 * wanted**2)).sum())
    if len(mesh.faces) < 1.25 * useful:
        return mesh
    import fast_simplification

    vertices, faces = fast_simplification.simplify(
        np.array(mesh.vertices), np.array(mesh.faces), 1.0 - useful / len(mesh.faces)
    )
    fewer = _used(Mesh(vertices.astype(np.float64), faces.astype(np.int32), mesh.name))
    return fewer if _topology(fewer.faces) == _topology(mesh.faces) else mesh


Chosen = Callable[[Mesh], np.ndarray] | None
"""Mask of the faces to mesh; None for all."""


def _passes(mesh: Mesh, edge_mm: float, finer: Lengths | None) -> list[tuple[float, Chosen]]:
    """Edge length and faces of every pass, the longest edges first, each about half of the one before."""
    if finer is None:
        return [(edge_mm, None)]
    shortest = min(float(finer(mesh.corners.mean(1)).min()), edge_mm)
    halvings = round(np.log2(edge_mm / shortest))
    step = (shortest / edge_mm) ** (1.0 / max(halvings, 1))

    def near(length: float) -> Callable[[Mesh], np.ndarray]:
        def chosen(part: Mesh) -> np.ndarray:
            wanted = finer(part.corners.mean(1))
            longest = np.inf if length == edge_mm else _OVERLAP * length / np.sqrt(step)
            return (wanted > length * np.sqrt(step)) & (wanted < longest)

        return chosen

    return [(length, near(length)) for length in edge_mm * step ** np.arange(halvings + 1)]


def _remeshed(
    mesh: Mesh, edge_mm: float, crease_deg: float, rounds: int, chosen: Chosen, split: bool = True
) -> Mesh:
    """One run of MeshLab's filter over the chosen faces."""
    try:
        import pymeshlab
    except ImportError as error:
        raise MissingError("remeshing needs pymeshlab", "Run `pip install pymeshlab`.") from error
    faces = np.ones(len(mesh.faces)) if chosen is None else chosen(mesh).astype(np.float64)
    if not faces.any():
        return mesh
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(np.array(mesh.vertices), np.array(mesh.faces), f_scalar_array=faces))
    meshes.compute_selection_by_condition_per_face(condselect="fq > 0.5")
    meshes.meshing_isotropic_explicit_remeshing(
        iterations=rounds,
        targetlen=pymeshlab.PureValue(_MEAN_SHARE * edge_mm),
        featuredeg=crease_deg,
        checksurfdist=False,
        selectedonly=chosen is not None,
        splitflag=split,
    )
    meshes.meshing_remove_unreferenced_vertices()
    result = meshes.current_mesh()
    return Mesh(result.vertex_matrix(), result.face_matrix().astype(np.int32), mesh.name)


def clipped(mesh: Mesh, values: Float64[np.ndarray, " V"]) -> Mesh:
    """What of the surface has positive `values`, linear over its faces, with a border where they are zero."""
    signed = np.where(
        values < 0.0, np.minimum(values, -1e-12), np.maximum(values, 1e-12)
    )  # no vertex on the border
    ends, _, _ = distinct_edges(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2))
    ends = ends[signed[ends[:, 0]] * signed[ends[:, 1]] < 0.0]
    share = (signed[ends[:, 0]] / (signed[ends[:, 0]] - signed[ends[:, 1]]))[:, None]
    cuts = (1.0 - share) * mesh.vertices[ends[:, 0]] + share * mesh.vertices[ends[:, 1]]
    code = ends @ [len(signed), 1]

    def cut(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        low, high = np.minimum(one, other).astype(np.int64), np.maximum(one, other)
        return len(signed) + np.searchsorted(code, low * len(signed) + high)

    inside = signed > 0.0
    pieces = [mesh.faces[inside[mesh.faces].all(1)]]
    for corner in range(3):
        a, b, c = mesh.faces[:, np.roll(np.arange(3), -corner)].T
        lone, pair = inside[a] & ~inside[b] & ~inside[c], ~inside[a] & inside[b] & inside[c]
        pieces.append(np.stack([a, cut(a, b), cut(c, a)], 1)[lone])
        pieces.append(np.stack([cut(a, b), b, c], 1)[pair])
        pieces.append(np.stack([cut(a, b), c, cut(c, a)], 1)[pair])
    faces = np.concatenate(pieces).astype(np.int32)
    return _used(Mesh(np.concatenate([mesh.vertices, cuts]), faces, mesh.name))


def _positive_half(mesh: Mesh) -> Mesh:
    """What of the surface lies at x > 0, with a border in the plane x = 0."""
    vertices = np.array(mesh.vertices)
    x = vertices[:, 0]
    kept = mesh.corners[(x[mesh.faces] > 0.0).any(1)]
    # no vertex next to the plane: no cut leaves a needle
    off = _OFF_PLANE * float(np.linalg.norm(kept - np.roll(kept, 1, axis=1), axis=2).mean())
    x[:] = np.where(np.abs(x) < off, np.where(x < 0.0, -off, off), x)
    return clipped(mesh.with_vertices(vertices), x)


def reflected(half: Mesh, near_mm: float) -> Mesh:
    """The half and its mirror image, joined along its border within `near_mm` of the plane x = 0."""
    directed = half.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    pairs, _, count = distinct_edges(directed)
    vertices = np.array(half.vertices)
    seam = pairs[count == 1]
    rim = np.unique(seam[(np.abs(vertices[seam, 0]) < near_mm).all(1)])  # other borders may end at the plane
    vertices[rim, 0] = 0.0
    image = np.arange(len(vertices)) + len(vertices)
    image[rim] = rim
    faces = np.concatenate([half.faces, image[half.faces][:, ::-1]]).astype(np.int32)
    both = Mesh(np.concatenate([vertices, vertices * [-1.0, 1.0, 1.0]]), faces, half.name)
    return _used(both)


def _used(mesh: Mesh) -> Mesh:
    """The mesh without vertices that no face has."""
    return mesh.submesh(np.ones(len(mesh.faces), dtype=bool))


def _topology(faces: Int32[np.ndarray, "F 3"]) -> tuple[int, int, bool]:
    """Euler number, and whether there are edges with one face and edges with more than two."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1).astype(np.int64)
    _, count = np.unique(edges @ [2**32, 1], return_counts=True)
    return (
        int(len(np.unique(faces)) - len(count) + len(faces)),
        bool((count == 1).any()),
        bool((count > 2).any()),
    )


def isotropic_within(mesh: Mesh, edge_mm: float, chosen: Bool[np.ndarray, " F"]) -> Mesh:
    """The same for the chosen faces alone; the others stay as they are, and what is far is not even looked at.

    Raises `SolidError` when the genus or the borders would change.
    """
    if not chosen.any():
        return mesh
    part = chosen
    for _ in range(_RINGS):
        touched = np.zeros(len(mesh.vertices), dtype=bool)
        touched[mesh.faces[part]] = True
        part = touched[mesh.faces].any(1)
    near = chosen[part]
    even = _remeshed(mesh.submesh(part), edge_mm, _NO_CREASE_DEG, _ROUNDS, lambda _: near)
    if not part.all():
        even = _joined(mesh, ~part, even, edge_mm)
    if _topology(even.faces) != _topology(mesh.faces):
        raise SolidError(
            f"{mesh.name or 'the surface'} cannot be meshed with edges of {edge_mm:g} mm: its details are too small",
            "Ask for shorter edges.",
        )
    return even


def _joined(mesh: Mesh, kept: Bool[np.ndarray, " F"], made: Mesh, edge_mm: float) -> Mesh:
    """The kept faces of the mesh, and what was made of the others, whose border has stayed where it was."""
    rest = mesh.submesh(kept)
    ends, _, faces_at = distinct_edges(rest.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2))
    rim = np.unique(ends[faces_at == 1])
    away, same = cKDTree(made.vertices).query(rest.vertices[rim])
    stayed = away < _ROUNDING * edge_mm
    number = len(rest.vertices) + np.arange(len(made.vertices), dtype=np.int32)
    number[same[stayed]] = rim[stayed]
    faces = np.concatenate([rest.faces, number[made.faces]])
    return _used(Mesh(np.concatenate([rest.vertices, made.vertices]), faces, mesh.name))
