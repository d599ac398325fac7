"""As many triangles as a scan needs: thinned where it has far too many, halved where it has too few.

Thinning is by quadric error (Garland and Heckbert 1997, fast-simplification); how far the surface moved is measured on
points of the scan as it was, and stated.
"""

import numpy as np
from jaxtyping import Float64
from scipy.spatial import cKDTree

from fabcraft.geometry.align import spread_points
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.edges import split_edges
from fabcraft.mesh import Mesh

MAX_FACES = 50_000
"""Scans are thinned to this; closing and refining add a little."""
_PROBES = 20_000
_NEAR, _GROWTH = 0.1, 0.25
"""Of a part's size: how far from its places the fine edges go, and how much longer edges may be per distance."""


def thinned(mesh: Mesh, most: int = MAX_FACES) -> Mesh:
    """`mesh` with about `most` triangles if it has more."""
    if len(mesh.faces) <= most:
        return mesh
    import fast_simplification

    # copies, since the library takes only arrays that it could write to
    vertices, faces = fast_simplification.simplify(
        mesh.vertices.copy(), mesh.faces.copy(), target_count=most
    )
    return Mesh(np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int32), mesh.name)


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


def refined(mesh: Mesh, places: Float64[np.ndarray, "P 3"], fine_mm: float, coarse_mm: float) -> Mesh:
    """The same surface with edges up to `fine_mm` near `places`, growing with the distance to `coarse_mm`."""
    tree = cKDTree(places)
    reach = _NEAR * float(np.ptp(places, axis=0).max())

    def longest(middles: np.ndarray) -> np.ndarray:
        away = np.maximum(tree.query(middles)[0] - reach, 0.0)
        return np.minimum(fine_mm + _GROWTH * away, coarse_mm)

    return split_edges(mesh, longest)
