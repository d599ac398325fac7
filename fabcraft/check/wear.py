"""Does the object sit on the body, touch it where it should, let the eyes see, and can it be put on?

Signed distances s to the body are positive outside. S are 20 000 samples spread evenly over the object's
surface, the same for the same mesh; extremes are taken over S and all vertices:
    pen_rms_mm = sqrt(mean over S of max(0, -s)^2)        pen_max_mm = max(0, -s)
    clearance_min_mm = min s
    clearance_violation_pct = share of S with s < clearance
Contacts c with a wanted gap g, measured to the object's triangles:
    contact_rms_mm, contact_p95_mm of |distance(c) - g|
    paper_Dc = mean over c of the squared distance to the nearest object vertex,
    paper_Dp = sum over object vertices inside the body of s^2,
both in units of half the body's longest side, as SUMMON (Ye et al. 2022) scales its field.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64
from scipy.spatial import cKDTree

from fabcraft.check.report import Finding, Place, Value, places
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.passage import passage
from fabcraft.geometry.rays import Rays
from fabcraft.mesh import Mesh

SAMPLES = 20_000
_SEED = 20_000
_AWAY_MM = 5.0  # a pose this far in front of the body is off it
_CUBES = 110.0  # along the longest side
_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))


@dataclass(frozen=True)
class Fit:
    """How an object sits; the names are those of the report. None: not measured."""

    pen_max_mm: float
    pen_rms_mm: float
    pen_place: Place
    """Where it goes deepest into the body, or comes closest to it."""
    clearance_min_mm: float
    clearance_violation_pct: float
    paper_Dp: float  # noqa: N815 - the paper's name
    contact_rms_mm: float | None = None
    contact_p95_mm: float | None = None
    contact_place: Place | None = None
    """The contact that is furthest from its gap."""
    paper_Dc: float | None = None  # noqa: N815

    def metrics(self) -> dict[str, Value]:
        """The measured numbers by name."""
        names = ("pen_max_mm", "pen_rms_mm", "clearance_min_mm", "clearance_violation_pct", "paper_Dp")
        contact = ("contact_rms_mm", "contact_p95_mm", "paper_Dc")
        return {name: getattr(self, name) for name in (*names, *contact) if getattr(self, name) is not None}


@dataclass(frozen=True)
class Donning:
    """How an object gets onto the body along its path."""

    poses: int
    travel_mm: float
    """Length of the path from its seat to where it is off the body."""
    pen_max_mm: float
    """Deepest on the way, beyond what the seat itself has."""
    stuck_pose: int
    """Number of the pose where that happens; 0 is the seat."""
    stuck_at_mm: float
    """How far that is along the path from the seat."""
    stuck_place: Place
    """Where on the body, mm."""
    allowed_mm: float

    @property
    def donnable(self) -> bool:
        """Nothing on the way presses deeper than allowed."""
        return self.pen_max_mm <= self.allowed_mm


@dataclass(frozen=True)
class Sight:
    """What one eye sees through the object."""

    eye: Place
    open_share: float
    """Share of the rays in the cone that leave unhindered."""


def surface_samples(mesh: Mesh, count: int = SAMPLES) -> Float64[np.ndarray, "S 3"]:
    """`count` points spread evenly by area; the same points for the same mesh, mm."""
    areas = mesh.face_areas
    if len(areas) == 0 or areas.sum() <= 0:
        return mesh.vertices.copy()
    random = np.random.default_rng(_SEED)
    edges = np.cumsum(areas) / areas.sum()
    # One draw in each of `count` equal slices of the area: evener than independent draws.
    face = np.searchsorted(edges, (np.arange(count) + random.random(count)) / count).clip(max=len(areas) - 1)
    root, v = np.sqrt(random.random(count))[:, None], random.random(count)[:, None]
    a, b, c = mesh.corners[face].transpose(1, 0, 2)
    return (1 - root) * a + root * (1 - v) * b + root * v * c


def measure_fit(
    mesh: Mesh,
    body: SurfaceDistance,
    contacts: Float[np.ndarray, "C 3"] | None = None,
    gaps_mm: Float[np.ndarray, " C"] | float = 0.0,
    clearance_mm: float = 0.0,
) -> Fit:
    """How `mesh` sits in the body, and how well `contacts` (points on the body, mm) keep their gaps."""
    points = np.concatenate([surface_samples(mesh), mesh.vertices])
    signed = body.signed(points)
    spread = signed[: len(points) - len(mesh.vertices)]
    deepest = int(np.argmin(signed))
    unit = float(body.mesh.size_mm.max()) / 2
    inside = np.minimum(signed[len(spread) :], 0.0) / unit
    fit: dict = {
        "pen_max_mm": max(0.0, -float(signed[deepest])),
        "pen_rms_mm": float(np.sqrt(np.mean(np.minimum(spread, 0.0) ** 2))),
        "pen_place": places(points[deepest][None])[0],
        "clearance_min_mm": float(signed[deepest]),
        "clearance_violation_pct": 100.0 * float(np.mean(spread < clearance_mm)),
        "paper_Dp": float((inside**2).sum()),
    }
    if contacts is not None and len(contacts):
        miss = np.abs(SurfaceDistance(mesh).closest(contacts).distances - gaps_mm)
        near, _ = cKDTree(mesh.vertices).query(contacts)
        fit["contact_rms_mm"] = float(np.sqrt(np.mean(miss**2)))
        fit["contact_p95_mm"] = float(np.percentile(miss, 95))
        fit["contact_place"] = places(contacts[int(np.argmax(miss))][None])[0]
        fit["paper_Dc"] = float(np.mean((near / unit) ** 2))
    return Fit(**fit)


def measure_donning(
    mesh: Mesh,
    body: SurfaceDistance,
    direction: tuple[float, float, float] = (0.0, -1.0, 0.0),
    allowed_mm: float = 0.5,
    poses: int = 40,
) -> Donning:
    """Move the seated object off the body along the straight way `direction`, and measure how deep it presses.

    `direction`: the way off (a mask: -y, to the front). `allowed_mm`: what skin and the object's flex take.
    `poses`: at least 30, denser near the seat, where a brow, a nose or a knuckle stands in the way.
    """
    axis = np.array(direction) / np.linalg.norm(direction)
    travel = float((body.mesh.vertices @ axis).max() - (mesh.vertices @ axis).min()) + _AWAY_MM
    steps = max(travel, _AWAY_MM) * np.linspace(0.0, 1.0, max(poses, 30)) ** 1.7
    path = np.tile(np.eye(4), (len(steps), 1, 1))
    path[:, :3, 3] = steps[:, None] * axis
    return measure_path(mesh, body, path, allowed_mm)


def measure_path(
    mesh: Mesh, body: SurfaceDistance, poses: Float64[np.ndarray, "K 4 4"], allowed_mm: float = 0.5
) -> Donning:
    """Move the object through `poses` and measure how deep it presses into the body on the way.

    `poses`: rigid transforms of the worn object from its seat (the first, the identity) outwards. `body`: what it has to
    pass, which need not be what it sits on (a folded hand). `allowed_mm`: what skin and the object's flex take.
    """
    # one vertex in every small cube: a path is a matter of millimetres, the seat is measured on all of them
    cube_mm = max(1.0, float(mesh.size_mm.max()) / _CUBES)
    _, kept = np.unique(np.round(mesh.vertices / cube_mm).astype(np.int64), axis=0, return_index=True)
    points = np.concatenate([surface_samples(mesh, 6000), mesh.vertices[np.sort(kept)]])
    middle = points.mean(0)
    middles = poses[:, :3, :3] @ middle + poses[:, :3, 3]
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(middles, axis=0), axis=1))])
    way = passage(points, poses, body)
    stuck = int(np.argmax(way.depth_mm))
    return Donning(
        poses=len(poses),
        travel_mm=float(travelled[-1]),
        pen_max_mm=float(way.depth_mm[stuck]),
        stuck_pose=stuck,
        stuck_at_mm=float(travelled[stuck]),
        stuck_place=places(way.places[stuck][None])[0],
        allowed_mm=allowed_mm,
    )


def measure_sight(
    mesh: Mesh,
    eyes: Float[np.ndarray, "E 3"],
    direction: tuple[float, float, float] = (0.0, -1.0, 0.0),
    half_angle_deg: float = 15.0,
    rays: int = 400,
) -> tuple[Sight, ...]:
    """How much of a cone before each eye is open: `rays` directions, even in solid angle, from its centre."""
    axis = np.array(direction, dtype=np.float64) / np.linalg.norm(direction)
    side = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    side /= np.linalg.norm(side)
    height = 1.0 - (np.arange(rays) + 0.5) / rays * (1.0 - np.cos(np.radians(half_angle_deg)))
    turn = _GOLDEN * np.arange(rays)
    across = np.sqrt(1.0 - height**2)
    bundle = (
        height[:, None] * axis
        + (across * np.cos(turn))[:, None] * side
        + (across * np.sin(turn))[:, None] * np.cross(axis, side)
    )
    caster = Rays(mesh)
    seen = []
    for eye in eyes:
        free = np.isinf(caster.distances(np.tile(eye, (rays, 1)), bundle))
        seen.append(Sight(eye=places(eye[None])[0], open_share=float(free.mean())))
    return tuple(seen)


def fit_findings(
    fit: Fit, penetration_limit_mm: float = 0.1, clearance_mm: float = 0.0, contact_limit_mm: float = 1.0
) -> list[Finding]:
    """Broken promises about the seat. Limits: penetration of any point, wanted clearance, contact rms."""
    found = []
    if fit.pen_max_mm > penetration_limit_mm:
        found.append(
            Finding(
                check="penetration",
                severity="fail",
                value=round(fit.pen_max_mm, 3),
                limit=penetration_limit_mm,
                unit="mm",
                where=(fit.pen_place,),
                advice="The object presses into the body here: give it more room or more clearance.",
            )
        )
    elif fit.clearance_min_mm < clearance_mm - penetration_limit_mm:
        found.append(
            Finding(
                check="clearance",
                severity="warn",
                value=round(fit.clearance_min_mm, 3),
                limit=clearance_mm,
                unit="mm",
                where=(fit.pen_place,),
                advice=f"{fit.clearance_violation_pct:.1f} % of the surface is too close to the body.",
            )
        )
    return found + _contact_findings(fit, contact_limit_mm)


def _contact_findings(fit: Fit, limit_mm: float) -> list[Finding]:
    if fit.contact_rms_mm is None or fit.contact_place is None or fit.contact_rms_mm <= limit_mm:
        return []
    return [
        Finding(
            check="contact",
            severity="warn",
            value=round(fit.contact_rms_mm, 3),
            limit=limit_mm,
            unit="mm",
            where=(fit.contact_place,),
            advice="The object does not rest where it should; expect it to rock or slide.",
        )
    ]


def donning_findings(donning: Donning) -> list[Finding]:
    """Where it sticks, if it does."""
    if donning.donnable:
        return []
    advice = (
        f"It cannot be put on: {donning.stuck_at_mm:.1f} mm before its seat (pose {donning.stuck_pose} of "
        f"{donning.poses}) it would press this deep. Open it there, or use a material that gives."
    )
    return [
        Finding(
            check="donning",
            severity="fail",
            value=round(donning.pen_max_mm, 3),
            limit=donning.allowed_mm,
            unit="mm",
            where=(donning.stuck_place,),
            advice=advice,
        )
    ]


def sight_findings(sights: tuple[Sight, ...], wanted_share: float = 0.8) -> list[Finding]:
    """Eyes that see too little; an eye that sees nothing is a failure."""
    return [
        Finding(
            check="sight",
            severity="fail" if sight.open_share < 0.05 else "warn",
            value=round(100 * sight.open_share, 1),
            limit=100 * wanted_share,
            unit="% of the view",
            where=(sight.eye,),
            advice="The object covers this eye's view: widen the opening or move it before the eye.",
        )
        for sight in sights
        if sight.open_share < wanted_share
    ]
