"""A guidance mesh brought onto the object it is to guide: any scale, up axis and facing.

24 axis-aligned turns, each refined a little by similarity ICP on spread points; the best is refined to the end. Its scale
starts from the sizes of the two and may change by 40 % either way, or is kept. A symmetric one on a symmetric one is kept
upright.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64
from scipy.spatial import cKDTree

from fabcraft.errors import InputError
from fabcraft.geometry.align import Similarity, axis_rotations, settled_on, similarity_icp
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.sampling import area_samples
from fabcraft.mesh import Mesh
from fabcraft.template.own_place import by_transform

WORST = 0.1
"""A match that misses by more than this share of the object's size is refused."""
_COARSE, _FINE = 400, 2500
_REFINED = 6
"""So many of the turns are refined to the end: coarse points rank them roughly."""
_KEPT = 0.9
"""Share of the pairs that ICP goes by: horns are few points, and say more about the turn than the ball they stand on."""

_ADVICE = ", say where it lies (--guidance-transform), or take it as it is (--force)."
_EVEN = 0.01
"""Of its size: a mesh that misses its mirror image by less on average is symmetric."""
_SLID = 0.75
"""Share of the points that the last millimetres go by: there, horns and lumps only pull."""
_ALIKE, _LEAST_SIDE, _RESIZED, _WORTH = 0.5, 0.4, 1.8, 0.8
"""Cosine with the seat's normals from which on a face looks at the skin too, how much of the seat's area such faces need,
by which factor the seat may change the size, and what share of the miss a change must leave at most to be worth it."""

_Points = tuple[Float64[np.ndarray, "K 3"], Float64[np.ndarray, "K 3"]]
"""Places, and the normals there."""


@dataclass(frozen=True, eq=False)
class Aligned:
    """A guidance mesh where its object is."""

    mesh: Mesh
    """mm."""
    residual: float
    """Mean distance between the two surfaces, both ways, over the object's longest side."""
    placed: Similarity
    """What was done to it."""

    @property
    def turned_deg(self) -> float:
        """Angle of the turn."""
        return float(np.degrees(np.arccos(np.clip(0.5 * (np.trace(self.placed.rotation) - 1.0), -1.0, 1.0))))

    @property
    def scaled(self) -> float:
        """Factor of the size."""
        return self.placed.scale

    given: bool = False
    """Its user said where it lies."""

    @property
    def words(self) -> str:
        """What was done, for the report."""
        done = (
            "placed by its transform"
            if self.given
            else f"turned by {self.turned_deg:.0f} degrees and scaled {self.scaled:.3g} times"
        )
        return f"{done}; it misses the template by {100.0 * self.residual:.1f} % of its size"


def placed_by(path: str) -> Similarity | None:
    """The placement in a user's file of a 4 x 4 matrix; None where there is no file.  Raises `InputError` for a bad one."""
    return by_transform(path) if path else None


def laid_on(goal: Mesh, onto: Mesh, placed: Similarity) -> Aligned:
    """`goal` where its user says that it lies, like `onto` or not.  Raises `InputError` for one without a surface."""
    _require_surface(goal, "guidance mesh")
    points, target = placed.points(_spread(goal, _FINE)[0]), _spread(onto, _FINE)[0]
    residual = _miss(points, target) / float(onto.size_mm.max())
    return Aligned(goal.with_vertices(placed.points(goal.vertices)), residual, placed, given=True)


def aligned(
    goal: Mesh, onto: Mesh, force: bool = False, *, what: str = "guidance mesh", scaled: bool = True
) -> Aligned:
    """`goal` on the mesh `onto` (mm).

    what : `goal` is called that in errors.  scaled : it may change its size.
    Raises `InputError` for a mesh without a surface, and for one that resembles `onto` too little, unless forced.
    """
    _require_surface(goal, what)
    size = float(onto.size_mm.max())
    planes = mirror_plane(goal), mirror_plane(onto)
    if (
        planes[0] is None or planes[1] is None
    ):  # evenly spread points keep the two upright, as their wearer is
        planes = None, None
    spread = lambda count: (_spread(goal, count, planes[0]), _spread(onto, count, planes[1]))  # noqa: E731
    (coarse, coarse_normals), (target, target_normals) = spread(_COARSE)
    ratio = _spread_of(target) / _spread_of(coarse) if scaled else 1.0
    scales = (0.7 * ratio, 1.4 * ratio) if scaled else (1.0, 1.0)
    starts = [
        Similarity(ratio, turn, target.mean(0) - ratio * turn @ coarse.mean(0)) for turn in axis_rotations()
    ]
    weight = 0.05 * size
    tried = [
        similarity_icp(coarse, target, coarse_normals, target_normals, start, 20, _KEPT, weight, scales)
        for start in starts
    ]
    ranked = sorted(tried, key=lambda one: _miss(one.points(coarse), target))
    (fine, fine_normals), (target, target_normals) = spread(_FINE)
    refined = [
        similarity_icp(fine, target, fine_normals, target_normals, start, 40, _KEPT, weight, scales)
        for start in ranked[:_REFINED]
    ]
    found = min(refined, key=lambda one: _miss(one.points(fine), target))
    # points on both sides are a degree apart by chance; the surface itself is not
    slid = settled_on(SurfaceDistance(onto), fine, found, scaled, _SLID)
    if not scaled or scales[0] <= slid.scale <= scales[1]:
        found = slid
    residual = _miss(found.points(fine), target) / size
    if residual > WORST and not force:
        advice = "Give a mesh of that kind of object" + (_ADVICE if what == "guidance mesh" else ".")
        raise InputError(
            f"the {what} resembles the {onto.name or 'template'} too little: "
            f"it misses it by {100.0 * residual:.0f} % of its size, at most {100.0 * WORST:.0f} % was expected",
            advice,
        )
    return Aligned(goal.with_vertices(found.points(goal.vertices)), residual, found)


def seated(found: Aligned, seat: Mesh) -> Aligned:
    """The guidance moved, turned and sized once more, so that what it has on the skin's side lies on `seat`.

    seat : the part of the template that keeps its shape, mm.  An alligator that is thicker than a bangle has a smaller bore
    when the two are of one size: it is the bore that has to go round the wrist.
    The guidance stays where it is when it has no such side (a helmet without an opening), or none of about that size.
    """
    if found.given:
        return found
    points, normals = _spread(seat, _FINE, mirror_plane(seat))
    nearest = cKDTree(points).query(found.mesh.corners.mean(1))[1]
    alike = np.einsum("ij,ij->i", found.mesh.face_normals, normals[nearest]) > _ALIKE
    side = found.mesh.submesh(alike)
    if side.face_areas.sum() < _LEAST_SIDE * seat.face_areas.sum():
        return found
    surface, back = SurfaceDistance(side), Similarity()
    least = _off(surface, points)
    for turned in (False, True):
        tried = settled_on(surface, points, Similarity(), True, _SLID, turned=turned)
        off = _off(surface, tried.points(points)) / tried.scale
        if off <= _WORTH * least and 1.0 / _RESIZED <= tried.scale <= _RESIZED:
            back, least = tried, off
    more = back.inverse()
    return replace(
        found,
        mesh=found.mesh.with_vertices(more.points(found.mesh.vertices)),
        placed=more.after(found.placed),
    )


def _off(surface: SurfaceDistance, points: np.ndarray) -> float:
    """Root mean square distance of the points that count."""
    squares = np.sort(surface.closest(points).distances ** 2)
    return float(np.sqrt(squares[: max(1, int(_SLID * len(squares)))].mean()))


def _require_surface(mesh: Mesh, what: str) -> None:
    if len(mesh.faces) == 0 or not mesh.face_areas.sum() > 0.0:
        raise InputError(f"the {what} has no surface", "Give a mesh with faces.")


def mirror_plane(mesh: Mesh) -> Float64[np.ndarray, "2 3"] | None:
    """(a place of it, its normal) of the plane that the mesh is its own mirror image in; None where none is.

    Only planes across the axes of its coordinates are tried.
    """
    surface, size = SurfaceDistance(mesh), float(mesh.size_mm.max())
    middle, points = mesh.bounds.mean(0), _spread(mesh, _COARSE)[0]
    planes = [np.stack([middle, normal]) for normal in np.eye(3)]
    misses = [float(surface.closest(_reflected(points, plane)).distances.mean()) for plane in planes]
    best = int(np.argmin(misses))
    return planes[best] if misses[best] <= _EVEN * size else None


def _reflected(points: np.ndarray, plane: np.ndarray) -> np.ndarray:
    return points - 2.0 * ((points - plane[0]) @ plane[1])[:, None] * plane[1]


def _spread(mesh: Mesh, count: int, plane: Float64[np.ndarray, "2 3"] | None = None) -> _Points:
    """`count` points of the surface, and the normals there; the same ones for the same mesh.

    plane : half of the points are the mirror images of the others in it.
    """
    drawn = count if plane is None else count // 2
    faces, places = area_samples(mesh.face_areas, drawn, np.random.default_rng(0))
    points, normals = (places[:, :, None] * mesh.corners[faces]).sum(1), mesh.face_normals[faces]
    if plane is None:
        return points, normals
    turned = normals - 2.0 * (normals @ plane[1])[:, None] * plane[1]
    return np.concatenate([points, _reflected(points, plane)]), np.concatenate([normals, turned])


def _miss(points: np.ndarray, target: np.ndarray) -> float:
    """Mean distance to the nearest, both ways."""
    ahead, back = cKDTree(target).query(points)[0], cKDTree(points).query(target)[0]
    return 0.5 * float(ahead.mean() + back.mean())


def _spread_of(points: np.ndarray) -> float:
    return float(np.sqrt(((points - points.mean(0)) ** 2).sum(1).mean()))
