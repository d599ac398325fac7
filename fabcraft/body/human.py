"""`human(name)`: a ready person from the baked body model, as the preset is or of given measures.

man and woman have the means of ANSUR II; teenager (14 years) and child (9 years) the stature of the CDC growth charts;
toddler (2 years) the height and the head circumference of the WHO standards.  `bake_presets` tells what else of each is
from a survey, and what a convention.
"""

from collections.abc import Mapping
from dataclasses import replace
from difflib import get_close_matches
from typing import Literal

import numpy as np
from jaxtyping import Float64

from fabcraft.body.body import Body, Measured
from fabcraft.body.fitting import Fit, Fitter
from fabcraft.body.model import HumanModel, human_model
from fabcraft.body.sizes import FOLDED_HAND, Asked, asked
from fabcraft.errors import InputError

PRESETS = ("man", "woman", "teenager", "child", "toddler")
Hand = Literal["flat", "relaxed"]


def human(name: str, measures: Mapping[str, str | float | int] | None = None, hand: Hand = "flat") -> Body:
    """The person called `name`, with the given measures.

    name : one of `PRESETS`.  measures : `measures.MEASURES` to mm or to a size of `sizes`, such as {"wrist": 158,
    "ring_finger": "US7"}; the rest of the person stays as near to the preset as they allow.  hand : flat with the
    fingers apart, as it is measured, or relaxed with bent fingers.

    Raises `InputError` for another name, an unknown measure or size, and for measures that no believable person like
    the preset has, with the range that could be had.
    """
    if name not in PRESETS:
        close = get_close_matches(name, PRESETS, n=1)
        raise InputError(
            f"there is no body called {name!r}" + (f"; did you mean {close[0]}?" if close else ""),
            f"Choose one of: {', '.join(PRESETS)}; or give the path of a head scan.",
        )
    model, wanted = human_model(), asked(measures or {})
    coefficients, reached = _fitted(
        model, name, [one for one in wanted if not one.name.startswith(FOLDED_HAND)]
    )
    points = model.points(coefficients.astype(np.float32))
    person = model.body_at(model.relaxed(points) if hand == "relaxed" else points, name)
    found = {one.name: Measured(one.mm, reached.get(one.name, one.mm), one.words) for one in wanted}
    return replace(person, measures=found)


def _fitted(
    model: HumanModel, name: str, wanted: list[Asked]
) -> tuple[Float64[np.ndarray, " K"], Mapping[str, float]]:
    """(the coefficients of the preset, or of the person like it with the asked measures; those as reached)."""
    if not wanted:
        return model.presets[name].astype(np.float64), {}
    fitter = Fitter(model, model.presets[name].astype(np.float64))
    fit = fitter.fit({one.name: one.mm for one in wanted})
    if not fit.believable:
        _refuse(fitter, name, wanted)
    return fit.coefficients, fit.reached_mm


def _refuse(fitter: Fitter, name: str, wanted: list[Asked]) -> None:
    """Raise `InputError` for the measure that is farthest out of its reach, with that."""
    targets = {one.name: one.mm for one in wanted}
    alone: dict[str, Fit] = {one.name: fitter.fit({one.name: one.mm}) for one in wanted}
    by_rarity = sorted(wanted, key=lambda one: -alone[one.name].rarity)
    for with_others in (True, False):
        for one in by_rarity:
            low, high = fitter.reach(targets if with_others else {one.name: one.mm}, one.name)
            if np.isfinite(low) and not low <= one.mm <= high:
                said = f"{one.words}, {one.mm:.1f} mm," if one.words else f"{one.mm:g} mm"
                others = " with the other measures as asked" if with_others and len(wanted) > 1 else ""
                raise InputError(
                    f"{one.name} {said} is out of reach for {name}{others}: it can be {low:.1f} to {high:.1f} mm",
                    "Check the tape, ask for less, or begin from another body: " + ", ".join(PRESETS) + ".",
                )
    raise InputError(
        f"no {name} has these measures together: " + ", ".join(f"{one.name} {one.mm:g}" for one in wanted),
        "Check the tape, leave one out, or begin from another body: " + ", ".join(PRESETS) + ".",
    )
