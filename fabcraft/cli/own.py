"""What can be said of an own template mesh on the command line, wherever a template is named."""

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from cyclopts import Parameter

from fabcraft.cli.wearer import Units

if TYPE_CHECKING:
    from fabcraft.template.own import OwnSettings


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class OwnFlags:
    """Flags of a template that is a mesh file of one's own; what is left out is the recipe file's, or the default."""

    like: str | None = None
    """For a mesh of your own: the template that it is one of (ring, helmet, ...).  It comes off and rests like that, and
    is placed where it comes nearest to it, unless a transform or landmarks place it.  [default: it is none of them]"""
    template_transform: str | None = None
    """For a mesh of your own: its 4 x 4 matrix to the body's space, mm, as transform in a .toml or .json file."""
    template_landmarks: str | None = None
    """For a mesh of your own: file of landmarks of the body, name to a point of the mesh in mm: JSON, TOML or CSV."""
    template_units: Units | None = None
    """For a mesh of your own: unit of its file.  [default: the format's, or mm]"""
    template_scale: bool | None = None
    """For a mesh of your own: landmarks or --like may change its size.  [default: no]"""
    locked: str | None = None
    """For a mesh of your own, what keeps its shape: inside, none, or a .toml or .json file.  [default: inside]"""
    donning: str | None = None
    """For a mesh of your own, the direction in which it comes off: front, back, up, down, left, right, or x,y,z."""
    facing: str | None = None
    """For a mesh of your own, the direction that the place for a motif faces.  [default: away from the skin]"""

    def given(self) -> dict[str, Any]:
        """What was said, by the names of `OwnSettings`."""
        said = {key: value for key, value in asdict(self).items() if value is not None}
        return {key.removeprefix("template_"): value for key, value in said.items()}

    def settings(self) -> "OwnSettings":
        """The same as settings.  Raises `InputError` for what makes no sense."""
        from fabcraft.template.own import OwnSettings

        return OwnSettings(**self.given())


NOTHING = OwnFlags()
"""Nothing is said."""
