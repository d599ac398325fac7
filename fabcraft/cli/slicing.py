"""`--slice` and `--gcode`, wherever a command makes or checks an object."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cyclopts import Parameter

from fabcraft.errors import InputError

if TYPE_CHECKING:
    from fabcraft.check.report import PrintReport
    from fabcraft.mesh import Mesh
    from fabcraft.profile import PrinterProfile


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class SliceFlags:
    """Whether a slicer is asked too."""

    slice: bool = False
    """Also let PrusaSlicer, or the profile's slicer_command, slice it: time, material and supports (takes longer)."""
    gcode: str | None = None
    """With --slice: keep the G-code; PrusaSlicer's is made with general speeds and start code, so look it through."""

    def require(
        self, profile: "PrinterProfile | None", outputs: Iterable[str], inputs: Iterable[str]
    ) -> None:
        """Raise `InputError` for what cannot be done, before the long work.

        outputs, inputs : the paths that the command writes and reads besides.
        """
        if self.gcode is not None and not self.slice:
            raise InputError("--gcode was given without --slice", "Give --slice as well.")
        if not self.slice:
            return
        if profile is None:
            raise InputError("--slice was given, but no printer to slice for", "Give --printer NAME as well.")
        if self.gcode is not None:
            if profile.process != "fdm" and not profile.slicer_command:
                raise InputError(
                    f"--gcode was given, but the {profile.name} is no filament printer",
                    "Leave it out, or name a slicer_command in the profile.",
                )
            from fabcraft.write.places import require_places

            require_places([self.gcode, *outputs], inputs)

    def told(self, report: "PrintReport", mesh: "Mesh", profile: "PrinterProfile") -> "PrintReport":
        """The report, with the slicer's view when it is asked for."""
        if not self.slice:
            return report
        from fabcraft.check.slicer import with_slicing

        return with_slicing(report, mesh, profile, None if self.gcode is None else Path(self.gcode))


UNSLICED = SliceFlags()
"""No slicer is asked."""
