"""An object larger than the printer, cut into parts that fit, with sockets for loose pins across every cut.

Cuts are planes across the object's axes, one after the other.  Of all places for a cut the one is taken that leaves the
fewest parts, none of them a scrap, and lies nearest to the middle: away from it a shell is cut at a slant.  A pin has a
socket on both sides: the parts stay flat there, and any way up prints.  Pins of filament's own width need no printing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import manifold3d
import numpy as np
from jaxtyping import Float64
from scipy.spatial import ConvexHull

from fabcraft.errors import SolidError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh
from fabcraft.profile import PrinterProfile
from fabcraft.solid.manifolds import to_manifold, to_mesh

FILAMENT_MM = 1.75
PINS_MM = (6.0, 5.0, 4.0, 3.0, 2.5, 2.0, FILAMENT_MM, 1.5, 1.2)
"""Widths of pins, the widest that has room is taken; under the filament's width only where it is no filament printer."""
MOST_PINS = 4
"""At one face of a cut."""
MOST_PARTS = 24
_PLACES = 13
"""Places tried for a cut along an axis."""
_SCRAP = 0.12
"""A part of less than this share of the object is a scrap."""
_SPARE_MM = 1.0
"""Kept free of the build volume all round: a part that fills it to the last millimetre does not start."""
_TIDY_MM = 0.002
_STEP_MM = 0.5
_MOST_TRIED = 1500
_FIT_MM = 1e-6
_SEGMENTS = 24


@dataclass(frozen=True, eq=False)
class Cut:
    """One plane, and the pins across it."""

    normal: tuple[float, float, float]
    offset_mm: float
    """The plane is normal · x = offset."""
    pin_mm: float
    """Width of the pins; 0 where there is no room for any."""
    depth_mm: float
    """Of a socket on either side."""
    places: Float64[np.ndarray, "K 3"]


@dataclass(frozen=True, eq=False)
class Parts:
    """What an object became: parts where they were, and the pins to join them."""

    parts: tuple[Mesh, ...]
    pins: tuple[Mesh, ...]
    """Each on the bed, standing; none for a width of filament."""
    cuts: tuple[Cut, ...]
    sockets_mm3: float = 0.0
    """What the sockets take from the object."""


def fits(mesh: Mesh, profile: PrinterProfile) -> bool:
    """Whether some pose, axis by axis and turned about z, lies in the build volume."""
    return _fits(_corners(mesh.vertices), np.array(profile.build_mm))


def split(mesh: Mesh, profile: PrinterProfile) -> Parts:
    """The closed `mesh` in parts that fit the printer; one part where it fits as it is.

    Raises `SolidError` when `MOST_PARTS` do not suffice.
    """
    room = np.array(profile.build_mm) - 2.0 * _SPARE_MM
    if fits(mesh, profile):
        return Parts((mesh,), (), ())
    whole = to_manifold(mesh)
    if _pieces_needed(_corners(mesh.vertices), room) > MOST_PARTS:
        raise _too_many(mesh, profile)
    done: list[manifold3d.Manifold] = []
    waiting, planes = [whole], []
    while waiting:
        piece = waiting.pop(0)
        if _fits(_corners(_points(piece)), room):
            done.append(piece)
            continue
        if len(done) + len(waiting) >= MOST_PARTS:
            raise _too_many(mesh, profile)
        normal, offset = _best_cut(piece, room, whole.volume())
        for half in piece.split_by_plane(tuple(normal), offset):
            waiting += [one for one in half.decompose() if one.volume() > 1e-3]
        planes.append((normal, offset, piece))
    return _joined(mesh, done, planes, profile)


def _too_many(mesh: Mesh, profile: PrinterProfile) -> SolidError:
    return SolidError(
        f"{mesh.name or 'the object'} would need more than {MOST_PARTS} parts for the {profile.name}",
        "Use a larger printer, or make it smaller.",
    )


def _joined(
    mesh: Mesh,
    pieces: Sequence[manifold3d.Manifold],
    planes: Sequence[tuple[np.ndarray, float, manifold3d.Manifold]],
    profile: PrinterProfile,
) -> Parts:
    """The pieces with sockets, named, and their pins."""
    cuts, pins = [], []
    for place, (normal, offset, piece) in enumerate(planes):
        others = [(n, o) for other, (n, o, _) in enumerate(planes) if other != place]
        cut = _pinned(piece, normal, offset, others, profile)
        cuts.append(cut)
        if cut.pin_mm and not (profile.process == "fdm" and cut.pin_mm == FILAMENT_MM):
            pins += [_pin(cut, profile)] * len(cut.places)
    sockets = [
        _socket(cut, profile.clearance_fit_mm).transform(_pose(np.array(cut.normal), one))
        for cut in cuts
        for one in cut.places
    ]
    cutter = manifold3d.Manifold.batch_boolean(sockets, manifold3d.OpType.Add) if sockets else None
    if cutter is not None:
        pieces = [piece - cutter for piece in pieces]
    order = sorted(pieces, key=lambda one: tuple(np.round(one.bounding_box()[2::-1], 3)))
    name = mesh.name or "object"
    parts = [
        to_mesh(one.simplify(_TIDY_MM), f"{name}, part {k + 1} of {len(order)}")
        for k, one in enumerate(order)
    ]
    named = [replace(pin, name=f"{name}, pin {k + 1} of {len(pins)}") for k, pin in enumerate(pins)]
    return Parts(tuple(parts), tuple(named), tuple(cuts), 0.0 if cutter is None else cutter.volume())


def _points(piece: manifold3d.Manifold) -> Float64[np.ndarray, "V 3"]:
    return np.asarray(piece.to_mesh64().vert_properties[:, :3], dtype=np.float64)


def _corners(points: Float64[np.ndarray, "V 3"]) -> Float64[np.ndarray, "H 3"]:
    return points[ConvexHull(points).vertices]


def _fits(corners: Float64[np.ndarray, "H 3"], room: Float64[np.ndarray, "3"]) -> bool:
    """Whether the points lie in the room with some axis up, turned about it in steps of 15 degrees."""
    size = np.ptp(corners, axis=0)
    if (np.sort(size) <= np.sort(room) + _FIT_MM).all():
        return True
    for up in range(3):
        if size[up] > room[2] + _FIT_MM:
            continue
        x, y = np.delete(corners, up, axis=1).T
        for degrees in np.arange(15.0, 90.0, 15.0):
            c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
            if np.ptp(c * x - s * y) <= room[0] + _FIT_MM and np.ptp(s * x + c * y) <= room[1] + _FIT_MM:
                return True
    return False


def _pieces_needed(points: Float64[np.ndarray, "V 3"], room: Float64[np.ndarray, "3"]) -> int:
    """About how many parts these points need: 1, or boxes of the build volume, the best way round."""
    if _fits(_corners(points), room):
        return 1
    size = np.ptp(points, axis=0)
    return max(2, min(int(np.prod(np.ceil(size / room[list(axes)]))) for axes in permutations(range(3))))


def _best_cut(
    piece: manifold3d.Manifold, room: Float64[np.ndarray, "3"], whole_mm3: float
) -> tuple[Float64[np.ndarray, "3"], float]:
    """Normal and offset of the plane that leaves the fewest parts, then the fewest scraps, then nearest to the middle."""
    lower, upper = np.array(piece.bounding_box()).reshape(2, 3)
    best: tuple[tuple[float, ...], np.ndarray, float] | None = None
    for axis in range(3):
        normal = np.eye(3)[axis]
        for share in np.linspace(0.2, 0.8, _PLACES):
            offset = float(lower[axis] + share * (upper[axis] - lower[axis]))
            halves = [one for half in piece.split_by_plane(tuple(normal), offset) for one in half.decompose()]
            if len(halves) < 2:
                continue
            needed = sum(_pieces_needed(_points(one), room) for one in halves)
            scraps = sum(max(0.0, _SCRAP - one.volume() / whole_mm3) / _SCRAP for one in halves)
            cost = (
                float(needed),
                float(np.ceil(2.0 * scraps)),
                float(len(halves)),
                abs(float(share) - 0.5),
            )
            if best is None or cost < best[0]:
                best = (cost, normal, offset)
    if best is None:
        raise SolidError("no plane divides the object", "Use a larger printer, or make it smaller.")
    return best[1], best[2]


def _pinned(
    piece: manifold3d.Manifold,
    normal: Float64[np.ndarray, "3"],
    offset: float,
    others: Sequence[tuple[np.ndarray, float]],
    profile: PrinterProfile,
) -> Cut:
    """The cut with the widest pins that have room on both sides of it, with the printer's wall around the sockets."""
    surface = SurfaceDistance(to_mesh(piece))
    across = np.roll(np.eye(3), -int(np.argmax(normal)) - 1, axis=0)[:2]
    lower, upper = surface.mesh.bounds
    u, v = (np.arange(axis @ lower + 0.5 * _STEP_MM, axis @ upper, _STEP_MM) for axis in across)
    grid = np.stack(np.meshgrid(u, v, indexing="ij"), -1).reshape(-1, 2) @ across + offset * normal
    wall = max(profile.min_wall_mm, profile.min_wall_supported_mm)
    narrowest = _narrowest(profile)
    grid = grid[surface.inside(grid)]
    deep = -surface.signed(grid) >= 0.5 * narrowest + profile.clearance_fit_mm + wall
    grid = grid[deep]
    grid = grid[:: max(1, len(grid) // _MOST_TRIED)]
    for pin in PINS_MM:
        if pin < narrowest or not len(grid):
            continue
        depth = max(1.5 * pin, 3.0)
        around = 0.5 * pin + profile.clearance_fit_mm + wall
        steps = np.linspace(-depth, depth, 9)
        along = grid[:, None] + steps[:, None] * normal
        room = (-surface.signed(along.reshape(-1, 3))).reshape(len(grid), -1).min(1)
        for other, level in others:
            if abs(float(other @ normal)) < 0.5:
                room = np.minimum(room, np.abs(grid @ other - level))
            else:
                room = np.where(abs(level - offset) < depth + wall, -1.0, room)
        places = _spread(grid, room, around)
        if len(places) >= 2:
            return Cut(_three(normal), offset, pin, depth + profile.clearance_fit_mm, places)
    return Cut(_three(normal), offset, 0.0, 0.0, np.zeros((0, 3)))


def _narrowest(profile: PrinterProfile) -> float:
    """Narrowest pin: filament's own width, or what the printer's thinnest free wall allows."""
    return FILAMENT_MM if profile.process == "fdm" else max(2.0 * profile.min_wall_mm, PINS_MM[-1])


def _three(vector: Float64[np.ndarray, "3"]) -> tuple[float, float, float]:
    return float(vector[0]), float(vector[1]), float(vector[2])


def _spread(
    points: Float64[np.ndarray, "N 3"], room: Float64[np.ndarray, " N"], around_mm: float
) -> Float64[np.ndarray, "K 3"]:
    """Up to `MOST_PINS` of the points with `around_mm` of room, far apart: the roomiest first, then the farthest ones."""
    allowed = points[room >= around_mm]
    if not len(allowed):
        return np.zeros((0, 3))
    chosen = [allowed[int(np.argmax(room[room >= around_mm]))]]
    # the roomiest only begins the search: the first pin lies as far out as the others
    chosen = [allowed[int(np.argmax(np.linalg.norm(allowed - chosen[0], axis=1)))]]
    while len(chosen) < MOST_PINS:
        away = np.linalg.norm(allowed[:, None] - np.array(chosen), axis=2).min(1)
        if away.max() < 4.0 * around_mm:
            break
        chosen.append(allowed[int(np.argmax(away))])
    return np.array(chosen)


def _socket(cut: Cut, clearance_mm: float) -> manifold3d.Manifold:
    """The hole for one pin, on both sides of z = 0."""
    radius = 0.5 * cut.pin_mm + clearance_mm
    return manifold3d.Manifold.cylinder(2.0 * cut.depth_mm, radius, radius, _SEGMENTS, center=True)


def _pin(cut: Cut, profile: PrinterProfile) -> Mesh:
    """One pin, standing on z = 0, its ends tapered so that they find the socket."""
    radius = 0.5 * cut.pin_mm
    length, taper = 2.0 * (cut.depth_mm - profile.clearance_fit_mm), 0.3 * radius
    rod = manifold3d.Manifold.cylinder(length - 2.0 * taper, radius, radius, _SEGMENTS).translate(
        (0, 0, taper)
    )
    tip = manifold3d.Manifold.cylinder(taper, radius - taper, radius - taper, _SEGMENTS)
    return to_mesh(manifold3d.Manifold.batch_hull([rod, tip, tip.translate((0, 0, length - taper))]))


def _pose(normal: Float64[np.ndarray, "3"], place: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "3 4"]:
    across = np.roll(np.eye(3), -int(np.argmax(normal)) - 1, axis=0)[:2]
    return np.column_stack([*across, normal, place])
