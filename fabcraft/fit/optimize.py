"""`fit`: a template on a body, and a relief, become a `Design`.

The flat stage gives the outline, the lifted stage the shape, the settling the promise of clearance. Millimetres in and
out; inside, one similarity (template's box centre, longest side = 2) for template, body and guidance alike.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float64

from fabcraft.errors import InputError
from fabcraft.fit.descend import Stop
from fabcraft.fit.determinism import same_every_time
from fabcraft.fit.direct import direct
from fabcraft.fit.flat import FlatWeights, fit_flat, rim_targets
from fabcraft.fit.lift import LiftTargets, LiftWeights, fit_lifted
from fabcraft.fit.settle import push_out
from fabcraft.geometry.device import device_of
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.plane import Plane
from fabcraft.geometry.triangulate import PlaneMesh
from fabcraft.guidance.inflate import Relief, solid_mask
from fabcraft.mesh import Mesh
from fabcraft.template.template import Template

CUT_SHORT = (Stop.INTERRUPTED, Stop.NOT_FINITE)

Watch = Callable[[str, int, int, Mesh], None]
"""Called with the stage's name, the step, the number of steps, and the sheet so far."""


@dataclass(frozen=True)
class FitSettings:
    """How the fit runs."""

    deformed: bool = True
    """Deform the template; if not, the sheet is the direct baseline's, for a comparison."""
    flat_steps: int = 200
    """Steps of the flat stage."""
    lifted_steps: int = 150
    """Steps of the lifted stage."""
    pixels: int = 288
    """Longer side of the rendered front view."""
    seed: int = 0
    """Of everything random; the mask's fit draws nothing at random, so its result does not depend on it."""
    device: Literal["cpu", "cuda", "auto"] = "cpu"
    """Where to compute; auto is a CUDA graphics card where there is one."""
    flat: FlatWeights = field(default_factory=FlatWeights)
    lifted: LiftWeights = field(default_factory=LiftWeights)

    def __post_init__(self) -> None:
        if not (0 < self.flat_steps <= 20000 and 0 < self.lifted_steps <= 20000):
            raise InputError(
                f"{self.flat_steps} flat and {self.lifted_steps} lifted steps were asked",
                "Choose 1 to 20000.",
            )
        if not 32 <= self.pixels <= 2048:
            raise InputError(f"a view of {self.pixels} pixels was asked", "Choose 32 to 2048.")


PRESETS = {
    "draft": FitSettings(flat_steps=120, lifted_steps=80, pixels=224),
    "standard": FitSettings(flat_steps=240, lifted_steps=200, pixels=320),
}


@dataclass(frozen=True, eq=False)
class Design:
    """A deformed template: the sheet that print-prep thickens, and how it came about."""

    mesh: Mesh
    """The sheet, mm, faces towards the viewer."""
    direct: Mesh
    """The baseline sheet for the same outline, not deformed from the template."""
    template: Template
    relief: Relief
    history: dict[str, list[float]]
    """Weighted terms of both stages at every step, as `flat.contour`, `lifted.depth`, ..."""
    stages: tuple[tuple[str, Mesh], ...]
    """(label, sheet) along the way, for the evolution strip."""
    stopped: Stop
    pushed_mm: float
    """Largest push of the settling."""
    remeshed: int
    laid_mm: float
    """How far the fitted rims were from the drawn contours before they were laid on them."""
    outline_direct: bool
    """The outline was meshed from the drawn contours, because the fitted one would have folded."""
    settings: FitSettings

    @property
    def interrupted(self) -> bool:
        """Stopped by Ctrl-C; the mesh is the best so far."""
        return self.stopped is Stop.INTERRUPTED

    @property
    def cut_short(self) -> bool:
        """Stopped before its end, by Ctrl-C or because the energy was no number."""
        return self.stopped in CUT_SHORT


@same_every_time()
def fit(
    template: Template,
    relief: Relief,
    settings: FitSettings | None = None,
    distance: SurfaceDistance | None = None,
    watch: Watch | None = None,
) -> Design:
    """Deform the template towards the relief while it keeps fitting the body.

    distance : to the template's body, if the caller already has it.
    Raises `InputError` when the relief leaves no sheet of the wanted topology, and `MissingError` for a CUDA device that
    is not there.
    """
    settings = settings or PRESETS["standard"]
    device = device_of(settings.device)
    distance = distance or SurfaceDistance(template.body.mesh)
    plane = Plane.around(relief.outline, 0.25, 5.0)
    solid = solid_mask(relief.outline, relief.openings, plane)
    rims = rim_targets(solid, plane, len(template.openings), 0.5 * template.wall_mm)
    stages = [("template", template.mesh)]
    if not settings.deformed:
        sheet = direct(rims, relief, template.edge_mm)
        stages.append(("direct", sheet))
        nothing: dict[str, list[float]] = {}
        still = (Stop.STEPS, 0.0, 0, 0.0, True)  # no step, push, remeshing or laying
        return Design(sheet, sheet, template, relief, nothing, tuple(stages), *still, settings)

    def raised(flat: PlaneMesh, height: Callable[[np.ndarray], np.ndarray]) -> Mesh:
        return Mesh(
            np.column_stack([flat.points[:, 0], -height(flat.points), flat.points[:, 1]]),
            flat.faces,
            template.name,
        )

    def flat_watch(flat: PlaneMesh, step: int) -> None:
        sheet = raised(flat, template.front.base_at)
        if step in (settings.flat_steps // 4 // 10 * 10, settings.flat_steps // 2 // 10 * 10):
            stages.append((f"outline {step}", sheet))
        if watch is not None:
            watch("outline", step, settings.flat_steps, sheet)

    start = PlaneMesh(template.mesh.vertices[:, [0, 2]].copy(), template.mesh.faces, template.rims)
    flat = fit_flat(
        start, rims, template.edge_mm, settings.flat_steps, settings.pixels, settings.flat, flat_watch, device
    )
    stages.append(("outline", raised(flat.sheet, template.front.base_at)))
    # a relief that stands off the template as a whole is met half-way: only its shape is left to the Jacobians
    away = float((relief.height_at(flat.sheet.points) - template.front.base_at(flat.sheet.points)).mean())
    sheet = raised(flat.sheet, lambda xz: template.front.base_at(xz) + away)

    def lifted_watch(step: int, values: dict[str, float], now: Mesh) -> None:
        if step == settings.lifted_steps // 4:
            stages.append((f"relief {step}", now))
        if watch is not None:
            watch("relief", step, settings.lifted_steps, now)

    shaped, stopped, lifted = sheet, flat.stopped, {}
    if stopped not in CUT_SHORT:
        targets = LiftTargets(relief, distance, template)
        try:
            shaped, outcome = fit_lifted(
                sheet,
                flat.sheet.loops,
                targets,
                settings.lifted_steps,
                settings.pixels,
                settings.lifted,
                lifted_watch,
                device,
            )
            stopped, lifted = outcome.stopped, outcome.history
        except KeyboardInterrupt:  # while the stage is set up: the fitted outline is the best so far
            stopped = Stop.INTERRUPTED
    settled, pushed_mm = push_out(shaped, distance, sheet_clearance(template, shaped.vertices))
    stages.append(("settled", settled))
    history = {f"flat.{name}": values for name, values in flat.history.items()}
    history |= {f"lifted.{name}": values for name, values in lifted.items()}
    return Design(
        settled,
        direct(rims, relief, template.edge_mm),
        template,
        relief,
        history,
        tuple(stages),
        stopped,
        pushed_mm,
        flat.remeshed,
        flat.laid_mm,
        flat.from_contours,
        settings,
    )


def sheet_clearance(template: Template, points: Float64[np.ndarray, "N 3"]) -> Float64[np.ndarray, " N"]:
    """Distance to the skin, mm, that the sheet (the middle of the wall) has to keep at each point."""
    return template.front.at(template.front.clearance, points[:, [0, 2]]) + 0.5 * template.wall_mm
