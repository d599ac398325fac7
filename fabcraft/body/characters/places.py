"""The named points of a character: landmarks on its skin and joints inside it, under the names that people have them.

Some are met by a ray from inside (the vertex straight above the middle of the head); others are the skin nearest to a place
given by the model; those of the foot are measured on it.  Where a character has no ear of its own, the ear's landmarks
are where a person's would be: around the place where the side piece of glasses rests.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float64

from fabcraft.body.characters.model import Model
from fabcraft.body.characters.shapes import Number, Point, Shape, point
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh

Points = dict[str, Float64[np.ndarray, "3"]]
Place = np.ndarray | Point
Rays = dict[str, tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]]
"""(a point inside, unit direction) by name."""

_LEFT, _BACK, _UP = np.eye(3)
_EAR_ROOT = {
    "ear_root_back": (0.0, 0.10, -0.11),
    "ear_root_low": (0.0, 0.0, -0.23),
    "tragion": (0.0, -0.07, -0.09),
}
"""From the top of the ear's root, in shares of the head's height: a median man's."""


def landmarks(model: Model, shape: Shape, mesh: Mesh) -> Points:
    """Every landmark, mm, of the character as it is modelled; the eyes are centres, the others on `mesh`."""
    head = model.head
    middle, left = _met(shape, _rays_of_head(model)), _met(shape, _rays_of_side(model))
    near = {"menton": head.chin, "jugular_notch": model.neck.notch, "cervicale": model.neck.nape}
    middle |= {key: point(place) for key, place in near.items()}
    left |= {"zygion": point(head.cheek), "collarbone": point(model.neck.collarbone)}
    left |= _of_ears(model, middle["vertex"][2] - head.chin[2]) | _of_foot(model, mesh)
    points = np.array([*middle.values(), *left.values()], dtype=np.float64)
    on_skin = dict(zip([*middle, *left], SurfaceDistance(mesh).closest(points).points, strict=True))
    return _mirrored(
        {key: on_skin[key] * [0.0, 1.0, 1.0] for key in middle},
        {key: on_skin[key] for key in left} | {"eye": point(head.eye)},
    )


def joints(model: Model) -> Points:
    """Every joint, mm, of the character as it is modelled."""
    arm, foot = model.arm, model.foot
    along, back = hand_axes(model)
    inner, outer = _hand_edges(model, np.cross(back, along))
    left: dict[str, Any] = {"lowerarm": arm.elbow, "wrist": arm.wrist, "finger2_1": inner, "finger5_1": outer}
    left |= {"metacarpal4": point(arm.wrist) + 0.25 * (outer - point(arm.wrist))}
    if arm.fingers is not None:
        base, knuckle, tip = map(point, arm.fingers[1])
        left |= {"finger4_1": base, "finger4_2": knuckle, "finger4_3": 0.5 * (knuckle + tip)}
    left |= {"foot": foot.ankle, "toe1_1": point(foot.ankle) * [1.0, 1.0, 0.4] - 0.5 * foot.reach_mm * _BACK}
    return _mirrored({"neck_root": point(model.neck.root), "head": point(model.head.middle)}, left)


def hand_axes(model: Model) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]:
    """Unit vectors of the left hand: from the wrist to its tip, and out of its back."""
    along = np.subtract(model.arm.tip, model.arm.wrist)
    along = along / np.linalg.norm(along)
    back = point(model.arm.back) - along * (along @ model.arm.back)
    return along, back / np.linalg.norm(back)


def _hand_edges(model: Model, across: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The roots of the first and the last finger, or where they would be in a paw."""
    if model.arm.fingers is not None:
        return point(model.arm.fingers[0][0]), point(model.arm.fingers[1][0])
    palm = 0.5 * np.add(model.arm.wrist, model.arm.tip)
    outward = across * np.sign(across[0])
    return palm - 0.4 * model.arm.girth_mm * outward, palm + 0.4 * model.arm.girth_mm * outward


def _mirrored(middle: Mapping[str, Place], left: Mapping[str, Place]) -> Points:
    """Points of the plane of symmetry, and both of every pair."""
    found = {key: point(place) for key, place in middle.items()}
    for key, place in left.items():
        found[f"{key}_left"] = point(place)
        found[f"{key}_right"] = found[f"{key}_left"] * [-1.0, 1.0, 1.0]
    return found


def _rays_of_head(model: Model) -> Rays:
    inside = point(model.head.middle)

    def at(height: Number) -> np.ndarray:
        return np.array([0.0, inside[1], height])

    return {
        "vertex": (inside, _UP),
        "opisthocranion": (at(model.head.breadth_z), _BACK),
        "glabella": (at(model.head.glabella_z), -_BACK),
        "sellion": (at(model.head.sellion_z), -_BACK),
        "pronasale": (at(model.head.nose_z), -_BACK),
    }


def _rays_of_side(model: Model) -> Rays:
    along, back = hand_axes(model)
    wrist, tip = point(model.arm.wrist), point(model.arm.tip)
    if model.arm.fingers is not None:
        _, knuckle, tip = map(point, model.arm.fingers[1])
        along = (tip - knuckle) / np.linalg.norm(tip - knuckle)
    return {
        "euryon": (np.array([0.0, model.head.middle[1], model.head.breadth_z]), _LEFT),
        "wrist_back": (wrist, back),
        "wrist_palm": (wrist, -back),
        "ring_finger_tip": (tip, along),
        "instep": (point(model.foot.ankle), np.array([0.0, -0.94, -0.34])),
    }


def _of_ears(model: Model, height: Number) -> Points:
    root, ear = point(model.head.temple), model.head.ear
    found = {"ear_root_top": root}
    found |= {key: root + height * np.array(offset) for key, offset in _EAR_ROOT.items()}
    tip, outermost = (root, root) if ear is None else (point(ear.tip), point(ear.outermost))
    return found | {"ear_tip": tip, "ear_outermost": outermost}


def _of_foot(model: Model, mesh: Mesh) -> Points:
    """Ends and sides of the ball, measured as a shoemaker does: seen from above, in shares from heel to toe."""
    points = mesh.vertices[foot_vertices(model, mesh)]
    low = points[points[:, 2] < 0.75 * model.foot.ankle[2]]
    heel, toe = low[low[:, 1].argmax()], low[low[:, 1].argmin()]
    share = (points[:, 1] - heel[1]) / (toe[1] - heel[1])
    ball = points[(share > 0.62) & (share < 0.78) & (points[:, 2] < model.foot.ankle[2])]
    return {
        "heel": heel,
        "toe_tip": toe,
        "ball_medial": ball[ball[:, 0].argmin()],
        "ball_lateral": ball[ball[:, 0].argmax()],
    }


def foot_vertices(model: Model, mesh: Mesh) -> np.ndarray:
    """Indices of the vertices of the left foot, up to its ankle."""
    away = mesh.vertices - point(model.foot.ankle)
    near = (np.hypot(away[:, 0], away[:, 1]) < model.foot.reach_mm) & (away[:, 2] < 0.0)
    near &= (away[:, 1] < model.foot.behind_mm) & (mesh.vertices[:, 0] > model.foot.inner_x)
    return np.flatnonzero(near)


def _met(shape: Shape, rays: Rays) -> Points:
    """Where each ray, from a point inside, leaves `shape`: between samples by interpolation."""
    starts, directions = (np.stack(column) for column in zip(*rays.values(), strict=True))
    reach = np.linspace(0.0, 1.2 * shape.radius, 400)
    points = starts[:, None] + reach[:, None] * directions[:, None]
    found = shape.distance(points.reshape(-1, 3)).reshape(len(rays), -1)
    if (found[:, 0] >= 0.0).any() or (found[:, -1] <= 0.0).any():
        raise ValueError("a ray does not start inside the shape, or does not leave it")
    first, rows = (found > 0.0).argmax(1), np.arange(len(rays))
    before, after = found[rows, first - 1], found[rows, first]
    length = reach[first - 1] + (reach[first] - reach[first - 1]) * before / (before - after)
    return dict(zip(rays, starts + length[:, None] * directions, strict=True))
