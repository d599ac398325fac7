"""Balls inside a solid, and how far they vouch for its thickness: the machinery of `thickness`.

A `Balls` holds the largest ball found at every sample. `opening_values` joins what they vouch for into the
opening thickness T (see `thickness` for the definition).
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.rays import Rays
from fabcraft.mesh import Mesh

CORNER_GAP = 0.37
"""Gap between a ball and a point it vouches for, in diameters."""
TOLERANCE = 0.02  # of the minimum wall: facets cut a round wall a little
"""Share of the minimum wall that facets may cut off a round wall."""
_BALL_SLACK_MM = 0.01  # how deep a ball may cut the surface: facets of a fine mesh are not edges
_RAY_START_MM = 1e-3  # under the face that the ray starts from
_NICK = 0.1  # of the radius: a gap that small is vouched for from a quarter of the radius on
_LEVEL_RATIO = 0.8
_LOWEST_LEVEL = 0.25  # of the minimum wall; thinner is thin enough to fail


@dataclass(frozen=True, eq=False)
class Balls:
    """The largest ball of every sample: it touches at `anchors`, which are the samples or just under them."""

    points: np.ndarray
    anchors: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    areas: np.ndarray
    diameters: np.ndarray
    ray_mm: np.ndarray


def spread(mesh: Mesh, areas: np.ndarray, spacing: float, keep: np.ndarray | None = None) -> tuple:
    """Samples at most about `spacing` apart, in rows along every face's longest side: points, faces, areas.

    Rows keep slivers as evenly covered as compact faces; every sample stands for its exact share of its row.
    """
    face = np.flatnonzero((areas > 1e-12) & (keep if keep is not None else True))
    corners = mesh.corners[face]
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    first = sides.argmax(1)
    a, b, c = (corners[np.arange(len(face)), (first + step) % 3] for step in range(3))
    base = sides.max(1)
    rows = np.maximum(1, np.ceil(2 * areas[face] / base / spacing)).astype(np.int64)
    owner, rank = _counted(rows)
    # The middle of a row; a face of one row is sampled at the height of its centre.
    height = np.where(rows[owner] == 1, 1 / 3, (rank + 0.5) / rows[owner])
    row_area = areas[face][owner] * (2 - (2 * rank + 1) / rows[owner]) / rows[owner]
    count = np.maximum(1, np.ceil(base[owner] * (1 - height) / spacing)).astype(np.int64)
    row, place = _counted(count)
    # Neighbouring rows and faces are staggered; a row of one sample has it in the middle.
    start = np.where(count[row] == 1, 0.5, (row * 0.6180339887498949) % 1.0)
    along, up, owner = ((place + start) / count[row])[:, None], height[row][:, None], owner[row]
    points = (1 - up) * ((1 - along) * a[owner] + along * b[owner]) + up * c[owner]
    return points, face[owner], row_area[row] / count[row]


def _counted(count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For counts (3, 2): owners 0 0 0 1 1 and ranks 0 1 2 0 1."""
    owner = np.repeat(np.arange(len(count)), count)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)


def tangent_balls(mesh: Mesh, samples: tuple, distance: SurfaceDistance, rays: Rays, limit: float) -> Balls:
    """Shrink a ball at every sample, from half the way through the wall, until nothing cuts it.

    A first ball that is only nicked (facets of a round wall do that) is kept, a little smaller, off the
    surface.
    """
    points, faces, areas = samples
    normals = mesh.face_normals[faces]
    through = rays.distances(points - _RAY_START_MM * normals, -normals) + _RAY_START_MM
    half = np.minimum(through, limit) / 2
    free = distance.closest(points - half[:, None] * normals).distances
    # Both are allowed the slack, so that the ball that fits exactly is the tangent one.
    radius = np.minimum(free + _BALL_SLACK_MM, half)
    anchors = points - (half - radius)[:, None] * normals
    active = np.flatnonzero(half - radius > _NICK * radius)
    radius[active], anchors[active] = half[active], points[active]
    for _ in range(12):
        nearest = distance.closest(points[active] - radius[active, None] * normals[active])
        cut = nearest.distances < radius[active] - _BALL_SLACK_MM - 1e-6
        active, foot = active[cut], nearest.points[cut]
        if len(active) == 0:
            break
        # |q - r n - x| >= r - slack with u = q - x:  r <= (u.u - slack²) / 2(n.u - slack)
        u = points[active] - foot
        reach = np.einsum("ij,ij->i", u, normals[active]) - _BALL_SLACK_MM
        bound = ((u * u).sum(1) - _BALL_SLACK_MM**2) / np.maximum(2 * reach, 1e-12)
        radius[active] = np.clip(bound, 0.0, np.where(reach > 0, radius[active], 0.0))
    return Balls(points, anchors, normals, faces, areas, 2 * radius, through)


def stopped_by_edge(balls: Balls, share: float, limit: float) -> np.ndarray:
    """Samples whose ball is stopped by something nearer than the opposite wall."""
    return balls.diameters < share * np.minimum(balls.ray_mm, limit)


def levels_up_to(need: float, limit: float) -> list[float]:
    """Diameters from 0.25 of the minimum wall to the limit; the minimum itself, less the
    tolerance, is one of them."""
    need *= 1 - TOLERANCE
    down = [need * _LEVEL_RATIO**step for step in range(20)]
    up = [need / _LEVEL_RATIO**step for step in range(1, 20)]
    return sorted([s for s in down if s >= _LOWEST_LEVEL * need] + [s for s in up if s < limit] + [limit])


def opening_values(
    asked: Balls, supply: Balls, levels: list[float], limit: float, slack: float
) -> np.ndarray:
    """T at the samples `asked`, with the balls of `supply`; `slack` makes up for the spacing of the balls."""
    values = np.maximum(asked.diameters, levels[0])
    alive = np.ones(len(values), dtype=bool)
    # Where the opposite wall stops the ball, no neighbour's reaches further: nothing to gain below the level.
    edge = stopped_by_edge(asked, 0.985, limit)
    before: tuple | None = None
    for level in levels:
        waiting = np.flatnonzero(alive & (values < level - 1e-9))
        kept = np.flatnonzero(supply.diameters >= level - 1e-9)
        if len(kept) == 0:
            _polish(asked, supply, values, waiting[edge[waiting]], before, slack)
            break
        if len(waiting) == 0:
            continue
        tree = cKDTree(supply.anchors[kept] - level / 2 * supply.normals[kept], balanced_tree=False)
        reach = (0.5 + CORNER_GAP) * level + slack
        gap, found = tree.query(asked.points[waiting], distance_upper_bound=reach, workers=2)
        near = np.isfinite(gap)
        values[waiting[near]] = np.maximum(level, supply.diameters[kept[found[near]]])
        # The chain of intervals broke between the level before and this one.
        broken = waiting[~near]
        alive[broken] = False
        _polish(asked, supply, values, broken[edge[broken]], before, slack)
        before = (tree, kept)
    return np.minimum(values, limit)


def _polish(
    asked: Balls, supply: Balls, values: np.ndarray, which: np.ndarray, before: tuple | None, slack: float
) -> None:
    """Between two levels: the largest ball near enough at the level before that still vouches (in place)."""
    if before is None or len(which) == 0:
        return
    tree, kept = before
    gap, found = tree.query(
        asked.points[which], k=min(48 if len(which) < 20_000 else 12, len(kept)), workers=2
    )
    ball = kept[found.reshape(len(which), -1)]
    radius = supply.diameters[ball] / 2
    centre = supply.anchors[ball] - radius[..., None] * supply.normals[ball]
    gap = np.linalg.norm(centre - asked.points[which][:, None], axis=2) - radius
    vouched = gap <= CORNER_GAP * values[which][:, None] + slack
    values[which] = np.maximum(values[which], np.where(vouched, 2 * radius, 0.0).max(1))


def joined(one: Balls, other: Balls) -> Balls:
    return Balls(*(np.concatenate(pair) for pair in zip(_arrays(one), _arrays(other), strict=True)))


def chosen(balls: Balls, keep: np.ndarray) -> Balls:
    return Balls(*(array[keep] for array in _arrays(balls)))


def _arrays(balls: Balls) -> tuple[np.ndarray, ...]:
    return balls.points, balls.anchors, balls.normals, balls.faces, balls.areas, balls.diameters, balls.ray_mm
