"""Where the object lies on the printer's bed.

The first pose that fits the build volume: as it is worn, then turned about the vertical in steps of 15 degrees; the same
on its back (front up), then on its front. The lowest point touches the bed, the
middle of the box is the middle of the bed.

`oriented` looks further: for the pose with the least support, with the side that touches skin kept clean of it.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial import ConvexHull

from fabcraft.geometry.support import Support, support_at, support_of
from fabcraft.mesh import Mesh
from fabcraft.profile import PrinterProfile

POSES = (
    ("as it is worn", 0.0),
    ("on its back, front up", -90.0),
    ("on its front", 90.0),
)
"""Name, and turn about the x axis in degrees: -90 takes -y (the front) to +z."""


DIRECTIONS = 160
"""Directions tried as downwards, evenly over the sphere, besides the flat sides."""
FLATS = 40
"""Flat sides of the convex hull that are tried as the foot, the largest."""
KEPT_MM = 2.0
"""A mm² of support on the side to be kept clean counts as that many mm³ of support more: judgement."""
NEARLY = 1.05
"""Poses within 5 % of the least support are as good as it; the lowest of them is taken."""
_LITTLE_MM3, _LITTLE_SHARE = 20.0, 0.005
"""Nor does a pose stand tall to save so little, in mm³ or over the object's volume: the bridges over a few holes."""
_COARSE, _FINE, _FINALISTS = 64, 200, 12


@dataclass(frozen=True, eq=False)
class OnBed:
    """An object on the bed, mm, and how it lies, in words."""

    mesh: Mesh
    words: str
    fits: bool = True
    """In the build volume."""


@dataclass(frozen=True, eq=False)
class Oriented:
    """An object turned for the least support, mm, and what that brought."""

    mesh: Mesh
    """Its lowest point at z = 0, not yet in its place on the bed; same vertices and faces in the same order."""
    fits: bool
    before: Support
    """As it lay."""
    after: Support

    @property
    def words(self) -> str:
        """From what to what."""
        kept = self.before.kept_mm2, self.after.kept_mm2
        clean = f", {kept[0]:.0f} to {kept[1]:.0f} mm² of the skin side under it" if max(kept) > 0.5 else ""
        return (
            f"turned for the least support: about {self.before.volume_mm3 / 1000.0:.1f} cm³ as worn, "
            f"{self.after.volume_mm3 / 1000.0:.1f} now{clean}"
        )


def onto_bed(mesh: Mesh, profile: PrinterProfile) -> OnBed:
    """`mesh` placed on the bed; an object that fits in no pose stays as it is worn."""
    build = np.array(profile.build_mm)
    for name, about_x in POSES:
        for about_z in np.arange(0.0, 91.0, 15.0):
            turned = mesh.transformed(_turn(about_x, about_z))
            if (turned.size_mm <= build).all():
                words = name if about_z == 0.0 else f"{name}, turned by {about_z:.0f} degrees"
                return OnBed(_laid(turned, build), words)
    return OnBed(_laid(mesh, build), "as it is worn; it is larger than the build volume", False)


def oriented(mesh: Mesh, profile: PrinterProfile, kept: Bool[np.ndarray, " F"] | None = None) -> Oriented:
    """`mesh` turned so that it needs the least support; of poses that need about the same, the lowest.

    kept : faces that support should not touch.  Powder carries what lies in it: there the lowest pose is taken.
    Where no pose fits the build volume, the best of all is taken.
    """
    turns = [np.eye(3), *(_downwards(one) for one in _directions(mesh))]
    hull = mesh.vertices[ConvexHull(mesh.vertices).vertices]
    spins = [_fitting_spin(hull @ turn.T, np.array(profile.build_mm)) for turn in turns]
    fits = any(spin is not None for spin in spins)
    usable = [
        (turn, 0.0 if spin is None else spin)
        for turn, spin in zip(turns, spins, strict=True)
        if spin is not None or not fits
    ]
    supported, normals = profile.process in ("fdm", "sla"), mesh.face_normals

    def support(turn: Float64[np.ndarray, "3 3"], columns: int) -> Support:
        points = mesh.vertices @ turn.T
        points[:, 2] -= points[:, 2].min()
        if not supported:
            return Support(0.0, 0.0)
        return support_at(points, mesh.faces, normals @ turn[2], profile, kept, columns)

    def cost(turn: Float64[np.ndarray, "3 3"], columns: int) -> float:
        found = support(turn, columns)
        return found.volume_mm3 + KEPT_MM * found.kept_mm2

    coarse = np.array([cost(turn, _COARSE) for turn, _ in usable])
    best = np.argsort(coarse, kind="stable")
    if supported:
        best = best[:_FINALISTS]
    fine = np.array([cost(usable[one][0], _FINE) for one in best])
    little = max(_LITTLE_MM3, _LITTLE_SHARE * abs(mesh.volume_mm3))
    good = best[fine <= NEARLY * fine.min() + little]
    heights = np.array([np.ptp(hull @ usable[one][0][2]) for one in good])
    turn, spin = usable[good[int(np.argmin(np.round(heights, 1)))]]
    whole = _turn(0.0, spin)[:3, :3] @ turn
    points = mesh.vertices @ whole.T
    placed = mesh.with_vertices(points - [0.0, 0.0, float(points[:, 2].min())])
    before = support_of(mesh, profile, kept, _FINE) if supported else Support(0.0, 0.0)
    return Oriented(placed, fits, before, support(turn, _FINE))


def moved_together(pair: Mesh, gap_mm: float = 4.0) -> Mesh:
    """The two of a pair, one on either side of x = 0, pushed together until their boxes are `gap_mm` apart."""
    x = pair.vertices[:, 0]
    left = x > 0.0
    shift = np.where(left, 0.5 * gap_mm - x[left].min(), -0.5 * gap_mm - x[~left].max())
    return pair.with_vertices(pair.vertices + shift[:, None] * [1.0, 0.0, 0.0])


def _directions(mesh: Mesh) -> list[Float64[np.ndarray, "3"]]:
    """Directions to try as downwards: the axes, the largest flat sides of the convex hull, and evenly all round."""
    hull = ConvexHull(mesh.vertices)
    a, b, c = mesh.vertices[hull.simplices].transpose(1, 0, 2)
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    # the hull's triangles of one flat side share their equation up to rounding
    sides, which = np.unique(np.round(hull.equations[:, :3], 3), axis=0, return_inverse=True)
    size = np.bincount(which.reshape(-1), areas)
    flats = sides[np.argsort(-size, kind="stable")[:FLATS]]
    index = np.arange(DIRECTIONS) + 0.5
    height, angle = 1.0 - 2.0 * index / DIRECTIONS, np.pi * (1.0 + np.sqrt(5.0)) * index
    radius = np.sqrt(1.0 - height**2)
    even = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
    every = np.concatenate([np.eye(3), -np.eye(3), flats, even])
    return list(every / np.linalg.norm(every, axis=1, keepdims=True))


def _downwards(direction: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "3 3"]:
    """The smallest turn that takes a unit vector to -z; about x where it points straight up."""
    x, y, z = -direction
    if z < -1.0 + 1e-9:
        return np.diag([1.0, -1.0, -1.0])
    # Rodrigues' formula for u -> e_z with u = -direction: axis (y, -x, 0), cosine z
    skew = np.array([[0.0, 0.0, -x], [0.0, 0.0, -y], [x, y, 0.0]])
    return np.eye(3) + skew + skew @ skew / (1.0 + z)


def _fitting_spin(points: Float64[np.ndarray, "H 3"], build: Float64[np.ndarray, "3"]) -> float | None:
    """The smallest turn about z, in steps of 15 degrees, with which the points fit the build volume."""
    for spin in np.arange(0.0, 180.0, 15.0):
        turned = points @ _turn(0.0, float(spin))[:3, :3].T
        if (np.ptp(turned, axis=0) <= build).all():
            return float(spin)
    return None


def _turn(about_x_deg: float, about_z_deg: float) -> Float64[np.ndarray, "4 4"]:
    x, z = np.radians([about_x_deg, about_z_deg])
    matrix = np.eye(4)
    first = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(x), -np.sin(x)], [0.0, np.sin(x), np.cos(x)]])
    second = np.array([[np.cos(z), -np.sin(z), 0.0], [np.sin(z), np.cos(z), 0.0], [0.0, 0.0, 1.0]])
    # right angles to the last bit: a turned object keeps its exact coordinates
    matrix[:3, :3] = np.where(np.abs(second @ first) < 1e-15, 0.0, second @ first)
    return matrix


def _laid(mesh: Mesh, build: Float64[np.ndarray, "3"]) -> Mesh:
    lower, upper = mesh.bounds
    middle = 0.5 * (lower + upper)
    return mesh.with_vertices(
        mesh.vertices + [0.5 * build[0] - middle[0], 0.5 * build[1] - middle[1], -lower[2]]
    )
