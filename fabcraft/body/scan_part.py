"""What a scan may show, a head, a hand, a foot or a whole body, as a part of the baked model of people.

Every part is cut from the model, smoothed by the same Loop step as `Body.part`, and stays linear:
x = mean + B c, so that fitting it to a scan yields the person's coefficients.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float64, Int32, Int64
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from fabcraft.body.human import HumanModel
from fabcraft.body.region import Region
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

_SAMPLES = 3000
_NECK_MM, _LEG_MM = 130.0, 110.0
"""How much is fitted below the neck root, and above the ankle joint of an adult."""


@dataclass(frozen=True, eq=False)
class PartModel:
    """One part of the model of people: smoothed skin, joints, landmarks; mm."""

    kind: Kind
    mean: Float64[np.ndarray, "P 3"]
    """Skin vertices, then joints."""
    basis: Float64[np.ndarray, "K P 3"]
    faces: Int32[np.ndarray, "F 3"]
    joint_names: tuple[str, ...]
    landmarks: Mapping[str, int]
    """Row of `mean` of every landmark."""
    regions: Mapping[str, Region]
    """Those that lie wholly on the part."""
    zone: Int64[np.ndarray, " Z"]
    """The vertices by which a fit is judged: face, hand, foot, or everything."""
    samples: Int64[np.ndarray, " S"]
    """Vertices, evenly spread, that stand for the skin."""
    zone_samples: Int64[np.ndarray, " T"]
    """The same for the zone."""

    @property
    def skin(self) -> int:
        """Number of skin vertices."""
        return len(self.mean) - len(self.joint_names)

    def points(self, coefficients: Float64[np.ndarray, " K"]) -> Float64[np.ndarray, "P 3"]:
        """Skin vertices, then joints, of the person with these coefficients."""
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
        back = np.cross(along, across) if side == "_left" else np.cross(across, along)
        return back / np.linalg.norm(back), along


def part_model(model: HumanModel, kind: Kind) -> PartModel:
    """The part `kind` of `model`; cut on the adult between man and woman."""
    joint = {name: index for index, name in enumerate(model.joint_names)}
    count = len(model.mean) - len(joint)
    adult = model.mean + np.tensordot((model.presets["man"] + model.presets["woman"]) / 2, model.basis, 1)
    adult = adult.astype(np.float64)
    at = {name: adult[count + index] for name, index in joint.items()}
    chosen = _connected(model.faces, *_cut(kind, adult[:count], at))
    kept, faces = np.unique(model.faces[chosen], return_inverse=True)
    faces = faces.reshape(-1, 3).astype(np.int32)
    matrix, faces = loop_matrix(faces, len(kept)) if kind != "body" else (np.eye(0), faces)

    def smoothed(rows: np.ndarray) -> np.ndarray:
        return rows if kind == "body" else matrix @ rows

    names = tuple(name for name in joint if kind == "body" or _near(at[name], adult[kept], kind))
    rows = [count + joint[name] for name in names]

    def arranged(points: np.ndarray) -> np.ndarray:
        points = points.astype(np.float64)
        return np.concatenate([smoothed(points[kept]), points[rows]])

    place = {int(old): new for new, old in enumerate(kept)}
    landmarks = {key: place[index] for key, index in model.landmarks.items() if index in place}
    mean = arranged(model.mean)
    skin = len(mean) - len(names)
    landmarks |= {key: skin + names.index(key) for key in ("eye_left", "eye_right") if key in names}
    regions = {
        key: _carried(region, kept, smoothed)
        for key, region in model.regions.items()
        if np.isin(region.vertex_indices, kept).all()
    }
    part = PartModel(
        kind,
        mean,
        np.stack([arranged(component) for component in model.basis]),
        faces,
        names,
        landmarks,
        regions,
        np.arange(skin),
        spread_points(mean[:skin], _SAMPLES),
        np.arange(skin),
    )
    zone = _zone(part, arranged(adult))
    return replace(part, zone=zone, zone_samples=zone[spread_points(mean[zone], _SAMPLES)])


def _carried(region: Region, kept: np.ndarray, smoothed: Callable[[np.ndarray], np.ndarray]) -> Region:
    """The region on the part's own vertices, its emphasis smoothed with them."""
    inside, emphasis = np.zeros(len(kept)), np.zeros(len(kept))
    place = np.searchsorted(kept, region.vertex_indices)
    inside[place], emphasis[place] = 1.0, region.emphasis
    share = smoothed(inside)
    chosen = np.flatnonzero(share > 0.5)
    return region.at(chosen, smoothed(emphasis)[chosen] / share[chosen])


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


def _near(joint: np.ndarray, skin: np.ndarray, kind: Kind) -> bool:
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
