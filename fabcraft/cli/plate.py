"""What can be asked to be done to an object before it is printed, wherever one is made."""

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

if TYPE_CHECKING:
    from fabcraft.solid.plate_settings import PlateSettings


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class PlateFlags:
    """Flags of the print's preparation; what is left out is the recipe file's, or the default."""

    orient: Annotated[bool | None, Parameter(show_default=False)] = None
    """Turn it for the least support, with the skin side kept clean.  [default: it lies as it is worn]"""
    hollow: Annotated[bool | None, Parameter(show_default=False)] = None
    """Take its inside out where it is thick, with drain holes at the low points (resin, powder).  [default: no]"""
    hollow_wall: float | None = None
    """Hollow it, with a wall of this many mm.  [default: 2, or the printer's if that is more]"""
    split: Annotated[bool | None, Parameter(show_default=False)] = None
    """Cut what is larger than the printer into parts that fit, with pins to join them.  [default: no]"""
    label: str | None = None
    """Text engraved on a hidden face; {size} and {side} stand for the wearer's size, and L or R of a pair."""
    arrange: Annotated[bool | None, Parameter(show_default=False)] = None
    """Lay parts that are apart side by side on the plate.  [default: only where they were turned or cut]"""

    def given(self) -> dict[str, Any]:
        """What was said, by the names of `PlateSettings`."""
        said = {key: value for key, value in asdict(self).items() if value is not None}
        return {"hollow_wall_mm" if key == "hollow_wall" else key: value for key, value in said.items()}

    def settings(self) -> "PlateSettings":
        """The same as settings.  Raises `InputError` for what makes no sense."""
        from fabcraft.solid.plate_settings import PlateSettings

        return PlateSettings(**self.given())


AS_IT_IS = PlateFlags()
"""Nothing is asked."""
