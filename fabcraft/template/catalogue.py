"""The kinds of wearable by name: who builds them, what can be set, which standard sizes there are.

A builder is `build(body, settings)`: settings by parameter name, what is left out is the kind's own choice for that body.
It raises `InputError` for a body that lacks the part, with the reason, and for a setting out of its range.
"""

import difflib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from fabcraft.body.body import Body
from fabcraft.errors import InputError
from fabcraft.template.kinds import with_article
from fabcraft.template.template import Parameter, Template

Settings = Mapping[str, float | str]
"""Parameter name to a number in its unit, or to the name of a standard size ("US 7")."""


@dataclass(frozen=True, eq=False)
class Kind:
    """A kind of wearable."""

    name: str
    build: Callable[[Body, Settings], Template]
    parameters: tuple[Parameter, ...]
    process_note: str = ""
    """What makers should know of printing it, one sentence."""
    play: str = ""
    """The parameter that is the printer's clearance of moving parts where nothing else is asked; "" where nothing moves."""

    def playing(self, given: Settings, moving_mm: float) -> Settings:
        """The settings for a printer that keeps moving parts `moving_mm` apart."""
        if not self.play or self.play in given:
            return given
        one = next(parameter for parameter in self.parameters if parameter.name == self.play)
        return {**given, self.play: min(max(moving_mm, one.low), one.high)}

    def settled(self, given: Settings) -> dict[str, float | str]:
        """The settings, checked: known names, numbers within their range; names of sizes are left to the builder.

        Raises `InputError` for a name that the kind has not, and for a number out of range.
        """
        known = {parameter.name: parameter for parameter in self.parameters}
        for name, value in given.items():
            if name not in known:
                close = difflib.get_close_matches(name, known, n=1)
                hint = f"Did you mean {close[0]}?" if close else f"Known: {', '.join(known)}."
                raise InputError(f"there is no '{name}' to set of {with_article(self.name)}", hint)
            one = known[name]
            if one.choices and not (isinstance(value, int | float) and one.low < one.high):
                if value not in one.choices:
                    raise InputError(
                        f"{name} = {value} was asked of the {self.name}",
                        f"Choose {' or '.join(one.choices)}: {one.meaning}.",
                    )
            elif isinstance(value, int | float):
                self.within(name, value)
            elif name != "size":  # of which the builder knows the names
                raise InputError(
                    f"{name} = {value} was asked of the {self.name}, which is no number",
                    f"Choose {one.low:g} to {one.high:g} {one.unit}".rstrip() + f": {one.meaning}.",
                )
        return dict(given)

    def within(self, name: str, value: float) -> float:
        """`value`, when the parameter may have it.  Also for what the name of a size stands for.

        Raises `InputError` with the range otherwise.
        """
        one = next(parameter for parameter in self.parameters if parameter.name == name)
        if not one.low <= value <= one.high:
            raise InputError(
                f"{name} = {value:g} was asked of the {self.name}",
                f"Choose {one.low:g} to {one.high:g} {one.unit}".rstrip() + f": {one.meaning}.",
            )
        return value

    def worn(
        self, body: Body, part: str, places: Sequence[str]
    ) -> tuple[Body, Mapping[str, Float64[np.ndarray, "3"]]]:
        """The part of `body` that wears this kind, and its joints and landmarks; `places` are needed.

        Where the part has been cut too near to a place, the whole body's is given.
        Raises `InputError` with the reason when the body cannot wear it or lacks one of the places.
        """
        if self.name in body.unwearable:
            raise InputError(
                f"the {body.name} cannot wear {with_article(self.name)}: {body.unwearable[self.name]}",
                "Choose another template or another body (fabcraft bodies).",
            )
        known = {**body.joints, **body.landmarks}
        missing = [place for place in places if place not in known]
        if missing:
            raise InputError(
                f"body {body.name} has no {', '.join(missing)}, so {with_article(self.name)} cannot be placed on it",
                "Choose another body (fabcraft bodies).",
            )
        try:
            found = body.part(part)
        except InputError:
            if body.kind != "scan":
                raise
            found = body  # a scan of that part alone
        return found, {**known, **found.joints, **found.landmarks}
