"""Head, hands and feet of a whole body, each found again by its own fit where the body's fit has them.

A hand is small in a whole body, and its fingers may be anywhere: where it does not come to lie well from there, it is
looked for from all sides near there.
"""

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from fabcraft.body.model import HumanModel
from fabcraft.body.scan_fit import PartFit, fitted, settled
from fabcraft.body.scan_part import Kind, PartModel, part_model
from fabcraft.body.scan_search import Cloud, Looked, even_rotations, placements
from fabcraft.body.scan_step import State, Surface
from fabcraft.geometry.align import Similarity, fit_similarity

_PARTS: tuple[Kind, ...] = ("head", "hand_left", "hand_right", "foot_left", "foot_right")
_NEAR = 0.2
"""Share of a part's size around it where the scan is looked at."""
_LOOK = 0.05
"""How far a part looks for the scan at first, as a share of its size: it begins near."""
_WELL, _ENOUGH = 0.96, 0.7
"""Share of a part on the scan at which no other start is tried, and without which it was not found."""
_TILT_DEG = 60.0
"""How far a limb may be turned from where the body's fit has it."""


def parts_of(model: HumanModel, whole: PartFit, surface: Surface) -> list[PartFit]:
    """The parts of a whole body that were found again."""
    tree = cKDTree(surface.cloud.points)
    found = []
    for kind in _PARTS:
        part = part_model(model, kind)
        begun, size = _begun(part, whole), _size(part, whole)
        around = tree.query_ball_point(begun.points(part)[: part.skin : 7], _NEAR * size)
        near = np.unique(np.concatenate(around)).astype(np.int64)
        if not len(near):
            continue
        cloud = Cloud(surface.cloud.points[near], surface.cloud.normals[near])
        local = Surface.of(cloud, surface.rim[near], size)
        best: PartFit | None = None
        for start in _starts(part, begun, cloud):
            fit = fitted(part, local, start, 12, look=_LOOK)
            if best is None or fit.misfit < best.misfit:
                best = fit
            if best.matched > _WELL:
                break
        if best is not None and best.matched > _ENOUGH:
            found.append(settled(best, local))
    return found


def _begun(part: PartModel, whole: PartFit) -> State:
    """The part as the body's fit has it: its person and pose, where the settled skin has its places."""
    turns = {bone.name: turn for bone, turn in zip(whole.part.bones, whole.state.turns, strict=True)}
    state = State(
        part.reduction @ (whole.part.reduction.T @ whole.state.coefficients),
        np.stack([turns.get(bone.name, np.eye(3)) for bone in part.bones]),
        Similarity(),
    )
    there, here = _named(part, state.points(part)), _named(whole.part, whole.points)
    names = [name for name in there if name in here]
    place = fit_similarity(
        np.stack([there[name] for name in names]), np.stack([here[name] for name in names]), (0.9, 1.1)
    )
    return State(state.coefficients, state.turns, place)


def _size(part: PartModel, whole: PartFit) -> float:
    """The largest side of the part's zone for the person of the body's fit, mm."""
    points = part.points(part.reduction @ (whole.part.reduction.T @ whole.state.coefficients))
    return float(np.ptp(points[part.zone], axis=0).max()) * whole.state.place.scale


def _starts(part: PartModel, begun: State, cloud: Cloud) -> Iterator[State]:
    """Where the part may be: as the body has it, then the best places around."""
    yield begun
    at = State(begun.coefficients, begun.turns, Similarity(scale=begun.place.scale)).points(part)
    mesh = part.mesh(at)
    axis, length = part.axis(at)
    looked = Looked(Cloud(mesh.vertices, mesh.vertex_normals), axis, length)
    rotations = even_rotations()
    turned = np.einsum("nij,ij->n", rotations, begun.place.rotation)
    rotations = rotations[turned > 1.0 + 2.0 * np.cos(np.radians(_TILT_DEG))]
    for _, place in placements(looked, cloud, rotations)[:3]:
        yield State(
            begun.coefficients,
            begun.turns,
            Similarity(place.scale * begun.place.scale, place.rotation, place.translation),
        )


def _named(part: PartModel, points: np.ndarray) -> dict[str, np.ndarray]:
    """Landmarks and joints by name."""
    named = {name: points[row] for name, row in part.landmarks.items()}
    return named | dict(zip(part.joint_names, points[part.skin :], strict=True))
