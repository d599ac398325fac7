"""What is measured on a body, mm: the tape and calliper measures that a maker takes.

Definitions follow ANSUR II (Hotzman et al. 2011, NATICK/TR-11/017) where it has the measure.  All but the height are
taken on the smoothed skin of the body's parts, the one that templates are laid on.

height        floor to crown
head          largest level girth above the brows        head_breadth  largest breadth above the ears
head_length   glabella to the back of the head           face_length   sellion to menton
face_breadth  between the zygia                          pupils        between the eye centres
neck          smallest girth square to the neck
wrist         smallest girth in the lower third of the forearm
hand          girth over the knuckles, without thumb     hand_length   wrist crease to middle finger tip
ring_finger   girth at 60 % of the proximal phalanx      ring_knuckle  girth at its far joint
foot          length                                     foot_width    breadth at the ball
foot_girth    girth over the ball
hand_folded   girth of the hand folded to pass a bangle: 1.07 of the hand's, unless a tape said otherwise

Hands and feet have two sides: `wrist_left`, `wrist_right`; the plain name means both.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

import numpy as np

from fabcraft.body.body import Body
from fabcraft.body.tape import Sections, Tape, between, extent, girth, longest, shortest
from fabcraft.errors import InputError

FOLDED = 1.07
"""Girth of the folded hand over that of the flat one.  An estimate: a bangle of 199 mm is worn by a medium woman's
hand of 187 mm."""

SIDES = ("left", "right")
_ALIKE_MM = 0.05
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Measure:
    """How one measure is taken."""

    part: str
    """Part of the body; `*` stands for a side, "" for the whole skin."""
    read: Callable[[Body, str], Tape]
    """(the part, the side) to the tape."""

    @property
    def paired(self) -> bool:
        """Whether there is one on each side."""
        return self.part.endswith("*")


def _height(body: Body, _: str) -> Tape:
    if not {"vertex", "heel_left"} <= body.landmarks.keys():
        raise InputError(f"{body.name} does not stand from floor to crown", "Use a whole body.")
    return extent(body.mesh, _UP, np.ones(len(body.mesh.vertices), dtype=bool))


def _head(body: Body, _: str) -> Tape:
    at = body.landmarks
    eyes = (at["eye_left"] + at["eye_right"]) / 2
    middle = np.array([0.0, (at["glabella"][1] + at["opisthocranion"][1]) / 2, eyes[2]])
    level, up = Sections(body.mesh, _UP), body.scale * _UP
    return _extreme(longest, lambda height: level.girth(middle + up * height), 30.0, 60.0, 4)


def _head_breadth(body: Body, _: str) -> Tape:
    if body.kind == "character":  # whose ears may stand on top of its head
        return between(body.mesh, body.landmarks["euryon_right"], body.landmarks["euryon_left"])
    above = max(body.landmarks[f"ear_tip_{side}"][2] for side in SIDES) + 8.0
    return extent(body.mesh, np.array([1.0, 0.0, 0.0]), body.mesh.vertices[:, 2] > above)


def _landmarks(start: str, end: str) -> Callable[[Body, str], Tape]:
    def read(body: Body, side: str) -> Tape:
        places = [body.landmarks[key.replace("*", side)] for key in (start, end)]
        return between(body.mesh, *places)

    return read


def _pupils(body: Body, _: str) -> Tape:
    line = np.stack([body.landmarks["eye_right"], body.landmarks["eye_left"]])
    length = float(np.linalg.norm(line[1] - line[0]))
    toward = (line[1] - line[0]) / length
    nowhere, none = np.zeros((0, 2), dtype=np.int64), np.zeros(0)
    return Tape(
        length, line, np.zeros((0, 3)), nowhere, none, joints={"eye_right": -toward, "eye_left": toward}
    )


def _neck(body: Body, _: str) -> Tape:
    root, axis = body.joints["neck_root"], body.joints["head"] - body.joints["neck_root"]
    square = Sections(body.mesh, axis)
    return _extreme(shortest, lambda t: square.girth(root + t * axis), -0.3, 0.9, 7)


def _wrist(body: Body, side: str) -> Tape:
    wrist = body.joints[f"wrist_{side}"]
    along = body.joints[f"lowerarm_{side}"] - wrist  # half the forearm
    square = Sections(body.mesh, along)
    return _extreme(shortest, lambda t: square.girth(wrist + t * along), 0.0, 0.36, 7)


def _hand(body: Body, side: str) -> Tape:
    middle = (body.joints[f"finger2_1_{side}"] + body.joints[f"finger5_1_{side}"]) / 2
    return girth(body.mesh, middle, middle - body.joints[f"wrist_{side}"])


def _ring_finger(body: Body, side: str) -> Tape:
    base, knuckle = body.joints[f"finger4_1_{side}"], body.joints[f"finger4_2_{side}"]
    return girth(body.mesh, base + 0.6 * (knuckle - base), knuckle - base)


def _ring_knuckle(body: Body, side: str) -> Tape:
    base, knuckle, last = (body.joints[f"finger4_{bone}_{side}"] for bone in (1, 2, 3))
    before, after = knuckle - base, last - knuckle
    return girth(body.mesh, knuckle, before / np.linalg.norm(before) + after / np.linalg.norm(after))


def _along_foot(body: Body, side: str) -> np.ndarray:
    away = body.landmarks[f"toe_tip_{side}"] - body.landmarks[f"heel_{side}"]
    return away * [1.0, 1.0, 0.0]


def _foot(body: Body, side: str) -> Tape:
    below = body.mesh.vertices[:, 2] < body.joints[f"foot_{side}"][2]
    return extent(body.mesh, _along_foot(body, side), below)


def _foot_width(body: Body, side: str) -> Tape:
    along, heel = _along_foot(body, side), body.landmarks[f"heel_{side}"]
    medial, lateral = body.landmarks[f"ball_medial_{side}"], body.landmarks[f"ball_lateral_{side}"]
    across = lateral - medial
    share = (body.mesh.vertices - heel) @ along / (along @ along)
    outward = (body.mesh.vertices - medial) @ across / (across @ across)
    before_toes = share < 0.80 - 0.14 * outward  # the little toe begins farther back
    below = body.mesh.vertices[:, 2] < body.joints[f"foot_{side}"][2]
    return extent(body.mesh, np.cross(_UP, along), below & (share > 0.5) & before_toes)


def _foot_girth(body: Body, side: str) -> Tape:
    medial, lateral = body.landmarks[f"ball_medial_{side}"], body.landmarks[f"ball_lateral_{side}"]
    return girth(body.mesh, (medial + lateral) / 2, np.cross(lateral - medial, _UP))


def _extreme(
    choose: Callable[[list[Tape]], Tape], at: Callable[[float], Tape], low: float, high: float, count: int
) -> Tape:
    """The shortest or longest tape of a sweep: `count` places, then between them to a sixteenth of their distance.

    A coarser sweep would jump from place to place while a body is fitted, and never settle.
    """
    places = np.linspace(low, high, count).tolist()
    found = {place: at(place) for place in places}
    step = (high - low) / (count - 1)
    for _ in range(4):
        step /= 2.0
        best = choose(list(found.values()))
        middle = next(place for place, tape in found.items() if tape is best)
        found |= {near: at(near) for near in (middle - step, middle + step) if low <= near <= high}
    return choose(list(found.values()))


MEASURES: Mapping[str, Measure] = {
    "height": Measure("", _height),
    "head": Measure("head", _head),
    "head_breadth": Measure("head", _head_breadth),
    "head_length": Measure("head", _landmarks("glabella", "opisthocranion")),
    "face_length": Measure("head", _landmarks("sellion", "menton")),
    "face_breadth": Measure("head", _landmarks("zygion_right", "zygion_left")),
    "pupils": Measure("head", _pupils),
    "neck": Measure("head", _neck),
    "wrist": Measure("hand_*", _wrist),
    "hand": Measure("hand_*", _hand),
    "hand_length": Measure("hand_*", _landmarks("wrist_palm_*", "middle_finger_tip_*")),
    "ring_finger": Measure("hand_*", _ring_finger),
    "ring_knuckle": Measure("hand_*", _ring_knuckle),
    "foot": Measure("foot_*", _foot),
    "foot_width": Measure("foot_*", _foot_width),
    "foot_girth": Measure("foot_*", _foot_girth),
}


def sided(name: str) -> tuple[str, str]:
    """(the measure, its side): `wrist_left` is ("wrist", "left"); of an unpaired or plain name the side is ""."""
    base, _, side = name.rpartition("_")
    return (base, side) if side in SIDES and base in MEASURES else (name, "")


def tapes(body: Body, names: Collection[str] = tuple(MEASURES)) -> dict[str, Tape]:
    """The measures `names` that `body` has the places for, both sides of the paired ones, as `wrist_left`."""
    parts: dict[str, Body | None] = {"": body}
    found: dict[str, Tape] = {}
    for name in names:
        measure = MEASURES[name]
        for side in SIDES if measure.paired else ("",):
            key = measure.part.replace("*", side)
            if key not in parts:
                parts[key] = _part_or_none(body, key)
            part = parts[key]
            if part is not None and (tape := _read_or_none(measure, part, side)) is not None:
                found[f"{name}_{side}" if side else name] = tape
    return found


def measured(body: Body, names: Collection[str] = tuple(MEASURES)) -> dict[str, float]:
    """What `tapes` reads, mm; a pair that is alike to 0.05 mm under its plain name."""
    lengths = {name: tape.length_mm for name, tape in tapes(body, names).items()}
    found: dict[str, float] = {}
    for name, length in lengths.items():
        base, side = sided(name)
        twin = lengths.get(f"{base}_right") if side == "left" else lengths.get(f"{base}_left")
        if side and twin is not None and abs(length - twin) < _ALIKE_MM:
            found.setdefault(base, length)
        else:
            found[name] = length
    return found


def _part_or_none(body: Body, name: str) -> Body | None:
    try:
        return body.part(name)
    except InputError:  # it has no such part
        return None


def _read_or_none(measure: Measure, part: Body, side: str) -> Tape | None:
    try:
        return measure.read(part, side)
    except (InputError, KeyError):  # a scan or a character may lack a landmark
        return None


def folded_hand_mm(body: Body, side: str) -> float:
    """Girth of the folded hand of `side`, mm: what a tape said, or `FOLDED` times the flat hand's.

    Raises `InputError` when `body` has no such hand.
    """
    found = folded_hands(body)
    for name in (f"hand_folded_{side}", "hand_folded"):
        if name in found:
            return found[name]
    raise InputError(f"{body.name} has no {side} hand that could be measured", "Choose another body or hand.")


def folded_hands(body: Body) -> dict[str, float]:
    """Girth of the folded hands that `body` has, mm, as `hand_folded_left`: what a tape said, or `FOLDED` times the
    flat hand's.  Alike hands are one `hand_folded`."""
    found: dict[str, float] = {}
    for name, tape in tapes(body, ("hand",)).items():
        folded = name.replace("hand", "hand_folded")
        said = body.measures.get(folded) or body.measures.get("hand_folded")
        found[folded] = said.reached_mm if said else FOLDED * tape.length_mm
    lengths = list(found.values())
    if len(lengths) == 2 and abs(lengths[0] - lengths[1]) < _ALIKE_MM:
        return {"hand_folded": lengths[0]}
    return found
