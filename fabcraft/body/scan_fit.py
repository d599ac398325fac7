"""A part of the model of people, bent onto a scan: size, place, person and pose, then what is left.

`fitted` alternates closest points and Gauss-Newton steps (`scan_step`).  `settled` then moves the skin itself onto the
scan by a smooth field (non-rigid ICP after Amberg et al. 2007, with the graph Laplacian), so that a person whom the
model does not know is followed too.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64
from scipy.interpolate import RBFInterpolator
from scipy.sparse import diags
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from fabcraft.body.scan_part import PartModel
from fabcraft.body.scan_step import PART_MM, Marks, State, Surface, stepped
from fabcraft.geometry.edges import graph_laplacian

MATCHED = 0.016
"""A point of the part is matched when the scan is nearer than this share of the part's size (4 mm on a hand)."""
_LOOK = 0.25
"""A bent finger's tip is farther off than most of a hand, which is why the part looks this far at first."""
_ROUGHLY = 0.7
"""Share of the steps that look at few points of the part and of the scan."""
_STIFFNESS = (30.0, 8.0, 2.0)
"""Weight of the smooth field's differences along edges against the distances, from round to round."""


@dataclass(frozen=True, eq=False)
class PartFit:
    """The part as it lies in the scan."""

    part: PartModel
    state: State
    points: Float64[np.ndarray, "P 3"]
    """Skin and joints in the scan's frame."""
    rms: float
    """Root mean square distance from the matched zone to the scan, in the scan's unit."""
    misfit: float
    """Mean distance both ways over the part's size, the farthest left out."""
    matched: float
    """Share of the zone that has the scan nearby and turned alike."""


def fitted(
    part: PartModel,
    surface: Surface,
    start: State,
    rounds: int,
    marks: Marks | None = None,
    look: float = _LOOK,
) -> PartFit:
    """The person with whom the part lies best on the scan, from a `start` that is roughly right.

    marks : landmarks that are known; together they weigh as much as the scan.  look : how far the part looks for the
    scan at first, as a share of its size.
    """
    state = start
    for step in range(rounds):
        # first the place alone, then an obstinate person, then the most probable one
        stiff = 1e6 if step < 2 else 10.0 if step < 5 else 1.0
        reach = look * surface.size * max(0.0, 1.0 - step / (0.8 * rounds)) ** 2
        if step < _ROUGHLY * rounds:
            state = stepped(part, part.few, surface.rough, state, marks, stiff, reach)
        else:
            state = stepped(part, part.samples, surface, state, marks, stiff, reach)
    return judged(part, state, surface)


def judged(part: PartModel, state: State, surface: Surface) -> PartFit:
    """The fit with its figures."""
    points = state.points(part)
    chosen = part.zone_samples
    normals = part.mesh(points).vertex_normals[chosen]
    nearest = surface.nearest(points[chosen], normals)
    left, facing = points[chosen] - surface.cloud.points[nearest], surface.cloud.normals[nearest]
    plane, away = np.abs(np.einsum("ij,ij->i", left, facing)), np.linalg.norm(left, axis=1)
    alike = np.einsum("ij,ij->i", normals, facing) > 0.5
    limit = MATCHED * min(surface.size, 2 * PART_MM)
    near = (plane < limit) & (away < 2.5 * limit) & alike
    rms = float(np.sqrt((plane[near] ** 2).mean())) if near.any() else surface.size
    back = np.sort(cKDTree(points[: part.skin]).query(surface.cloud.points[surface.spread])[0])
    misfit = np.minimum(away, 0.1 * surface.size).mean() + back[: int(0.8 * len(back))].mean()
    return PartFit(part, state, points, rms, float(misfit / surface.size), float(near.mean()))


def settled(fit: PartFit, surface: Surface) -> PartFit:
    """The same fit with its skin drawn onto the scan by a smooth field, and the joints carried along."""
    part = fit.part
    skin = part.skin
    start = fit.points[:skin]
    now = start
    laplacian = graph_laplacian(part.faces, skin)
    for stiff in _STIFFNESS:
        normals = part.mesh(now).vertex_normals
        nearest = surface.nearest(now, normals)
        goal, facing = surface.cloud.points[nearest], surface.cloud.normals[nearest]
        away = np.linalg.norm(goal - now, axis=1)
        alike = np.einsum("ij,ij->i", normals, facing)
        reach = max(3.0 * float(np.median(away)), 2.0 * MATCHED * min(surface.size, 2 * PART_MM))
        weight = np.clip(1.0 - (away / reach) ** 2, 0.0, None) * (alike > 0.4) * ~surface.rim[nearest]
        wanted = now + facing * np.einsum("ij,ij->i", facing, goal - now)[:, None] - start
        system = (stiff * laplacian + diags(weight + 1e-6)).tocsc()
        now = start + splu(system).solve(weight[:, None] * wanted)
    return replace(fit, points=np.concatenate([now, _carried(fit.points[skin:], start, now - start)]))


def held_by(fit: PartFit, marks: Marks) -> PartFit:
    """The same fit drawn onto known landmarks by the smoothest field, wherever the surface is."""
    skin = fit.part.skin
    start = fit.points[:skin]
    wanted = marks.points - fit.points[marks.rows]
    on_skin = marks.rows < skin
    weight, goal = np.zeros(skin), np.zeros((skin, 3))
    weight[marks.rows[on_skin]], goal[marks.rows[on_skin]] = 1e3, wanted[on_skin]
    laplacian = graph_laplacian(fit.part.faces, skin)
    bending = laplacian @ laplacian
    moves = splu((bending + diags(weight + 1e-7)).tocsc()).solve(weight[:, None] * goal)
    points = np.concatenate([start + moves, _carried(fit.points[skin:], start, moves)])
    points[marks.rows] = marks.points
    return replace(fit, points=points)


def stretched_to(fit: PartFit, marks: Marks) -> PartFit:
    """The same fit with known landmarks at their places, and everything else moved as its neighbours among them are.

    For a figure, whose skin says nothing of where its places are; far from the landmarks nothing bends.
    """
    field = RBFInterpolator(
        fit.points[marks.rows], marks.points - fit.points[marks.rows], kernel="linear", degree=0
    )
    return replace(fit, points=fit.points + field(fit.points))


def _carried(joints: np.ndarray, skin: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """The joints moved as the skin around them is on average."""
    if not len(joints):
        return joints
    near, which = cKDTree(skin).query(joints, k=40)
    share = 1.0 / np.maximum(near, 1e-6) ** 2
    return joints + np.einsum("jk,jki->ji", share / share.sum(1, keepdims=True), moves[which])
