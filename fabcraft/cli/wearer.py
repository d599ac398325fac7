"""What can be said of a body on the command line, wherever one is named."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

if TYPE_CHECKING:
    from fabcraft.body.body import Body

Units = Literal["mm", "cm", "m", "in"]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Wearer:
    """Flags of the body; what is left out is its own, or found."""

    measure: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = ()
    """What a person measures, again for more: wrist=158 in mm, or a size: ring_finger=US7 (ISO, US, CH, IT, ES),
    foot=EU42 (or MP265), head=hat58 (or US7.25, UK7.125), hand_folded=IN2-6. Hands and feet have a left and a
    right side: wrist_left=160."""
    height: float | None = None
    """Height of a character, mm; its own when left out."""
    body_units: Units | None = None
    """Unit of a scan; proposed from its size when left out."""
    body_kind: str | None = None
    """What a scan shows: head, hand, foot or body; found when left out."""
    body_up: str | None = None
    """Axis of the scan's file that points up: x, y, z, -x, -y or -z; found when left out."""
    body_front: str | None = None
    """Axis of the scan's file that the face, toes or fingers point along; found when left out."""
    body_landmarks: str | None = None
    """File of landmarks of the scan, name to point in the file's units (.toml, .json)."""

    def found(self, body: str) -> "Body":
        """The body called `body`.  Raises `InputError` when there is none, and for what does not belong to it."""
        from fabcraft.body.sizes import parse
        from fabcraft.wearer import find_body

        return find_body(
            body,
            self.body_units or "",
            self.height or 0.0,
            parse(self.measure),
            kind=self.body_kind or "",
            up=self.body_up or "",
            front=self.body_front or "",
            landmarks=self.body_landmarks or "",
        )


ANYBODY = Wearer()
"""Nothing is said."""
