"""The kinds of wearable by name: who builds them, what can be set, which standard sizes there are.

A builder is `build(body, settings)`: settings by parameter name, what is left out is the kind's own choice for that body.
It raises `InputError` for a body that lacks the part, with the reason, and for a setting out of its range.
"""

import difflib
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from fabcraft.body.body import Body
from fabcraft.errors import InputError
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

    def settled(self, given: Settings) -> dict[str, float | str]:
        """The settings, checked: known names, numbers within their range; names of sizes are left to the builder.

        Raises `InputError` for a name that the kind has not, and for a number out of range.
        """
        known = {parameter.name: parameter for parameter in self.parameters}
        for name, value in given.items():
            if name not in known:
                close = difflib.get_close_matches(name, known, n=1)
                hint = f"Did you mean {close[0]}?" if close else f"Known: {', '.join(known)}."
                raise InputError(f"a {self.name} has no '{name}'", hint)
            one = known[name]
            if isinstance(value, int | float) and not one.low <= value <= one.high:
                raise InputError(
                    f"{name} = {value:g} was asked of a {self.name}",
                    f"Choose {one.low:g} to {one.high:g} {one.unit}".rstrip() + f": {one.meaning}.",
                )
        return dict(given)
