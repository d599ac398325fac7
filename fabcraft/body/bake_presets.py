"""anny's parameters of the presets, fitted to published measures (extra `fabcraft[bake]`).

man, woman   least squares to the means of ANSUR II (US Army 2012, 4,082 men and 1,986 women; Gordon et al.
             2014, NATICK/TR-15/007; computed from the public files), what a mask needs weighted most;
child        anny's own child of 1.33 m, about nine years; its head is anny's, not fitted to a survey.
"""

from collections.abc import Callable, Mapping

import numpy as np

from fabcraft.body.body import Body
from fabcraft.body.measures import girth_mm, head_measures

TARGETS: Mapping[str, Mapping[str, float]] = {
    "man": {
        "head_circumference": 574, "head_breadth": 154, "head_length": 200, "bizygomatic": 143,
        "menton_sellion": 123, "interpupillary": 64.0, "stature": 1756, "wrist": 176, "foot": 271,
    },
    "woman": {
        "head_circumference": 561, "head_breadth": 148, "head_length": 190, "bizygomatic": 134,
        "menton_sellion": 113, "interpupillary": 61.7, "stature": 1629, "wrist": 155, "foot": 246,
    },
    "child": {"stature": 1330},
}  # fmt: skip
"""mm, of the smoothed head and of the whole body."""

WEIGHTS = {"head_breadth": 0.0, "head_length": 0.0, "stature": 0.2, "wrist": 0.5, "foot": 0.5}
"""Weight of a measure in the least squares; 1 where not named.  anny's heads are longer and narrower than the
survey's: length and breadth cannot be met together with girth and face breadth, so they are only reported."""

PRIOR_MM = 1.5
"""A parameter moved by 1 costs as much as this residual: the fit stays near anny's natural heads."""

START: Mapping[str, Mapping[str, float]] = {
    "man": {"gender": 0.0, "age": 2 / 3, "height": 0.35},
    "woman": {"gender": 1.0, "age": 2 / 3, "height": 0.35},
    "child": {"gender": 0.5, "age": 0.3, "height": 0.5},
}
"""anny's phenotypes to start from; the others are 0.5."""

_ADULT = (
    "height", "head-scale-horiz-incr", "head-scale-depth-incr", "head-scale-vert-incr",
    "head-back-scale-depth-incr", "chin-height-incr",
    "?-cheek-bones-incr", "?-eye-trans-out", "measure-wrist-circ-incr", "?-foot-scale-incr",
)  # fmt: skip
FREE: Mapping[str, tuple[str, ...]] = {"man": _ADULT, "woman": _ADULT, "child": ("age",)}
"""The parameters that are fitted; `?` stands for both sides at once."""


def measured(body: Body) -> dict[str, float]:
    """The measures of `TARGETS`, mm: of the smoothed head; stature, wrist and foot of the whole body."""
    wrist, elbow = body.joints["wrist_left"], body.joints["lowerarm_left"]
    along = (elbow - wrist) / np.linalg.norm(elbow - wrist)
    heights = body.mesh.vertices[:, 2]
    foot = body.mesh.vertices[(heights < heights.min() + 60) & (body.mesh.vertices[:, 0] > 0), :2]
    toward = np.linalg.svd(foot - foot.mean(0), full_matrices=False)[2][0]
    return dict(head_measures(body.part("head"))) | {
        "stature": float(np.ptp(heights)),
        "wrist": min(girth_mm(body.mesh, wrist + along * t, along) for t in range(0, 51, 10)),
        "foot": float(np.ptp(foot @ toward)),
    }


def calibrated(
    body_of: Callable[[Mapping[str, float]], Body], preset: str, steps: int = 8
) -> dict[str, float]:
    """anny's parameters of `preset`: Gauss-Newton, finite differences, weighted measures and prior."""
    free, targets = FREE[preset], TARGETS[preset]
    weights = np.array([WEIGHTS.get(key, 1.0) for key in targets])
    start = np.array([START[preset].get(key, 0.0) for key in free])
    lowest = np.array([0.0 if key in START[preset] else -1.0 for key in free])

    def parameters(x: np.ndarray) -> dict[str, float]:
        return dict(START[preset]) | dict(zip(free, x.tolist(), strict=True))

    def residual(x: np.ndarray) -> np.ndarray:
        values = measured(body_of(parameters(x)))
        misses = weights * np.array([values[key] - goal for key, goal in targets.items()])
        return np.append(misses, PRIOR_MM * (x - start))

    x, h = start, 0.02
    for _ in range(steps):
        at = residual(x)
        jacobian = np.stack([(residual(x + h * e) - at) / h for e in np.eye(len(free))], axis=1)
        x = np.clip(x - np.linalg.lstsq(jacobian, at, rcond=None)[0], lowest, 1.0)
    return parameters(x)
