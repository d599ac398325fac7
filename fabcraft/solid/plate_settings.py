"""What is done to a finished object before it is printed: a recipe's table `plate`."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields

from fabcraft.errors import InputError
from fabcraft.solid.letters import checked

PLACEHOLDERS = ("size", "side")
_PLACEHOLDER = re.compile(r"\{([^{}]*)\}")


@dataclass(frozen=True)
class PlateSettings:
    """What is done to a finished object before it is printed."""

    orient: bool = False
    """Turn it for the least support, with the skin side kept clean; otherwise it lies as it is worn."""
    hollow: bool = False
    """Take its inside out where it is thick, with drain holes at the low points (resin, powder)."""
    hollow_wall_mm: float = 0.0
    """Wall of a hollow object; 0 is 2 mm, or the printer's if that is more."""
    split: bool = False
    """Cut what is larger than the printer into parts that fit, with pins to join them."""
    label: str = ""
    """Text engraved on a hidden face; {size} and {side} stand for the wearer's size and L or R of a pair."""
    arrange: bool = False
    """Lay parts that are apart side by side on the plate."""

    def __post_init__(self) -> None:
        if self.hollow_wall_mm and not 0.4 <= self.hollow_wall_mm <= 20.0:
            raise InputError(
                f"a wall of {self.hollow_wall_mm:g} mm was asked to hollow with", "Give 0.4 to 20 mm."
            )
        if self.label:
            checked(filled(self.label, dict.fromkeys(PLACEHOLDERS, "1")))

    @property
    def asked(self) -> bool:
        """Whether anything is to be done."""
        return any(getattr(self, entry.name) != entry.default for entry in fields(self))


def filled(text: str, words: Mapping[str, str]) -> str:
    """The text with its placeholders replaced.  Raises `InputError` for one that is not known."""
    unknown = [one for one in _PLACEHOLDER.findall(text) if one not in words]
    if unknown:
        known = " and ".join(f"{{{name}}}" for name in PLACEHOLDERS)
        raise InputError(
            f"the label {text[:60]!r} has {{{unknown[0][:30]}}}, which cannot be filled here",
            f"Known: {known}; the size is that of a measure or parameter that was given, the side that of a pair.",
        )
    return _PLACEHOLDER.sub(lambda found: words[found[1]], text)
