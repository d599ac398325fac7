"""Fewer triangles without losing the guarantee: closed, manifold, and no face through another.

`manifold3d`'s simplification keeps the manifold and moves the surface by less than a tolerance, but on
thin walls two sheets may come to cross. So every result is tested, and a smaller tolerance tried until none
does.
"""

import manifold3d
import numpy as np
from jaxtyping import Bool

from fabcraft.errors import SolidError
from fabcraft.geometry.crossing import self_intersecting_faces
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.isotropic import isotropic_within
from fabcraft.mesh import Mesh
from fabcraft.solid.manifolds import to_manifold, to_mesh, try_manifold

_SHARES = (1.0, 0.96, 0.92, 0.88, 0.84, 0.8, 0.5, 0.25, 0.125)
"""Tolerances to try, over the one asked: a little less often rids the result of a needle, half of a crossing."""
_NEEDLE_MM = 1e-5
_RINGS = 2


def simplify(mesh: Mesh, tolerance_mm: float) -> tuple[Mesh, float]:
    """The closed mesh with as few faces as a deviation below `tolerance_mm` allows, and the tolerance
    that held.

    Needles that are left are meshed anew; smaller tolerances are tried while faces cross; 0 means that the mesh came back
    as it was.
    Raises `SolidError` when the input is not a closed manifold.
    """
    return simplify_manifold(to_manifold(mesh), tolerance_mm, mesh.name)


def simplify_manifold(solid: manifold3d.Manifold, tolerance_mm: float, name: str = "") -> tuple[Mesh, float]:
    """`simplify` for what is a manifold already; where two solids have been joined, needles are meshed anew first."""
    joined = to_mesh(solid, name)
    if (fewer := _needles(joined)).any():
        solid = to_manifold(_without(joined, fewer))
    sound: tuple[Mesh, float] | None = None
    for share in _SHARES if tolerance_mm > 0 else ():
        smaller = to_mesh(solid.simplify(share * tolerance_mm), name)
        if not len(smaller.faces) or len(self_intersecting_faces(smaller)):
            continue
        if not (flat := _needles(smaller)).any():
            return smaller, share * tolerance_mm
        mended = _without(smaller, flat)
        if not _needles(mended).any() and not len(self_intersecting_faces(mended)):
            return mended, share * tolerance_mm
        sound = sound or (smaller, share * tolerance_mm)
    return sound or (to_mesh(solid, name), 0.0)


def _needles(mesh: Mesh) -> Bool[np.ndarray, " F"]:
    """Faces so flat that a slicer would drop them."""
    corners = mesh.corners
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(1)
    flat: Bool[np.ndarray, " F"] = 2.0 * mesh.face_areas <= _NEEDLE_MM * longest
    return flat


def _without(mesh: Mesh, needles: Bool[np.ndarray, " F"]) -> Mesh:
    """The mesh with new, even triangles around its needles; as it was where that is not possible."""
    near = np.zeros(len(mesh.vertices), dtype=bool)
    near[mesh.faces[needles]] = True
    for _ in range(_RINGS):
        near[mesh.faces[near[mesh.faces].any(1)]] = True
    around = near[mesh.faces].any(1)
    edges = np.linalg.norm(mesh.corners - np.roll(mesh.corners, 1, axis=1), axis=2)[around]
    try:
        return isotropic_within(mesh, float(np.median(edges)), around)
    except SolidError:
        return mesh


def reduce_faces(mesh: Mesh, at_most: int, tolerance_mm: float = 0.5) -> Mesh:
    """The closed mesh with `at_most` faces, for a file limit.

    Quadric edge collapse first (fast_simplification, no guarantee of its own); where its result is no
    manifold or crosses itself, tolerances from 0.02 mm upward until the count fits. Raises `SolidError`
    when `tolerance_mm` does not suffice.
    """
    import fast_simplification

    if len(mesh.faces) <= at_most:
        return mesh
    solid = to_manifold(mesh)
    vertices, faces = fast_simplification.simplify(
        np.array(mesh.vertices), np.array(mesh.faces), target_count=at_most
    )
    quick = Mesh(vertices.astype(np.float64), faces.astype(np.int32), mesh.name)
    if _keeps(mesh, solid, quick, at_most, tolerance_mm):
        return quick
    tolerance = 0.02
    while tolerance <= tolerance_mm:
        smaller = to_mesh(solid.simplify(tolerance), mesh.name)
        if _keeps(mesh, solid, smaller, at_most, tolerance_mm):
            return smaller
        tolerance *= 1.5
    raise SolidError(
        f"{len(mesh.faces)} faces cannot become {at_most} with a deviation below {tolerance_mm:g} mm",
        "Allow more faces or a larger tolerance.",
    )


def _keeps(mesh: Mesh, solid: manifold3d.Manifold, smaller: Mesh, at_most: int, tolerance_mm: float) -> bool:
    """Whether `smaller` fits the budget and is the same object: sound, same parts and genus, in place."""
    if not 4 <= len(smaller.faces) <= at_most:
        return False
    result = try_manifold(smaller)
    if result is None or _topology(result) != _topology(solid):
        return False
    moved = SurfaceDistance(smaller).closest(mesh.vertices).distances.max()
    return bool(moved <= tolerance_mm + 1e-6) and len(self_intersecting_faces(smaller)) == 0


def _topology(solid: manifold3d.Manifold) -> list[int]:
    """The genus of every shell, sorted."""
    return sorted(shell.genus() for shell in solid.decompose())
