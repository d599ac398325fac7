"""Fewer triangles without losing the guarantee: closed, manifold, and no face through another.

`manifold3d`'s simplification keeps the manifold and moves the surface by less than a tolerance, but on
thin walls two sheets may come to cross. So every result is tested, and the tolerance halved until none
does.
"""

import manifold3d
import numpy as np

from fabcraft.errors import SolidError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh
from fabcraft.solid.crossing import self_intersecting_faces
from fabcraft.solid.manifolds import to_manifold, to_mesh, try_manifold

_HALVINGS = 4


def simplify(mesh: Mesh, tolerance_mm: float) -> tuple[Mesh, float]:
    """The closed mesh with as few faces as a deviation below `tolerance_mm` allows, and the tolerance
    that held.

    The tolerance is halved up to four times while faces cross; 0 means that the mesh came back as it was.
    Raises `SolidError` when the input is not a closed manifold.
    """
    return simplify_manifold(to_manifold(mesh), tolerance_mm, mesh.name)


def simplify_manifold(solid: manifold3d.Manifold, tolerance_mm: float, name: str = "") -> tuple[Mesh, float]:
    """`simplify` for what is a manifold already."""
    tolerance = tolerance_mm
    for _ in range(_HALVINGS):
        if tolerance <= 0:
            break
        smaller = to_mesh(solid.simplify(tolerance), name)
        if len(smaller.faces) and len(self_intersecting_faces(smaller)) == 0:
            return smaller, tolerance
        tolerance /= 2
    return to_mesh(solid, name), 0.0


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
