"""What a scan may show, a head, a hand, a foot or a whole body, as a part of the baked model of people.

Every part is cut from the model, smoothed by the same Loop step as `Body.part`, and stays linear:
x = mean + B c, so that fitting it to a scan yields the person's coefficients.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float32, Float64, Int32, Int64
from scipy.sparse import coo_matrix, identity, spmatrix
from scipy.sparse.csgraph import connected_components

from fabcraft.body.model import HumanModel
from fabcraft.body.region import Region
from fabcraft.body.scan_pose import Bone, bones_of, with_hips
from fabcraft.geometry.align import spread_points
from fabcraft.geometry.subdivide import loop_matrix
from fabcraft.mesh import Mesh

Kind = Literal["head", "hand_left", "hand_right", "foot_left", "foot_right", "body"]
KINDS: tuple[Kind, ...] = get_args(Kind)
ASKED: Mapping[str, tuple[Kind, ...]] = {
    "auto": KINDS,
    "head": ("head",),
    "hand": ("hand_left", "hand_right"),
    "foot": ("foot_left", "foot_right"),
    "body": ("body",),
} | {kind: (kind,) for kind in KINDS}
"""What `--body-kind` may say, and which parts it means."""

_SAMPLES, _FEW = 3000, 1000
_LEAST_MM = 0.05
"""Combinations of coefficients that move a part by less (rms) are left out."""
_NECK_MM, _LEG_MM = 130.0, 110.0
"""How much is fitted below the neck root, and above the ankle joint of an adult."""


@dataclass(frozen=True, eq=False)
class PartModel:
    """One part of the model of people: smoothed skin, joints, landmarks; mm."""

    kind: Kind
    mean: Float64[np.ndarray, "P 3"]
    """Skin vertices, then joints."""
    basis: Float64[np.ndarray, "L P 3"]
    """Movements by combinations of the model's coefficients, those that matter here."""
    reduction: Float64[np.ndarray, "L K"]
    """From the model's coefficients to those of `basis`; orthonormal rows."""
    faces: Int32[np.ndarray, "F 3"]
    joint_names: tuple[str, ...]
    bones: tuple[Bone, ...]
    """What turns, from the tips to the trunk."""
    landmarks: Mapping[str, int]
    """Row of `mean` of every landmark."""
    regions: Mapping[str, Region]
    """Those that lie wholly on the part."""
    zone: Int64[np.ndarray, " Z"]
    """The vertices by which a fit is judged: face, hand, foot, or everything."""
    samples: Int64[np.ndarray, " S"]
    """Vertices, evenly spread, that stand for the skin."""
    few: Int64[np.ndarray, " R"]
    """Fewer of them."""
    zone_samples: Int64[np.ndarray, " T"]
    """The same for the zone."""

    @property
    def skin(self) -> int:
        """Number of skin vertices."""
        return len(self.mean) - len(self.joint_names)

    def points(self, coefficients: Float64[np.ndarray, " L"]) -> Float64[np.ndarray, "P 3"]:
        """Skin vertices, then joints, of the person with these coefficients, in the model's pose."""
        return self.mean + np.tensordot(coefficients, self.basis, 1)

    def mesh(self, points: Float64[np.ndarray, "P 3"]) -> Mesh:
        """The skin at `points`."""
        return Mesh(points[: self.skin], self.faces, self.kind)

    def axis(self, points: Float64[np.ndarray, "P 3"]) -> tuple[Float64[np.ndarray, "3"], float]:
        """(unit vector to the end that every scan of this part has, length from there that is looked at, mm)."""
        skin, at = points[: self.skin], dict(zip(self.joint_names, points[self.skin :], strict=True))
        if self.kind.startswith("hand"):
            side = self.kind.removeprefix("hand")
            along = at[f"finger4_1{side}"] - at[f"wrist{side}"]
            along = along / np.linalg.norm(along)
            return along, float((skin @ along).max() - at[f"wrist{side}"] @ along)
        if self.kind.startswith("foot"):
            side = self.kind.removeprefix("foot")
            return np.array([0.0, 0.0, -1.0]), float(at[f"foot{side}"][2] - skin[:, 2].min())
        window = 200.0 if self.kind == "head" else float(np.ptp(skin[:, 2]))
        return np.array([0.0, 0.0, 1.0]), window

    def frame(
        self, points: Float64[np.ndarray, "P 3"]
    ) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]:
        """(up, front), unit vectors: out of the crown or the leg and along the look or the toes; of a hand, out of
        its back and along its fingers."""
        if not self.kind.startswith("hand"):
            return np.array([0.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0])
        side, along = self.kind.removeprefix("hand"), self.axis(points)[0]
        at = dict(zip(self.joint_names, points[self.skin :], strict=True))
        across = at[f"finger2_1{side}"] - at[f"finger5_1{side}"]
        back = np.cross(across, along) if side == "_left" else np.cross(along, across)
        return back / np.linalg.norm(back), along


def adult(model: HumanModel) -> Float32[np.ndarray, " K"]:
    """The coefficients of an adult between man and woman."""
    return (model.presets["man"] + model.presets["woman"]) / 2


@cache
def part_model(model: HumanModel, kind: Kind) -> PartModel:
    """The part `kind` of `model`; cut on the adult between man and woman."""
    points = with_hips(model.points(adult(model)), model.joint_names)
    joints = (*model.joint_names, "hip_left", "hip_right")
    count = len(points) - len(joints)
    at = dict(zip(joints, points[count:], strict=True))
    chosen = _connected(model.faces, *_cut(kind, points[:count], at))
    kept, faces = np.unique(model.faces[chosen], return_inverse=True)
    faces = faces.reshape(-1, 3).astype(np.int32)
    matrix, faces = (identity(len(kept)), faces) if kind == "body" else loop_matrix(faces, len(kept))
    names = tuple(name for name in joints if kind == "body" or _near(at[name], points[kept]))
    rows = count + np.array([joints.index(name) for name in names])

    def arranged(fields: np.ndarray) -> np.ndarray:
        """Fields (model's points, C) on the part's points."""
        return np.concatenate([matrix @ fields[kept], fields[rows]])

    place = {int(old): new for new, old in enumerate(kept)}
    landmarks = {key: place[index] for key, index in model.landmarks.items() if index in place}
    skin = matrix.shape[0]
    landmarks |= {key: skin + names.index(key) for key in ("eye_left", "eye_right") if key in names}
    mean = arranged(with_hips(model.mean.astype(np.float64), model.joint_names))
    reduction, basis = _reduced(with_hips(model.basis, model.joint_names), kept)
    columns = arranged(basis.transpose(1, 0, 2).reshape(len(points), -1))
    every = bones_of(model, points, joints)
    part = PartModel(
        kind,
        mean,
        np.ascontiguousarray(columns.reshape(len(mean), -1, 3).transpose(1, 0, 2)),
        reduction,
        faces,
        names,
        tuple(
            replace(
                bone, joint=skin + names.index(joints[bone.joint - count]), weights=arranged(bone.weights)
            )
            for bone in every.values()
            if _belongs(bone.name, kind)
        ),
        landmarks,
        {
            key: _carried(region, kept, matrix)
            for key, region in model.regions.items()
            if np.isin(region.vertex_indices, kept).all()
        },
        np.arange(skin),
        spread_points(mean[:skin], _SAMPLES),
        spread_points(mean[:skin], _FEW),
        np.arange(skin),
    )
    zone = _zone(part, arranged(points))
    return replace(part, zone=zone, zone_samples=zone[spread_points(mean[zone], _SAMPLES)])


def _reduced(
    basis: Float32[np.ndarray, "K P 3"], kept: np.ndarray
) -> tuple[Float64[np.ndarray, "L K"], Float64[np.ndarray, "L P 3"]]:
    """(orthonormal combinations of the coefficients that move the vertices `kept`, their movements)."""
    flat = basis[:, kept].reshape(len(basis), -1).astype(np.float64)
    values, vectors = np.linalg.eigh(flat @ flat.T / len(kept))
    reduction = vectors[:, ::-1].T[values[::-1] > _LEAST_MM**2]
    moves = reduction @ basis.reshape(len(basis), -1)
    return reduction, moves.reshape(len(reduction), -1, 3)


def _belongs(bone: str, kind: Kind) -> bool:
    """Whether the part turns that bone; a whole body leaves fingers and toes to its hands and feet."""
    name, _, side = kind.partition("_")
    if name == "body":
        return not bone.startswith(("finger", "toes"))
    own = {"head": ("head",), "hand": ("finger", "wrist"), "foot": ("toes", "ankle")}[name]
    return bone.startswith(own) and (not side or bone.endswith(side))


def _carried(region: Region, kept: np.ndarray, matrix: spmatrix) -> Region:
    """The region on the part's own vertices, its emphasis smoothed with them."""
    inside, emphasis = np.zeros(len(kept)), np.zeros(len(kept))
    place = np.searchsorted(kept, region.vertex_indices)
    inside[place], emphasis[place] = 1.0, region.emphasis
    share = matrix @ inside
    chosen = np.flatnonzero(share > 0.5)
    return region.at(chosen, (matrix @ emphasis)[chosen] / share[chosen])


def _cut(kind: Kind, skin: np.ndarray, at: Mapping[str, np.ndarray]) -> tuple[np.ndarray, int]:
    """(which vertices the part may have, one that it has)."""
    if kind == "head":
        return skin[:, 2] > at["neck_root"][2] - _NECK_MM, int(skin[:, 2].argmax())
    if kind == "body":
        return np.ones(len(skin), dtype=bool), 0
    side = "_left" if kind.endswith("left") else "_right"
    mine = skin[:, 0] * (1.0 if side == "_left" else -1.0) > 0
    if kind.startswith("foot"):
        low = mine & (skin[:, 2] < at["foot" + side][2] + _LEG_MM)
        return low, int(np.where(low, skin[:, 2], np.inf).argmin())
    elbow, wrist = at["lowerarm" + side], at["wrist" + side]
    beyond = mine & ((skin - elbow) @ (wrist - elbow) > 0)
    return beyond, int(np.linalg.norm(skin - at["finger4_3" + side], axis=1).argmin())


def _connected(faces: np.ndarray, inside: np.ndarray, seed: int) -> np.ndarray:
    """The faces whose corners are all `inside` and hang together with the vertex `seed`."""
    mine = inside[faces].all(1)
    edges = faces[mine][:, [0, 1, 1, 2]].reshape(-1, 2)
    graph = coo_matrix((np.ones(len(edges)), edges.T), shape=(len(inside),) * 2)
    label = connected_components(graph, directed=False)[1]
    return np.flatnonzero(mine & (label[faces[:, 0]] == label[seed]))


def _near(joint: np.ndarray, skin: np.ndarray) -> bool:
    """Whether a joint lies in the box of the part."""
    low, high = skin.min(0), skin.max(0)
    return bool((joint >= low).all() and (joint <= high).all())


def _zone(part: PartModel, points: np.ndarray) -> np.ndarray:
    """Face: from menton to 30 mm above glabella, before the ears; hand and foot: what `axis` looks at."""
    skin = points[: part.skin]
    if part.kind == "body":
        return np.arange(part.skin)
    if part.kind == "head":
        at = {key: points[index] for key, index in part.landmarks.items()}
        low, high, back = at["menton"][2], at["glabella"][2] + 30.0, at["tragion_left"][1] - 10.0
        return np.flatnonzero((skin[:, 2] > low) & (skin[:, 2] < high) & (skin[:, 1] < back))
    along, length = part.axis(points)
    return np.flatnonzero(skin @ along > (skin @ along).max() - length)
