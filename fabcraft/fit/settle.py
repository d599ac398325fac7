"""After the loop, the promise: a soft penalty leaves residues, so the sheet is pushed out by exact distances.

Rounds of: exact signed distance at vertices and face centres, the missing clearance along the distance's gradient,
spread over the neighbourhood so that the push is a swell and not a dent, and lifted until nothing is missing.
"""

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float64
from scipy.sparse.linalg import splu

from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.operators import laplacian
from fabcraft.mesh import Mesh


def push_out(
    sheet: Mesh,
    distance: SurfaceDistance,
    wanted_mm: Float64[np.ndarray, " V"],
    spread_mm: float = 5.0,
    rounds: int = 8,
    tolerance_mm: float = 0.02,
) -> tuple[Mesh, float]:
    """`sheet` with every vertex and face centre at least `wanted_mm` from the body, and the largest push, mm.

    wanted_mm : distance to the skin per vertex.  spread_mm : how wide a push is felt.
    """
    stiffness = laplacian(sheet.vertices, sheet.faces)
    mass = np.bincount(
        sheet.faces.ravel(), np.repeat(sheet.face_areas / 3.0, 3), minlength=len(sheet.vertices)
    )
    # (M + r² L) x = M b: a screened Laplacian spreads b over about r and keeps its mean
    spread = splu((sparse.diags(mass) + spread_mm**2 * stiffness).tocsc())
    points, largest = sheet.vertices.copy(), 0.0
    for _ in range(rounds):
        missing, direction = _missing(points, sheet.faces, distance, wanted_mm)
        if missing.max(initial=0.0) <= tolerance_mm:
            break
        largest = max(largest, float(missing.max()))
        push = spread.solve(mass[:, None] * (missing[:, None] * direction))
        along = (push * direction).sum(1)
        # the spread push is too weak at its peak: the rest of what is missing is added where it is missing
        push += np.maximum(missing - along, 0.0)[:, None] * direction
        points += push
    return sheet.with_vertices(points), largest


def _missing(
    points: np.ndarray, faces: np.ndarray, distance: SurfaceDistance, wanted_mm: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Per vertex, how much its own or its faces' clearance lacks, and the way out."""
    centres = points[faces].mean(1)
    signed, gradient = distance.signed_with_gradient(np.concatenate([points, centres]))
    lacking = np.maximum(np.concatenate([wanted_mm, wanted_mm[faces].mean(1)]) - signed, 0.0)
    missing = lacking[: len(points)].copy()
    for corner in range(3):
        np.maximum.at(missing, faces[:, corner], lacking[len(points) :])
    return missing, gradient[: len(points)]
