"""The slippers: closed-toe mules, a pair; the sole under the whole foot, the upper over its front, the heel open.

Numbers (mm, for a foot 271 long): sole 8 under the heel and 6 under the toes, 4 beyond the print of the foot; upper from the
toes back over 55 % of the length; room 2 round the foot when soft, 3 when rigid, 12 before the toes and 6 over them;
wall 2.4.  The inner side is level where the foot stands.  One is made; the other is its mirror image.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial import ConvexHull

from fabcraft.body.body import Body
from fabcraft.body.region import Region
from fabcraft.body.sizes import asked
from fabcraft.errors import InputError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.implicit import met, slope, smooth_common, smooth_union
from fabcraft.geometry.passage import passage
from fabcraft.geometry.walled import Wall, walled
from fabcraft.mesh import Mesh
from fabcraft.template.catalogue import Kind, Settings
from fabcraft.template.footprint import Frame, Last, Points, last, standing
from fabcraft.template.template import DonningPath, MotifFrame, Parameter, Template
from fabcraft.template.whole import sole as seen_from_above

EDGE_MM, WALL_MM, LEAST_WALL_MM = 3.6, 2.4, 1.6
FOOT_MM = 271.0
"""Length of a median man's foot (ANSUR II), which the numbers are made for."""
ROOM_MM = {"soft": 2.0, "rigid": 3.0}
SOLE_MM, THINNER_MM, BESIDE_MM = 8.0, 2.0, 4.0
TOE_MM, OVER_TOES_MM, COVER = 12.0, 6.0, 55.0
_FLOOR_MM = 0.03
"""How far the footbed lies under the lowest point of the foot, so that rounding does not press it in."""
_STROKES_MM = 3.0
"""Room under the foot for the strokes of a drawn sole."""
_LEAN = 0.11
"""How much farther back the sides of the upper go, over the foot's length."""
_FOXING_MM, _FOXING_HIGH_MM = 2.4, 16.0
"""How much thicker the side is at the sole, and up to where."""
_CORNER_EDGE_MM = 1.5
_TRIES, _NEARER_MM = 3, 0.05
"""How often the upper is made shorter until it is off the leg, and how much nearer than listed it may be."""
_DROPS, _EVERY = (0.06, 0.03, 0.0), 4
"""How much a slipper goes down for every mm forward, and which of its vertices are tried on that way."""
_TONGUE_MM, _BEAD = 7.0, 0.35
_BLUR_MM, _CORNER_MM, _OUTER_CORNER_MM, _INNER_CORNER_MM = 4.5, 18.0, 18.0, 6.0
_UP = np.array([0.0, 0.0, 1.0])
_PLACES = ("ball_medial", "ball_lateral")


@dataclass(frozen=True, eq=False)
class _Slipper:
    """The slipper as fields, in the frame of the foot."""

    last: Last
    scale: float
    """Of its details, over a median man's."""
    level: float
    """Of the upper's inner side in the last's room."""
    bed: tuple[float, float]
    """Height of the footbed at the heel, and how much it rises per mm forward."""
    sole: float
    """Thickness under the heel."""
    wall: float
    top: Float64[np.ndarray, "2"]
    """(y, z) where the upper ends over the instep, but for its tongue."""
    side: Float64[np.ndarray, "2"]
    """(y, z) where it ends at the sole."""
    corner: float
    """Rounding between footbed and upper."""
    beside: float = 0.0
    """Distance of the sole's edge from the print."""

    def floor(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Height of the footbed."""
        return self.bed[0] + self.bed[1] * points[:, 1]

    def bottom(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Height of the underside: the sole is thinner under the toes."""
        return self.floor(points) - self.sole + THINNER_MM * self.scale * points[:, 1] / self.last.length

    def within(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Distance outward from the inner side of the upper."""
        return self.last.room(points) - self.level

    def behind(self, points: Points) -> Float64[np.ndarray, " N"]:
        """How far points are behind the edge of the upper, which has a tongue over the instep."""
        along = (self.top - self.side) / np.linalg.norm(self.top - self.side)
        away = (points[:, 1:] - self.side) @ np.array([-along[1], along[0]])
        tongue = _TONGUE_MM * self.scale * np.exp(-((points[:, 0] / (45.0 * self.scale)) ** 2))
        return away - tongue

    def middle(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Distance outward from the middle of sole and upper."""
        under = 0.5 * (self.floor(points) + self.bottom(points)) - points[:, 2]
        return smooth_common(self.within(points) - 0.5 * self.wall, under, _CORNER_MM * self.scale)

    def outer(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Distance outward from the outer side, which is thicker at the sole and at the edge of the upper."""
        bottom, s = self.bottom(points), self.scale
        low = np.clip(1.0 - (points[:, 2] - self.floor(points)) / (_FOXING_HIGH_MM * s), 0.0, 1.0)
        foxing = _FOXING_MM * s * low**2 * (3.0 - 2.0 * low)
        bead = (
            _BEAD * self.wall * np.exp(-0.5 * (np.minimum(self.behind(points), 0.0) / (1.5 * self.wall)) ** 2)
        )
        side = self.within(points) - self.wall - np.maximum(foxing, bead)
        return smooth_common(side, bottom - points[:, 2], _OUTER_CORNER_MM * s)

    def inner(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Distance inward from the inner side."""
        return -smooth_common(self.within(points), self.floor(points) - points[:, 2], self.corner)

    def beyond(self, points: Points) -> Float64[np.ndarray, " N"]:
        """How far points are past an edge: behind the upper, and beside the sole there."""
        half = 0.5 * (self.floor(points) - self.bottom(points))
        beside = self.last.beside(points) - (self.beside - half)
        # over the heel the upper's inner side would go on as a tunnel
        sole = smooth_common(beside, points[:, 2] - self.floor(points) - 2.0 * self.scale, 2.0 * self.scale)
        return smooth_union(self.behind(points), sole, max(26.0 * self.scale, 9.0 * self.wall))

    def detail(self, points: Points) -> Float64[np.ndarray, " N"]:
        """Edge length at the corner between sole and upper, whose outer side is much longer than its middle."""
        under = 0.5 * (self.floor(points) + self.bottom(points)) - points[:, 2]
        off = np.abs(self.within(points) - 0.5 * self.wall - under) / np.sqrt(2.0)
        return self.scale * (_CORNER_EDGE_MM + 0.5 * np.maximum(off / self.scale - 4.0, 0.0))

    def squareness(self, points: Points) -> Float64[np.ndarray, " N"]:
        """The edge of the sole is fuller than a half round, the upper's is one."""
        high = np.clip((points[:, 2] - self.floor(points)) / (8.0 * self.scale), 0.0, 1.0)
        return 0.55 + 0.45 * high


def build(body: Body, settings: Settings) -> Template:
    """A slipper for `body`.  Raises `InputError` for a body without a free foot and for a size that is too small."""
    chosen = KIND.settled(settings)
    which = str(chosen.get("side", "left"))
    part, at = KIND.worn(body, f"foot_{which}", [f"{place}_{which}" for place in _PLACES])
    frame = standing(part.mesh, np.mean([at[f"{place}_{which}"] for place in _PLACES], axis=0))
    size = _size(chosen.get("size"), frame.length)
    s = part.scale if part.kind == "character" else frame.length / FOOT_MM
    usual = WALL_MM if part.kind != "character" else max(LEAST_WALL_MM, 0.02 * frame.length)
    wall, sole = (
        float(chosen.get("wall", usual)),
        float(chosen.get("sole", max(SOLE_MM * s, 2.0 * LEAST_WALL_MM))),
    )
    fit = chosen.get("fit", "soft")
    room = part.clearance_mm(ROOM_MM[fit]) if isinstance(fit, str) else float(fit)
    toe = float(chosen.get("toe", part.clearance_mm(TOE_MM)))
    cover = float(chosen.get("cover", COVER))

    foot = Mesh(frame.inside(part.mesh.vertices), part.mesh.faces)
    longer = foot.with_vertices(foot.vertices * [size / frame.length, size / frame.length, 1.0])
    over = part.clearance_mm(OVER_TOES_MM)
    before, above = max(toe - room, 0.0), max(over - room, 0.0)
    # a wall that cannot be as thin as the foot is small asks for rounder corners
    rounded = max(s, 0.5 * wall / WALL_MM)
    edge = max(EDGE_MM * s, 0.7 * wall)
    skin, off_leg, least = SurfaceDistance(foot), wall + 1.5 * room, part.clearance_mm(0.0)
    for _ in range(_TRIES):
        shape = last(longer, size, s, cover / 100.0, before, above, off_leg, _BLUR_MM * rounded)
        slipper = _slipper(part, foot, longer, shape, rounded, room, wall, sole)
        made, inside = _walled(slipper, _bounds(slipper, foot, toe), edge)
        short = least - float(skin.signed(made.vertices).min())
        if short <= _NEARER_MM:
            break
        off_leg += 2.0 * short  # the edge of the upper is in the leg
    mesh = made.with_vertices(frame.outside(made.vertices))
    contacts = _resting(part, foot, slipper, which)
    gives = 1.0 if part.kind != "character" else 0.2
    poses = _sliding_off(frame, slipper, foot, SurfaceDistance(part.mesh), mesh, gives)
    return Template(
        name=KIND.name,
        body=replace(part, regions={**part.regions, **contacts}),
        mesh=mesh,
        rims=(),
        surface=None,
        wall_mm=wall,
        genus=0,
        contacts=tuple(contacts),
        edge_mm=edge,
        donning=tuple(frame.axes[1].tolist()),
        path=DonningPath(poses, gives, "a soft upper and the foot give"),
        locked=inside,
        pair=True,
        motifs=(
            *_motifs(slipper, frame),
            seen_from_above(mesh, frame.axes[1], _under_the_foot(slipper, made), 20.0 * s),
        ),
        listed_mm=(part.clearance_mm(0.0), room),
        parameters={"size": size, "fit": room, "wall": wall, "sole": sole, "toe": toe, "cover": cover},
        notes=(
            f"The slippers are for feet {size:.0f} mm long: EU {(size + 12.5) * 0.15:.1f}, Mondopoint {size:.0f}.",
        ),
    )


def _walled(
    slipper: _Slipper, bounds: Float64[np.ndarray, "2 3"], edge: float
) -> tuple[Mesh, Bool[np.ndarray, " F"]]:
    """The slipper in the frame of the foot, edges about `edge` long, and which of its faces are on the inner side."""
    sides = Wall(
        slipper.middle,
        slipper.beyond,
        slipper.outer,
        slipper.inner,
        slipper.squareness,
        slipper.detail,
        least_mm=slipper.wall,
    )
    return walled(sides, bounds, edge, min(0.6 * edge, 0.9 * slipper.wall), name=KIND.name)


def _under_the_foot(slipper: _Slipper, made: Mesh) -> float:
    """How high above the ground a sole may be that no foot meets on its way in, mm."""
    along = np.linspace(0.0, slipper.last.length, 9)
    bed = slipper.floor(np.column_stack([np.zeros(9), along, np.zeros(9)]))
    return float(bed.min() - made.bounds[0, 2]) - _STROKES_MM


def _size(size: float | str | None, own: float) -> float:
    """Length of the foot that the slipper is made for."""
    if size is None:
        return own
    wanted = asked({"foot": str(size).replace(" ", "")})[0].mm
    if wanted < own - 3.0:
        raise InputError(
            f"slippers for feet of {wanted:.0f} mm were asked, but this one is {own:.0f} mm long",
            f"Choose EU{np.ceil((own + 12.5) * 0.15):.0f} or MP{np.ceil(own / 5) * 5:.0f} or larger.",
        )
    return KIND.within("size", wanted)


def _slipper(
    part: Body, foot: Mesh, longer: Mesh, shape: Last, s: float, room: float, wall: float, sole: float
) -> _Slipper:
    """The fields around a last, for the foot that wears it, and the `longer` one that it is made for."""
    bed = _footbed(foot, max(part.clearance_mm(0.0), _FLOOR_MM * s))
    end, height = shape.end
    top = np.array([end + _TONGUE_MM * s, height + room + 0.5 * wall])
    side = np.array([top[0] - _LEAN * shape.length, bed[0]])
    slipper = _Slipper(shape, s, 0.0, bed, sole, wall, top, side, _INNER_CORNER_MM * shape.length / FOOT_MM)
    made_for = longer.vertices
    covered = made_for[(slipper.behind(made_for) < 0.0) & (made_for[:, 2] < 1.3 * top[1])]
    slipper = replace(slipper, level=float(shape.room(covered).max()) + room)
    # the sole ends behind where the sides of the upper do
    middle = np.array([0.0, 0.5 * (end + shape.length), bed[0] + _FOXING_HIGH_MM * s])
    ends = [met(slipper.within, middle, way * np.array([1.0, 0.0, 0.0]), shape.length) for way in (-1.0, 1.0)]
    beside = float(shape.beside(np.array(ends)).mean()) + wall + _FOXING_MM * s
    return replace(slipper, beside=max(beside, BESIDE_MM * s))


def _footbed(foot: Mesh, gap: float) -> tuple[float, float]:
    """The plane that heel and ball stand on, `gap` below them: its height at the heel, and its rise per mm forward."""
    side = foot.vertices[foot.vertices[:, 2] < 0.1 * np.ptp(foot.vertices[:, 1])][:, 1:]
    ring = side[ConvexHull(side).vertices]  # counter-clockwise: along the underside it runs forward
    ahead = np.roll(ring, -1, axis=0)
    under = (ring[:, 0] < 0.4 * side[:, 0].max()) & (ahead[:, 0] >= 0.4 * side[:, 0].max())
    (y, z), (there, height) = ring[under][0], ahead[under][0]
    rise = (height - z) / (there - y)
    return float(z - rise * y - gap), float(rise)


def _bounds(slipper: _Slipper, foot: Mesh, toe: float) -> Float64[np.ndarray, "2 3"]:
    s = slipper.scale
    low = foot.vertices[foot.vertices[:, 2] < 0.3 * slipper.last.length]
    side = slipper.wall + slipper.level + (_FOXING_MM + 6.0) * s
    lower = [low[:, 0].min() - side, -16.0 * s, slipper.bed[0] - slipper.sole - 4.0 * s]
    upper = [low[:, 0].max() + side, slipper.last.length + toe + side + 4.0 * s, slipper.top[1] + 16.0 * s]
    return np.array([lower, upper])


def _resting(part: Body, foot: Mesh, slipper: _Slipper, which: str) -> dict[str, Region]:
    """The skin that stands on the footbed, and what the edge of the upper lies on."""
    gap = foot.vertices[:, 2] - slipper.floor(foot.vertices)
    low = gap < gap.min() + max(slipper.scale, 0.5)
    found = {}
    for name in ("sole_heel", "sole_ball", "sole_toes"):
        region = part.regions.get(f"{name}_{which}")
        if region is not None and low[region.vertex_indices].any():
            found[region.name] = region.at(region.vertex_indices[low[region.vertex_indices]])
    instep = part.regions.get(f"instep_{which}")
    if instep is not None:
        under = slipper.behind(foot.vertices[instep.vertex_indices]) < -2.0 * slipper.wall
        if under.any():
            found[instep.name] = instep.at(instep.vertex_indices[under])
    return found


def _sliding_off(
    frame: Frame, slipper: _Slipper, foot: Mesh, skin: SurfaceDistance, mesh: Mesh, gives: float
) -> Float64[np.ndarray, "K 4 4"]:
    """The slipper goes forward and a little down: the foot leaves it backwards, its heel first lifted by that much.

    Straight forward where that presses the toes by more than `gives`.
    """
    travel = float(foot.vertices[:, 1].max() - slipper.side[0]) + 5.0
    poses = np.tile(np.eye(4), (36, 1, 1))
    for drop in _DROPS:
        way = frame.axes[1] - drop * _UP
        poses[:, :3, 3] = travel * np.linspace(0.0, 1.0, len(poses))[:, None] ** 1.5 * way
        if passage(mesh.vertices[::_EVERY], poses, skin).depth_mm.max() <= gives:
            break
    return poses


def _motifs(slipper: _Slipper, frame: Frame) -> tuple[MotifFrame, ...]:
    """On the toes, seen from in front and above; and where ears stand, upright behind them."""
    s, length = slipper.scale, slipper.last.length
    across = np.array([-1.0, 0.0, 0.0])  # whoever looks at the toes sees the foot's right on the left

    def on_top(y: float) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]:
        place = met(slipper.outer, np.array([0.0, y, 0.3 * slipper.top[1]]), _UP, 3.0 * slipper.top[1])
        out = slope(slipper.outer, place[None], 0.3 * s)[0]
        out = out * [0.0, 1.0, 1.0]
        return place, out / np.linalg.norm(out)

    toe, out = on_top(0.5 * (slipper.top[0] + length))
    ears, _ = on_top(slipper.top[0] + 0.08 * length)
    turned, axes = frame.axes.T, frame.axes
    right = across @ axes
    return (
        MotifFrame(
            "toe",
            frame.outside(toe[None])[0],
            right,
            turned @ np.cross(out, across),
            (70.0 * s, 60.0 * s),
            30.0 * s,
        ),
        MotifFrame("ears", frame.outside(ears[None])[0], right, _UP, (70.0 * s, 60.0 * s), 40.0 * s),
    )


KIND = Kind(
    "slippers",
    build,
    (
        Parameter(
            "side",
            "",
            0.0,
            0.0,
            "the foot that it is made on; the other is its mirror image",
            ("left", "right"),
        ),
        Parameter("size", "mm", 20.0, 350.0, "length of the foot, or a shoe size (EU42, US9, MP265)"),
        Parameter(
            "fit", "mm", 0.4, 8.0, "room round the foot: 2 for soft material, 3 for rigid", tuple(ROOM_MM)
        ),
        Parameter("toe", "mm", 0.4, 25.0, "room before the toes"),
        Parameter("cover", "%", 35.0, 65.0, "how much of the length the upper covers, from the toes back"),
        Parameter("wall", "mm", 1.6, 8.0, "thickness of the upper"),
        Parameter("sole", "mm", 3.0, 40.0, "thickness of the sole under the heel"),
    ),
    "Printed in TPU on the sole; the upper needs no supports but over the toes.",
)
