"""`lay`: the rims of a flat sheet come to lie exactly on their contours, without a face turning over.

Rims go to their matched places (evenly enough apart, corners kept) and the inside follows harmonically. Where a whole
step would turn a face over, the sheet goes as far of the way as it can, is meshed anew, and tries again: what is left of
the way shrinks, so long features are grown in a few rounds rather than folded in one. So it is where rim edges came out
too long to follow the contour.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree

from fabcraft.errors import InputError
from fabcraft.fit.contour_match import match
from fabcraft.geometry.contour import resample
from fabcraft.geometry.operators import laplacian
from fabcraft.geometry.triangulate import PlaneMesh, triangulate

ROUNDS = 8
"""Remeshings before the contours alone are meshed; the six example drawings take at most two."""
SPACING = 0.35
"""Rim vertices stay apart by this share of an even step."""
LONGEST = 1.8
"""A rim edge longer than this share of the wanted edge would cut the contour's curves: the sheet is meshed once more."""
POCKET_DEG = 110.0
"""A rim that turns by more than this away from its contour has run into the sheet and back."""
BLUNT_DEG = 40.0
"""So much more has it to be where it turns over two vertices."""
THINNEST = 0.05
"""Smallest face that may come about, in squared edges (an even triangle has 0.43); twice its area."""


@dataclass(frozen=True, eq=False)
class Laid:
    """A sheet whose rims are on their contours."""

    sheet: PlaneMesh
    moved_mm: float
    """Farthest that a rim vertex was from its place at the start, mm."""
    remeshed: int
    """How many times the sheet was meshed anew on the way."""
    from_contours: bool
    """No way was found in `ROUNDS`: the mesh was made from the contours alone."""


def lay(sheet: PlaneMesh, contours: list[Float64[np.ndarray, "_ 2"]], edge_mm: float) -> Laid:
    """Lay the rims of `sheet` on `contours` (one for each of its loops, evenly sampled), mm."""
    moved_mm = float(max(np.linalg.norm(step, axis=1).max() for step in _steps(sheet, contours, edge_mm)))
    now = sheet
    for remeshed in range(ROUNDS):
        shift = _followed(now, np.concatenate(_steps(now, contours, edge_mm)))
        share = _farthest(now, shift, THINNEST * edge_mm**2)
        now = PlaneMesh(now.points + share * shift, now.faces, now.loops)
        if share == 1.0 and _longest_rim_edge(now) <= LONGEST * edge_mm:
            return Laid(now, moved_mm, remeshed, False)
        try:
            now = remeshed_between(now, contours, edge_mm)
        except InputError:  # a rim that crosses itself encloses nothing
            break
        if len(now.loops) != len(contours):
            break
    evenly = [resample(contour, edge_mm, corner_reach=1.2 * edge_mm) for contour in contours]
    return Laid(triangulate(evenly, edge_mm, resampled=True), moved_mm, ROUNDS, True)


def remeshed_between(
    sheet: PlaneMesh, contours: list[Float64[np.ndarray, "_ 2"]], edge_mm: float
) -> PlaneMesh:
    """The sheet meshed evenly between its rims, their pockets opened.

    A pocket is where a rim has run into the sheet and back: it turns by more than 110 degrees away from the contour that
    it is to lie on. The vertices where it turns are left out, which opens it from its end.
    Raises `InputError` when the rims enclose no area.
    """
    rims = [
        _opened(sheet.points[loop], contour, 0.5 * edge_mm)
        for loop, contour in zip(sheet.loops, contours, strict=True)
    ]
    return triangulate(rims, edge_mm)


def _opened(
    rim: Float64[np.ndarray, "N 2"], contour: Float64[np.ndarray, "M 2"], away_mm: float
) -> Float64[np.ndarray, "K 2"]:
    """The rim without its pockets."""
    away = cKDTree(contour).query(rim)[0] > away_mm
    while len(rim) > 8:
        before, after = rim - np.roll(rim, 1, axis=0), np.roll(rim, -1, axis=0) - rim
        cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
        turn = np.where(away, np.degrees(np.arctan2(cross, (before * after).sum(1))), 0.0)
        both = np.abs(turn + np.roll(turn, -1))  # a blunt end turns in two steps
        if max(np.abs(turn).max(), both.max() - BLUNT_DEG) <= POCKET_DEG:
            break
        kept = np.ones(len(rim), dtype=bool)
        if np.abs(turn).max() >= both.max() - BLUNT_DEG:
            kept[np.abs(turn).argmax()] = False
        else:
            kept[[both.argmax(), (both.argmax() + 1) % len(rim)]] = False
        rim, away = rim[kept], away[kept]
    return rim


def _steps(
    sheet: PlaneMesh, contours: list[Float64[np.ndarray, "_ 2"]], edge_mm: float
) -> list[Float64[np.ndarray, "_ 2"]]:
    """For every loop, what takes its vertices to their places."""
    return [
        match(sheet.points[loop], contour, spacing=SPACING, corner_reach=1.2 * edge_mm) - sheet.points[loop]
        for loop, contour in zip(sheet.loops, contours, strict=True)
    ]


def _followed(sheet: PlaneMesh, of_rims: Float64[np.ndarray, "R 2"]) -> Float64[np.ndarray, "V 2"]:
    """The shift of every vertex: the rims' own, and the harmonic one between them."""
    rims = np.concatenate(sheet.loops)
    flat = np.column_stack([sheet.points, np.zeros(len(sheet.points))])
    stiffness = laplacian(flat, sheet.faces).tocsc()
    free = np.setdiff1d(np.arange(len(flat)), rims)
    shift = np.zeros_like(sheet.points)
    shift[rims] = of_rims
    pull = -(stiffness[free][:, rims] @ of_rims)
    shift[free] = spsolve(stiffness[free][:, free], pull).reshape(len(free), 2)
    return shift


def _farthest(sheet: PlaneMesh, shift: Float64[np.ndarray, "V 2"], thinnest: float) -> float:
    """Largest of 1, 1/2, 1/4, ... of the shift that leaves every face larger than `thinnest`, or half of what it was."""
    least = np.minimum(thinnest, 0.5 * _twice_areas(sheet.points, sheet.faces))
    share = 1.0
    while share > 1e-3 and (_twice_areas(sheet.points + share * shift, sheet.faces) < least).any():
        share *= 0.5
    return share


def _longest_rim_edge(sheet: PlaneMesh) -> float:
    rims = [sheet.points[loop] for loop in sheet.loops]
    return float(max(np.linalg.norm(np.roll(rim, -1, axis=0) - rim, axis=1).max() for rim in rims))


def _twice_areas(points: Float64[np.ndarray, "V 2"], faces: np.ndarray) -> Float64[np.ndarray, " F"]:
    a, b, c = points[faces].transpose(1, 0, 2)
    return (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
