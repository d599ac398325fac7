"""The presets: whom each of them stands for, and the published measures it is fitted to (extra `fabcraft[bake]`).

man, woman   means of ANSUR II (US Army 2012, 4,082 men and 1,986 women; Gordon et al. 2014, NATICK/TR-15/007; computed
             from the public files).  Ring fingers are in no survey that we know: ring size ISO 62 and 54, what jewellers
             call the middle sizes, and a joint 1 mm larger, are conventions.
teenager     14 years, both sexes alike.  Stature: CDC growth charts 2000, mean of the medians of boys and girls at 168.5
             months (1,641 and 1,605 mm).
child        9 years.  Stature: CDC 2000 at 108.5 months (1,337 and 1,331 mm).
toddler      2 years.  Height and head circumference: WHO Child Growth Standards 2006 at 24 months, mean of the medians
             of boys and girls (871 and 857 mm; 483 and 472 mm).

Conventions, put between WHO's five-year-olds and ANSUR's adults where that applies: head circumference of teenager and
child, breadth of face and distance of pupils of all three.  Everything else about them is anny's, from no survey.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from fabcraft.body.fitting import Fitter
from fabcraft.body.model import HumanModel

START: Mapping[str, Mapping[str, float]] = {
    "man": {"gender": 0.0, "age": 2 / 3, "height": 0.35},
    "woman": {"gender": 1.0, "age": 2 / 3, "height": 0.35},
    "teenager": {"gender": 0.5, "age": 0.47, "height": 0.5},
    "child": {"gender": 0.5, "age": 0.3, "height": 0.5},
    "toddler": {"gender": 0.5, "age": 0.09, "height": 0.5},
}
"""anny's phenotypes to start from; the others are 0.5."""

TARGETS: Mapping[str, Mapping[str, float]] = {
    "man": {
        "height": 1756, "head": 574, "head_breadth": 154, "face_breadth": 143, "face_length": 123, "pupils": 64.0,
        "neck": 398, "wrist": 176, "hand": 212, "hand_length": 193, "ring_finger": 62, "ring_knuckle": 63,
        "foot": 271, "foot_width": 102, "foot_girth": 252,
    },
    "woman": {
        "height": 1629, "head": 561, "head_breadth": 148, "face_breadth": 134, "face_length": 113, "pupils": 61.7,
        "neck": 330, "wrist": 155, "hand": 187, "hand_length": 181, "ring_finger": 54, "ring_knuckle": 55,
        "foot": 246, "foot_width": 93, "foot_girth": 228,
    },
    "teenager": {"height": 1623, "head": 550, "face_breadth": 132, "pupils": 59},
    "child": {"height": 1334, "head": 525, "face_breadth": 124, "pupils": 54},
    "toddler": {"height": 864, "head": 477, "face_breadth": 112, "pupils": 47},
}  # fmt: skip


_BUILD = 0.04
"""Spread of the common coefficients: a preset keeps its sex and build, and is fitted by local changes."""


def preset_coefficients(
    model: HumanModel, name: str, points: Float64[np.ndarray, "P 3"]
) -> Float64[np.ndarray, " K"]:
    """The coefficients of a preset; points : anny's body at `START`, the nearest of which is fitted to `TARGETS`."""
    symmetric = len(model.basis) - model.differences
    basis = model.basis[:symmetric].reshape(symmetric, -1).astype(np.float64)
    gram = basis @ basis.T + 1e-3 * len(points) * np.eye(symmetric)
    nearest = np.zeros(len(model.basis))
    nearest[:symmetric] = np.linalg.solve(gram, basis @ (points - model.mean).ravel())
    fit = Fitter(replace(model, alike=_BUILD), nearest).fit(TARGETS[name])
    print(f"{name}: {fit.rarity:.1f} sd from anny's own, within {fit.miss_mm:.2f} mm")  # noqa: T201
    return fit.coefficients
