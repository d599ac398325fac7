"""The bangle: a closed band that goes over the folded hand, or an open cuff that goes on from the side.

Closed, its inner girth is the folded hand's plus 4 mm, an ellipse of 1 : 0.93 that hangs from the wrist.  Open, it follows
the wrist at 12 mm more girth; its gap lets the narrow side of the wrist through while its ends spring open, and then it is
turned until the gap lies on the palm's side.  Sizes: Indian bangle sizes, "2-4" is 2 4/16 inch of inner diameter.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial.transform import Rotation

from fabcraft.body.body import Body
from fabcraft.body.measures import FOLDED, folded_hand_mm
from fabcraft.body.sizes import BANGLE_PLAY_MM, FOLDED_HAND, asked
from fabcraft.body.tape import girth
from fabcraft.errors import InputError
from fabcraft.geometry.oval import Oval, angles
from fabcraft.mesh import Mesh
from fabcraft.template.band import Profile, closed_band, open_band
from fabcraft.template.catalogue import Kind, Settings
from fabcraft.template.limb import Axes, Station, along, centred, facing, loft, poses, station, straight
from fabcraft.template.rolled import Rolled
from fabcraft.template.template import DonningPath, MotifFrame, Parameter, Template
from fabcraft.template.whole import profile

EDGE_MM, WALL_MM, LEAST_WALL_MM, WIDTH_MM = 1.4, 3.0, 1.6, 14.0
WRIST_MM = 174.0
"""Girth of a median man's wrist, which the listed lengths belong to."""
_ROUNDNESS = 0.93
_OVER_WRIST_MM = 12.0
_ABOVE_WRIST_MM = 20.0
_HANGING_MM = 0.5
"""Gap where a closed bangle hangs from the wrist."""
_HAND_GIVES_MM, _SKIN_GIVES_MM = 3.0, 3.0
"""Of the folded hand's girth; of the wrist, in depth."""
_FLEX = 0.085
"""How far each end of a cuff springs open, as a share of its diameter: 3 mm of PA12 or PETG at about 2 % strain."""
_CROWN = 0.15
"""How much higher than its wall the band is in its middle, as a share of the wall."""
_SECTIONS, _TURNS, _STEPS = 7, 14, 26
_LIFTED = 7  # a sixth of the poses, over which what a band is off the middle of the limb fades
_PLACES = ("wrist", "finger2_1", "finger5_1", "wrist_back", "wrist_palm", "ring_finger_tip")


@dataclass(frozen=True, eq=False)
class _Wrist:
    """Where a bangle is worn, and how large it is made."""

    part: Body
    folded_mm: float
    """Girth of the folded hand; 0 for what does not fold."""
    bone: Float64[np.ndarray, "3"]
    """The wrist's."""
    knuckles: Float64[np.ndarray, "3"]
    """Between the first and the last finger's."""
    tip: Float64[np.ndarray, "3"]
    """Of the ring finger, or of the paw."""
    origin: Float64[np.ndarray, "3"]
    axes: Axes
    """The third to the hand, the second out of its back."""
    oval: Oval
    """Held by the wrist under the width of the band."""
    scale: float
    """Girth of the wrist over a median man's."""
    width: float
    wall: float

    @property
    def soft(self) -> bool:
        """People fold their hands, and their skin gives."""
        return self.part.kind != "character"


@dataclass(frozen=True, eq=False)
class _Made:
    """A bangle of either style."""

    mesh: Mesh
    locked: Bool[np.ndarray, " F"]
    rolled: Rolled
    path: DonningPath
    listed_mm: tuple[float, float]
    parameters: dict[str, float]
    note: str


def build(body: Body, settings: Settings) -> Template:
    """The bangle for `body`.  Raises `InputError` for a body without a wrist, and for a size that does not go on."""
    chosen = KIND.settled(settings)
    hand, open_ = str(chosen.get("hand", "left")), chosen.get("style", "closed") == "open"
    part, at = KIND.worn(body, f"hand_{hand}", [f"{place}_{hand}" for place in _PLACES])
    soft = part.kind != "character"
    folded = float(chosen.get("folded_hand", folded_hand_mm(body, hand) if soft else 0.0))
    wrist = _wrist(part, folded, [at[f"{place}_{hand}"] for place in _PLACES], chosen)
    edge = EDGE_MM * float(np.clip(wrist.scale, 0.4, 1.0))
    made = (_open if open_ else _closed)(wrist, chosen, edge)
    return Template(
        name=KIND.name,
        body=part,
        mesh=made.mesh,
        rims=(),
        surface=None,
        wall_mm=wrist.wall,
        genus=0 if open_ else 1,
        contacts=(f"wrist_{hand}",),
        edge_mm=edge,
        donning=tuple(wrist.axes[2].tolist()),
        path=made.path,
        locked=made.locked,
        motifs=(_band(made.rolled, wrist), _whole(made, wrist)),
        listed_mm=made.listed_mm,
        parameters={"width": wrist.width, "thickness": wrist.wall, **made.parameters},
        notes=(made.note,),
    )


def diameter_mm(size: str | float) -> float:
    """Inner diameter of a bangle: a number is the diameter itself, "2-4" is 2 4/16 inch.

    Raises `InputError` for another name.
    """
    if isinstance(size, int | float):
        return float(size)
    name = size.strip().upper()
    return (
        asked({FOLDED_HAND: name if name.startswith("IN") else f"IN{name}"})[0].mm + BANGLE_PLAY_MM
    ) / np.pi


def _wrist(
    part: Body, folded: float, places: Sequence[Float64[np.ndarray, "3"]], chosen: Mapping[str, float | str]
) -> _Wrist:
    bone, first, last, back, palm, tip = places
    knuckles, soft = 0.5 * (first + last), part.kind != "character"
    axes = facing((knuckles if soft else tip) - bone, back - palm)
    scale = girth(part.mesh, bone, axes[2]).length_mm / WRIST_MM
    width = float(chosen.get("width", WIDTH_MM * scale))
    room = (
        -float(((part.mesh.vertices - bone) @ axes[2]).min()) - 0.5 * width - 1.0
    )  # up to where the part was cut off
    origin = bone - min(_ABOVE_WRIST_MM * scale, room) * axes[2]
    if soft:
        origin, axes = centred(part.mesh, origin, axes, 8.0 * scale)
    natural = WALL_MM if soft else max(LEAST_WALL_MM, 0.02 * float(part.mesh.size_mm.max()))
    under = np.linspace(-0.5 * width, 0.5 * width, _SECTIONS)
    oval = Oval.holding([station(part.mesh, origin + at * axes[2], axes).oval for at in under])
    return _Wrist(
        part,
        folded,
        bone,
        knuckles,
        tip,
        origin,
        axes,
        oval,
        scale,
        width,
        float(chosen.get("thickness", natural)),
    )


def _closed(wrist: _Wrist, chosen: Mapping[str, float | str], edge: float) -> _Made:
    gap, size = wrist.part.clearance_mm(_HANGING_MM), chosen.get("size")
    gives = _HAND_GIVES_MM * wrist.scale if wrist.soft else 0.0
    stations = _over_the_hand(wrist)
    hand = max(one.oval.length for one in stations)
    ellipse = Oval.ellipse(1.0, _ROUNDNESS)
    held = [ellipse.scaled(hand / ellipse.length), wrist.oval.grown(gap).moved(-wrist.oval.middle)]
    shape = Oval.holding([*held, *([] if wrist.soft else [one.oval.grown(gap) for one in stations])])
    needed = max(hand, shape.length)
    inside = (
        needed + BANGLE_PLAY_MM * wrist.scale
        if size is None
        else np.pi * KIND.within("size", diameter_mm(size))
    )
    if inside < needed - gives:
        raise InputError(
            f"a closed bangle of {inside:.0f} mm inner girth does not go over the folded hand of {needed:.0f} mm",
            f"Choose {_named(needed)}{np.ceil(needed / np.pi):.0f} mm of inner diameter, or style=open.",
        )
    shape = shape.grown((inside - shape.length) / (2.0 * np.pi))
    rolled = Rolled(wrist.origin, wrist.axes, _hung(shape.moved(wrist.oval.middle), wrist, gap))
    profile = Profile(
        lambda u: np.full(len(u), 0.5 * wrist.width),
        np.zeros_like,
        lambda u: np.full(len(u), (1.0 + _CROWN) * wrist.wall),
        (0.45 * wrist.wall, 0.45 * wrist.wall),
        outer_crown_mm=_CROWN * wrist.wall,
    )
    mesh, locked = closed_band(rolled, profile, edge, KIND.name)
    path = DonningPath(
        poses(stations, rolled.middle),
        gives / (2.0 * np.pi),
        f"the folded hand gives {gives:.1f} mm of its girth" if wrist.soft else "nothing gives",
        loft([_conformed(one, shape) for one in stations], "folded hand") if wrist.soft else None,
    )
    return _Made(
        mesh,
        locked,
        rolled,
        path,
        (gap, (inside - wrist.oval.length) / (2.0 * np.pi)),
        {"size": inside / np.pi, "folded_hand": needed},
        f"The inner girth is {inside:.0f} mm, {inside / np.pi:.1f} mm across; the hand asks for {needed:.0f} mm.",
    )


def _named(needed: float) -> str:
    """The Indian size that goes over a hand, where there is one."""
    sixteenths = int(np.ceil(16.0 * (needed / np.pi / 25.4 - 2.0)))
    return f"size 2-{sixteenths}, or " if 0 <= sixteenths < 16 else ""


def _over_the_hand(wrist: _Wrist) -> list[Station]:
    """Sections of the hand from the seat to past its tip, around a straight line.

    What does not fold has to go through as it is seen along the line.
    """
    part, axes = wrist.part, wrist.axes
    if not wrist.soft:
        local = (part.mesh.vertices - wrist.origin) @ axes.T
        ahead = local[local[:, 2] > -0.5 * wrist.width]
        shadow = Oval.around(ahead[:, :2])
        # it is lifted off where it hangs before it goes on: nothing gives way beside it
        lifted, further = np.zeros(_LIFTED), ahead[:, 2].max() + wrist.width
        line = np.concatenate([lifted, np.linspace(0.0, further, _TURNS + _STEPS - _LIFTED)])
        middle = wrist.origin + shadow.middle @ axes[:2]
        return [Station(middle + at * axes[2], axes, shadow.moved(-shadow.middle)) for at in line]
    flesh = station(part.mesh, wrist.knuckles, facing(wrist.knuckles - wrist.bone, axes[1]))
    most = wrist.folded_mm
    stations = []
    for index, one in enumerate(along(part.mesh, straight([wrist.origin, flesh.middle], _STEPS), axes)):
        folded = one.oval.length * FOLDED ** min(1.0, 2.0 * index / _STEPS)
        stations.append(_sized(one, most if index == _STEPS - 1 else min(folded, most)))
    last, reach = stations[-1], float(np.linalg.norm(wrist.tip - wrist.knuckles)) + wrist.width
    for share in np.linspace(0.0, 1.0, _TURNS + 1)[1:]:
        further = Station(last.origin + share * reach * last.axes[2], last.axes, last.oval)
        stations.append(_sized(further, most * (1.0 - 0.4 * share)))
    return stations


def _sized(one: Station, girth_mm: float) -> Station:
    """The station at another girth, its middle on the line."""
    return Station(one.origin, one.axes, one.oval.moved(-one.oval.middle).scaled(girth_mm / one.oval.length))


def _conformed(one: Station, shape: Oval) -> Station:
    """The station with a section of the same girth and the shape of the opening: flesh gives way to a band."""
    turned = shape.scaled(one.oval.length / shape.length)
    return Station(one.origin, one.axes, turned.moved(one.oval.middle - turned.middle))


def _hung(shape: Oval, wrist: _Wrist, gap_mm: float) -> Oval:
    """The opening moved down until it hangs from the upper side of the wrist, `gap_mm` above the skin."""
    down = wrist.axes[:2] @ np.array([0.0, 0.0, -1.0])
    if np.linalg.norm(down) < 0.1:  # the arm points down
        return shape
    down = down / np.linalg.norm(down)
    lowered = -(down[0] * np.cos(angles()) + down[1] * np.sin(angles()))
    room = shape.support - wrist.oval.support - gap_mm
    side = lowered > 1e-3
    return shape.moved(max(0.0, float((room[side] / lowered[side]).min())) * down)


def _open(wrist: _Wrist, chosen: Mapping[str, float | str], edge: float) -> _Made:
    size, least = chosen.get("size"), wrist.part.clearance_mm(0.5)
    slide_mm, narrow = _narrowest(wrist)
    across = (wrist.oval.length + _OVER_WRIST_MM * wrist.scale) / np.pi
    gives = _FLEX * across + (_SKIN_GIVES_MM if wrist.soft else 0.0)
    if size is None:  # more round about a wrist that is flat and hard, or it could not be turned
        across += 2.0 * max(
            0.0, _turning(narrow, wrist.oval) - 0.5 * (across - wrist.oval.length / np.pi) - gives
        )
    else:
        across = KIND.within("size", diameter_mm(size))
    clearance = 0.5 * (across - wrist.oval.length / np.pi)
    if clearance < least:
        raise InputError(
            f"a cuff of {across:.1f} mm across does not go round the wrist",
            f"Choose {wrist.oval.length / np.pi + 2.0 * least:.1f} mm of inner diameter or more.",
        )
    rolled = Rolled(wrist.origin, wrist.axes, wrist.oval.grown(clearance))
    thick = narrow.width(0.5 * np.pi)
    flex = _FLEX * across
    gives = flex + (_SKIN_GIVES_MM if wrist.soft else 0.0)
    needed = thick - 2.0 * gives
    gap = float(chosen.get("gap", max(needed + 1.5, 0.15 * rolled.oval.length)))
    if gap < needed:
        raise InputError(
            f"a gap of {gap:.1f} mm does not let the wrist through, which is {thick:.1f} mm thick, although its ends spring "
            f"open by {flex:.1f} mm each",
            f"Choose a gap of {needed:.1f} mm or more.",
        )
    mesh, locked = open_band(
        rolled, (wrist.width, wrist.wall), gap, 0.45 * wrist.wall, _CROWN * wrist.wall, edge, KIND.name
    )
    why = f"each end springs open by {flex:.1f} mm" + ("" if gives == flex else " and the skin gives")
    return _Made(
        mesh,
        locked,
        rolled,
        DonningPath(_turned_off(wrist, rolled, slide_mm, narrow), gives, why),
        (clearance, clearance),
        {"size": across, "gap": gap},
        f"The gap is {gap:.1f} mm; the wrist is {thick:.1f} mm thick where it goes through.",
    )


def _narrowest(wrist: _Wrist) -> tuple[float, Oval]:
    """How far towards the hand, mm, the wrist is thinnest under the whole band, and the section that holds it there."""
    half, steps = 0.5 * wrist.width, np.arange(0.0, 1.21, 0.15) * _ABOVE_WRIST_MM * wrist.scale
    reach = np.arange(-half, steps[-1] + half + 1e-9, 2.0 * wrist.scale)
    ovals = [station(wrist.part.mesh, wrist.origin + at * wrist.axes[2], wrist.axes).oval for at in reach]
    under = [
        Oval.holding([one for one, at in zip(ovals, reach, strict=True) if abs(at - step) <= half])
        for step in steps
    ]
    best = int(np.argmin([oval.width(0.5 * np.pi) for oval in under]))
    return float(steps[best]), under[best]


def _turning(narrow: Oval, around: Oval) -> float:
    """How much farther than `around` a cuff must be from its middle to be turned by a quarter on the section `narrow`."""
    still, quarter = narrow.moved(-narrow.middle).support, len(narrow.support) // 4
    turned = around.moved(-around.middle).support
    return max(float((still - np.roll(turned, shift)).max()) for shift in range(0, quarter + 1, 6))


def _turned_off(wrist: _Wrist, rolled: Rolled, slide_mm: float, narrow: Oval) -> Float64[np.ndarray, "K 4 4"]:
    """The cuff slides to where the wrist is thinnest, turns by a quarter so that its gap faces the narrow side, and goes."""
    path = np.tile(np.eye(4), (_TURNS + _STEPS, 1, 1))
    middle, (across, out, axis) = rolled.middle, wrist.axes
    reach = rolled.oval.width(0.0) + 2.0 * wrist.wall + 10.0
    ends = rolled.world(np.array([[0.5 * rolled.oval.length, 0.0, 0.0]]))[0] - middle
    thick_middle = 0.5 * (
        narrow.support[len(narrow.support) // 4] - narrow.support[3 * len(narrow.support) // 4]
    )
    # turned by a quarter, the middle of the gap comes to lie at ends . across along the second axis
    aside = thick_middle - (middle - wrist.origin) @ out - ends @ across
    for index in range(len(path)):
        begun = min(1.0, index / (_TURNS - 1))
        turn = Rotation.from_rotvec(0.5 * np.pi * begun * axis).as_matrix()
        # the gap, first on the palm's side, then faces along the first axis: the cuff goes the other way
        off = -max(0.0, (index - _TURNS + 1) / _STEPS) * reach * across
        path[index, :3, :3] = turn
        path[index, :3, 3] = middle - turn @ middle + begun * (slide_mm * axis + aside * out) + off
    return path


def _band(rolled: Rolled, wrist: _Wrist) -> MotifFrame:
    """Around the band, upright for whoever stands before the wearer with hanging arms."""
    left, _, along = rolled.axes
    height = (1.0 + _CROWN) * wrist.wall
    top = rolled.world(np.array([[0.0, 0.0, height]]))[0]
    size = (0.4 * rolled.oval.grown(height).length, 1.6 * wrist.width)
    return MotifFrame("band", top, left, -along, size, 8.0 * wrist.scale, (rolled.middle, -along))


def _whole(made: _Made, wrist: _Wrist) -> MotifFrame:
    """The bangle seen along the arm, from the hand, the back of the hand up."""
    _, back, along = made.rolled.axes
    return profile(made.mesh, made.rolled.middle, along, back, wrist.wall, 18.0 * wrist.scale)


KIND = Kind(
    "bangle",
    build,
    (
        Parameter("hand", "", 0.0, 0.0, "which wrist wears it", ("left", "right")),
        Parameter("style", "", 0.0, 0.0, "over the hand, or a cuff with a gap", ("closed", "open")),
        Parameter("width", "mm", 4.0, 60.0, "of the band"),
        Parameter("thickness", "mm", 1.6, 8.0, "of the band"),
        Parameter("size", "mm", 10.0, 110.0, 'inner diameter, or a size such as "2-6"'),
        Parameter("gap", "mm", 5.0, 60.0, "between the ends of a cuff"),
        Parameter("folded_hand", "mm", 30.0, 350.0, "girth of the folded hand where it was taped"),
    ),
    "Lay it on its side; an open one wants a tough material (PA12, PETG) and beads that run around it.",
)
