"""The regions of a character, laid out as on people (`bake_regions`), in lengths that scale with each part.

Rules are people's (`region.RULES`); `scaled_rule` scales their distances with the part, but not under the least clearance
of printed parts.  A character does not give, so nothing presses into it.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Float64
from scipy.spatial import cKDTree

from fabcraft.body.body import LEAST_CLEARANCE_MM
from fabcraft.body.characters.model import Model
from fabcraft.body.characters.places import Points, foot_vertices, hand_axes
from fabcraft.body.characters.shapes import Number
from fabcraft.body.contacts import skin_disc
from fabcraft.body.region import RULES, Region, human_region
from fabcraft.mesh import Mesh

Members = dict[str, np.ndarray]

_ON_THE_BACK = {"wrist": 0.25, "ring_finger": 0.5}
"""Share of the weight that bands have on the back of the hand, as on people."""


def scaled_rule(region: Region, scale: float) -> Region:
    """The region with the distances of a part `scale` times the size of a person's."""

    def scaled(distance_mm: float) -> float:
        return max(distance_mm * scale, LEAST_CLEARANCE_MM) if distance_mm > 0.0 else 0.0

    return replace(region, gap_mm=scaled(region.gap_mm), never_closer_mm=scaled(region.never_closer_mm))


def part_of(region: str) -> str:
    """The kind of part whose size a region's distances go with: head, hand or foot."""
    if region.startswith(("wrist", "ring_finger")):
        return "hand"
    return "foot" if region.startswith(("sole", "instep", "toes")) else "head"


def regions(
    model: Model, mesh: Mesh, marks: Points, joints: Points, scales: Mapping[str, float]
) -> dict[str, Region]:
    """Every region that the character has, with people's rules.

    mesh, marks, joints : as it is modelled; scales : size of head, hand and foot there over a median man's.
    """
    members = _of_face(model, mesh, marks, scales["head"]) | _of_skull_and_neck(
        model, mesh, marks, scales["head"]
    )
    members |= _of_hand(model, mesh, joints, scales["hand"]) | _of_foot(model, mesh, marks, scales["foot"])
    opposite = cKDTree(mesh.vertices).query(mesh.vertices * [-1.0, 1.0, 1.0])[1]
    found = {}
    for name, own in members.items():
        if name in RULES:
            found[name] = human_region(name, np.union1d(own, opposite[own]))
            continue
        own = own[mesh.vertices[own, 0] > 0.0]
        emphasis = _palm_share(model, mesh, own, _ON_THE_BACK[name]) if name in _ON_THE_BACK else None
        found[f"{name}_left"] = human_region(f"{name}_left", own, emphasis)
        found[f"{name}_right"] = human_region(f"{name}_right", opposite[own], emphasis)
    return found


def _of_face(model: Model, mesh: Mesh, marks: Points, scale: float) -> Members:
    def front(places: Iterable[tuple[Number, Number]], radius_mm: float) -> np.ndarray:
        """The skin round places (x, z) in the front view."""
        return _disc(model, mesh, np.array([_foremost(mesh, place) for place in places]), radius_mm)

    eye, brow, root = np.array(model.head.eye), marks["glabella"][2], marks["sellion"]
    found = {
        "forehead": front(
            [(x, brow + 12.0 * scale) for x in scale * np.linspace(-30.0, 30.0, 9)], 9.0 * scale
        ),
        "cheekbone": front([(eye[0] + 10.0 * scale, eye[2] - 30.0 * scale)], 12.0 * scale),
        "nose_bridge": _disc(model, mesh, root[None], 8.0 * scale),
        "nose_tip": _disc(model, mesh, marks["pronasale"][None], 10.0 * scale),
        "nose_flank": front([(9.0 * scale, root[2] - 11.0 * scale)], 6.0 * scale),
        "lips": front([(x, model.head.mouth[2]) for x in scale * np.linspace(-15.0, 15.0, 5)], 8.0 * scale),
        "chin": _disc(model, mesh, marks["menton"][None], 14.0 * scale),
        "eye": np.flatnonzero(np.linalg.norm(mesh.vertices - eye, axis=1) < 1.05 * model.head.eye_radius),
    }
    if model.head.ear is not None:
        on_ear = (model.head.ear.shape.distance(mesh.vertices) < 1.0) & (mesh.vertices[:, 0] > 0.0)
        found["ear"] = np.flatnonzero(on_ear)
    return found


def _disc(model: Model, mesh: Mesh, points: Float64[np.ndarray, "N 3"], radius_mm: Number) -> np.ndarray:
    """The skin round points, at least two rings of vertices of it."""
    return skin_disc(mesh, points, max(float(radius_mm), 2.2 * model.cell_mm))


def _foremost(mesh: Mesh, place: tuple[Number, Number]) -> Float64[np.ndarray, "3"]:
    """The vertex nearest to (x, z) in the front view, of those not hidden behind others."""
    away = np.linalg.norm(mesh.vertices[:, [0, 2]] - place, axis=1)
    near = np.flatnonzero(away < max(4.0, 1.5 * away.min()))
    return mesh.vertices[near[mesh.vertices[near, 1].argmin()]]


def _of_skull_and_neck(model: Model, mesh: Mesh, marks: Points, scale: float) -> Members:
    def pad(point: Float64[np.ndarray, "3"], radius_mm: float) -> np.ndarray:
        return _disc(model, mesh, point[None], radius_mm)

    return {
        "crown": pad(marks["vertex"], 35.0 * scale),
        "temple": pad(marks["ear_root_top_left"] + scale * np.array([0.0, -22.0, 22.0]), 15.0 * scale),
        "nape": pad(marks["opisthocranion"] - scale * np.array([0.0, 0.0, 40.0]), 20.0 * scale),
        "ear_root": pad(marks["ear_root_top_left"], 10.0 * scale),
        "collarbone": pad(marks["collarbone_left"], 18.0 * scale),
        "nape_low": pad(marks["cervicale"], 20.0 * scale),
        "throat": pad(0.6 * marks["jugular_notch"] + 0.4 * marks["menton"], 14.0 * scale),
    }


def _of_hand(model: Model, mesh: Mesh, joints: Points, scale: float) -> Members:
    wrist, elbow = joints["wrist_left"], joints["lowerarm_left"]
    length = float(np.linalg.norm(elbow - wrist))
    found = {
        "wrist": _band(mesh, wrist, elbow, (-6.0 * scale / length, 13.0 * scale / length), model.arm.girth_mm)
    }
    if "finger4_1_left" in joints:
        base, knuckle = joints["finger4_1_left"], joints["finger4_2_left"]
        thick = 0.6 * float(np.linalg.norm(joints["finger4_1_left"] - joints["finger2_1_left"]))
        found["ring_finger"] = _band(mesh, base, knuckle, (0.35, 0.85), thick)
    return found


def _band(
    mesh: Mesh, start: np.ndarray, end: np.ndarray, between: tuple[float, float], girth_mm: Number
) -> np.ndarray:
    """The skin round the bone from `start` to `end` between two shares of its length, within `girth_mm` of it."""
    bone = end - start
    away = mesh.vertices - start
    share = away @ bone / (bone @ bone)
    distance = np.linalg.norm(away - share[:, None] * bone, axis=1)
    return np.flatnonzero((share > between[0]) & (share < between[1]) & (distance < girth_mm))


def _palm_share(model: Model, mesh: Mesh, members: np.ndarray, lowest: float) -> Float64[np.ndarray, " N"]:
    """1 on the palm's side of a band, `lowest` on the back, even between."""
    _, back = hand_axes(model)
    return lowest + (1.0 - lowest) * (0.5 - 0.5 * np.clip(mesh.vertex_normals[members] @ back, -1.0, 1.0))


def _of_foot(model: Model, mesh: Mesh, marks: Points, scale: float) -> Members:
    own = foot_vertices(model, mesh)
    points, down = mesh.vertices[own], -mesh.vertex_normals[own, 2]
    heel, toe = marks["heel_left"][1], marks["toe_tip_left"][1]
    share = (points[:, 1] - heel) / (toe - heel)
    sole, toes = (down > 0.6) & (points[:, 2] < 0.3 * model.foot.ankle[2]), share > 0.8
    places = {
        "sole_heel": sole & (share < 0.25),
        "sole_ball": sole & ~toes & (share > 0.55),
        "sole_toes": sole & toes,
        "toes": toes & ~sole,
    }
    instep = _disc(model, mesh, marks["instep_left"][None], 20.0 * scale)
    return {name: own[inside] for name, inside in places.items()} | {"instep": instep}
