"""As many triangles as a scan needs: thinned where it has far too many, halved where it has too few.

Thinning is by quadric error (Garland and Heckbert 1997): fast-simplification as long as there are very many triangles,
then MeshLab's, which keeps borders and topology.  How far the surface moved is measured on points of the scan as it
was, and stated.
"""

import numpy as np
from jaxtyping import Bool, Float64
from scipy.sparse import diags, identity
from scipy.spatial import cKDTree

from fabcraft.body.body import rim_loops
from fabcraft.body.scan_search import Cloud
from fabcraft.geometry.align import spread_points
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.edges import Length, graph_laplacian, split_edges
from fabcraft.geometry.sampling import area_samples
from fabcraft.mesh import Mesh

MAX_FACES = 45_000
"""Scans are thinned to this; closing and refining add a little."""
_QUICKLY = 2.5
"""Above this many times the wanted triangles the quick method is used."""
_MOST_REFINED = 50_000
"""Refining ends with at most this many triangles."""
_PROBES = 20_000
_POINTS = 40_000
"""A mesh with fewer vertices is seen by this many points."""
_SMOOTHING = 2
"""Rounds in which every normal is averaged with its neighbours', against the noise of a scan."""
_NEAR, _GROWTH = 0.1, 0.25
"""Of a part's size: how far from its places the fine edges go, and how much longer edges may be per distance."""


def thinned(mesh: Mesh, most: int = MAX_FACES) -> Mesh:
    """`mesh` with about `most` triangles if it has more."""
    if len(mesh.faces) <= most:
        return mesh
    import fast_simplification
    import pymeshlab

    vertices, faces = (
        mesh.vertices.copy(),
        mesh.faces.copy(),
    )  # both libraries want arrays they could write to
    if len(faces) > _QUICKLY * most:
        vertices, faces = fast_simplification.simplify(vertices, faces, target_count=round(_QUICKLY * most))
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertices.astype(np.float64), faces.astype(np.int32)))
    meshes.meshing_decimation_quadric_edge_collapse(
        targetfacenum=most, preserveboundary=True, preservenormal=True, preservetopology=True
    )
    thin = meshes.current_mesh()
    return Mesh(thin.vertex_matrix(), thin.face_matrix().astype(np.int32), mesh.name)


def thinning_note(before: Mesh, after: Mesh, to_mm: float) -> tuple[str, ...]:
    """How far `after` lies from `before`, measured at evenly spread vertices; `to_mm` is their unit."""
    if len(after.faces) == len(before.faces):
        return ()
    used = np.unique(before.faces)
    probes = before.vertices[used][spread_points(before.vertices[used], _PROBES)]
    away = to_mm * SurfaceDistance(after).closest(probes).distances
    return (
        f"The scan was thinned from {len(before.faces):,} to {len(after.faces):,} triangles; its surface moved by "
        f"{away.mean():.2f} mm on average, {np.quantile(away, 0.999):.2f} mm at 99.9 % of the places measured.",
    )


def seen(mesh: Mesh) -> tuple[Cloud, Bool[np.ndarray, " N"]]:
    """(points with smoothed normals that cover `mesh`, which of them lie at a border of it)."""
    laplacian = graph_laplacian(mesh.faces, len(mesh.vertices))
    mean = (
        identity(len(mesh.vertices), format="csr")
        - diags(1.0 / np.maximum(laplacian.diagonal(), 1.0)) @ laplacian
    )
    normals = mesh.vertex_normals
    for _ in range(_SMOOTHING):
        normals = normals + mean @ normals
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    rims = [np.stack([loop, np.roll(loop, -1)], 1) for loop in rim_loops(mesh.faces)]
    rim = np.concatenate(rims) if rims else np.zeros((0, 2), dtype=np.int64)
    spacing = float(np.sqrt(mesh.area_mm2 / _POINTS))
    points = mesh.vertices
    if (lacking := _POINTS - len(points)) > 0:
        face, weights = area_samples(mesh.face_areas, lacking, np.random.default_rng(0))
        points = np.concatenate([points, np.einsum("sc,scx->sx", weights, mesh.corners[face])])
        normals = np.concatenate([normals, mesh.face_normals[face]])
    if not len(rim):
        return Cloud(points, normals), np.zeros(len(points), dtype=bool)
    ends = mesh.vertices[rim]
    steps = int(np.clip(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max() / spacing, 1, 50)) + 1
    along = ends[:, :1] + np.linspace(0.0, 1.0, steps)[None, :, None] * (ends[:, 1:] - ends[:, :1])
    return Cloud(points, normals), cKDTree(along.reshape(-1, 3)).query(points)[0] < 1.5 * spacing


def refined(mesh: Mesh, places: Float64[np.ndarray, "P 3"], fine_mm: float, coarse_mm: float) -> Mesh:
    """The same surface with edges up to `fine_mm` near `places`, growing with the distance to `coarse_mm`."""
    tree = cKDTree(places)
    reach = _NEAR * float(np.ptp(places, axis=0).max())
    coarse_from = 1.001 * ((coarse_mm - fine_mm) / _GROWTH + reach)

    def longest(middles: np.ndarray) -> np.ndarray:
        # from `coarse_from` on the tree answers inf, without a search
        away = np.maximum(tree.query(middles, distance_upper_bound=coarse_from)[0] - reach, 0.0)
        return np.minimum(fine_mm + _GROWTH * away, coarse_mm)

    # a face of area A comes apart into about A / (0.2 l²); where that is too much, all edges may be longer
    counts = mesh.face_areas / (0.2 * longest(mesh.corners.mean(1)) ** 2)
    factor = 1.0
    while np.maximum(counts / factor**2, 1.0).sum() > _MOST_REFINED and factor < 10.0:
        factor *= 1.1
    while factor < 10.0:  # the estimate is a little low, so it is tried
        finer = split_edges(mesh, _times(longest, factor), _MOST_REFINED)
        if len(finer.faces) <= _MOST_REFINED:
            return finer
        factor *= 1.1
    return mesh


def _times(length: Length, factor: float) -> Length:
    return lambda middles: factor * length(middles)
