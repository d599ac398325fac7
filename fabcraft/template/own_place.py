"""Where a user's own mesh sits on a body: by a transform, by landmarks, and on which part.

Points in a user's files are in the mesh's own frame, mm, as it is read (Z up).
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from fabcraft.body.body import Body
from fabcraft.body.parts import PARTS, cut_of
from fabcraft.body.scan_marks import read_marks
from fabcraft.errors import InputError
from fabcraft.geometry.align import Similarity, fit_similarity
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh
from fabcraft.read.table_file import read_table

Points = Mapping[str, Float64[np.ndarray, "3"]]

_MISSED = 0.1
"""Landmarks that are missed by more than this share of their spread (rms) do not belong to this body."""


def by_transform(path: str) -> Similarity:
    """The placement that a file gives as a 4 x 4 matrix: rotation, one scale and a shift.

    Raises `InputError` for a file that cannot be read and for any other matrix.
    """
    found = read_table(path, "transform file")
    rows = found.get("transform") if isinstance(found, dict) else found
    name = Path(path).name
    try:
        matrix = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError):
        matrix = np.zeros(0)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all() or (matrix[3] != [0, 0, 0, 1]).any():
        raise InputError(
            f"{name} holds no 4 x 4 matrix of finite numbers that ends in the row 0, 0, 0, 1",
            "Write transform = [[...], [...], [...], [0, 0, 0, 1]], rows of a matrix for columns of points in mm.",
        )
    turn = matrix[:3, :3]
    scale = float(np.cbrt(max(np.linalg.det(turn), 0.0)))
    if not 1e-4 < scale < 1e4 or np.abs(turn @ turn.T / scale**2 - np.eye(3)).max() > 1e-3:
        raise InputError(
            f"{name} mirrors, shears or flattens", "Give a rotation, one scale for all axes, and a shift."
        )
    return Similarity(scale, turn / scale, matrix[:3, 3])


def by_landmarks(path: str, places: Points, scaled: bool) -> tuple[Similarity, str]:
    """(the placement that brings the points of a landmark file onto those of the body, a note of how well).

    places : landmarks and joints of the body, mm.  Raises `InputError` for a file that cannot be read, names fewer than
    three places or places on a line, or does not fit this body.
    """
    marks, name = read_marks(path, sorted(places)), Path(path).name
    source, target = (np.array([table[mark] for mark in marks]) for table in (marks, places))
    spread = np.linalg.svd(source - source.mean(0), compute_uv=False) if len(marks) > 2 else np.zeros(3)
    if spread[1] < 1e-2 * max(spread[0], 1e-9):
        raise InputError(
            f"{name} names {len(marks)} landmarks{' on one line' if len(marks) > 2 else ''}",
            "Name at least three that are not on one line.",
        )
    found = fit_similarity(source, target, (0.0, np.inf) if scaled else (1.0, 1.0))
    reach = float(np.sqrt(((target - target.mean(0)) ** 2).sum(1).mean()))
    if found.rms > _MISSED * reach:
        hint = "" if scaled else ", its unit, or allow a scale (--template-scale)"
        raise InputError(
            f"the landmarks of {name} miss those of the body by {found.rms:.1f} mm (rms)",
            f"Check that the points are the mesh's own, in mm{hint}.",
        )
    note = f"It was placed by {len(marks)} landmarks, {found.rms:.1f} mm off (rms), scaled {found.scale:.3g} times."
    return found, note


def part_for(mesh: Mesh, body: Body) -> Body:
    """The part of `body` that wears `mesh`: the one it lies within whose middle is nearest; all of it where none does."""
    middle, vertices = mesh.bounds.mean(0), mesh.vertices
    near = []
    for name in PARTS:
        try:
            cut = body.cuts.get(name) or cut_of(name, body.name, body.joints, body.landmarks)
        except InputError:  # a body without that part
            continue
        if all(((vertices - point) @ normal > 0.0).all() for point, normal in cut.planes):
            near.append((float(np.linalg.norm(cut.anchor - middle)), name))
    if not near:
        return body
    part, away = body.part(min(near)[1]), SurfaceDistance(body.mesh).closest(middle[None]).distances[0]
    # the planes of a hand go on through the rest of the body
    beside = SurfaceDistance(part.mesh).closest(middle[None]).distances[0] > away + 0.1 * mesh.size_mm.max()
    return body if beside else part
