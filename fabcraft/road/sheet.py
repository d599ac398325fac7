"""The road of a sheet template, the mask: the drawing becomes a relief before the face, the sheet is fitted to it."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from fabcraft.body.body import Body
from fabcraft.check.report import Finding
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.guidance.alignment import placed_by
from fabcraft.guidance.drawing import Drawing
from fabcraft.guidance.inflate import Relief, inflate
from fabcraft.guidance.photograph import read_as
from fabcraft.guidance.placement import place
from fabcraft.guidance.target import target_relief
from fabcraft.judge import contact_findings, likeness, seat_findings, worn
from fabcraft.mesh import Mesh
from fabcraft.profile import PrinterProfile
from fabcraft.recipe import Recipe
from fabcraft.road.shaped import CELLS_MM, Clock, Given, Note, Shaped, Tell
from fabcraft.solid.shell import shell
from fabcraft.solid.slots import strap_slots
from fabcraft.solid.thicken import SolidSettings
from fabcraft.template.kinds import kind_of
from fabcraft.template.mask import mask, natural_wall_mm
from fabcraft.template.template import Template

if TYPE_CHECKING:
    from fabcraft.fit.optimize import Design

NO_SLOTS = "There is no room for strap slots beside the eyes; glue a band or a stick to the mask."


def asked_wall_mm(recipe: Recipe) -> float:
    """The wall of a mask as the recipe asks for it, as a parameter (`--set wall=3`) or as its wall; 0 where it does not."""
    return float(kind_of("mask").settled(recipe.parameters).get("wall", recipe.wall_mm))


def shape_sheet(recipe: Recipe, given: Given, body: Body, profile: PrinterProfile, clock: Clock) -> Shaped:
    """The mask of a recipe.

    Ctrl-C during the fit keeps the best so far.  Raises `InputError` for what cannot be placed, `SolidError` when no
    closed manifold comes out.
    """
    with clock.stage("template"):
        template = mask(body, asked_wall_mm(recipe) or max(natural_wall_mm(body), profile.wall_mm))
        distance = SurfaceDistance(template.body.mesh)
    with clock.stage("guidance"):
        drawing, relief, route, notes = _guidance(recipe, given, template)
    with clock.stage("fit"):
        design = fitted(recipe, template, relief, distance, clock.tell)
    with clock.stage("solid"):
        # on a character the cells of the grid go with the size of its head
        cell_mm = min(CELLS_MM[recipe.preset] * max(template.scale, 0.5), 0.5 * template.wall_mm)
        slots = strap_slots(template, relief) if recipe.strap_slots else ()
        if recipe.strap_slots and not slots:
            notes.append((True, NO_SLOTS))
        settings = SolidSettings(wall_mm=template.wall_mm, cell_mm=cell_mm)
        solid = shell(design.mesh, template, relief, distance, settings, slots)
    return Shaped(
        template=template,
        object=solid.mesh,
        worn=worn(solid.mesh, template, relief, distance),
        drawing=drawing,
        stages=design.stages,
        route=(*route, *how(design)),
        notes=tuple(notes),
        solid_notes=solid.notes,
        findings=(
            *seat_findings(template, relief),
            *contact_findings(solid.mesh, template, relief),
            *stopped(design),
        ),
        metrics={
            **likeness(solid.mesh, design.template, relief, design.mesh, design.direct),
            "clearance_slack_mm": solid.numbers["clearance_slack_mm"],
        },
        interrupted=design.interrupted,
    )


def fitted(
    recipe: Recipe, template: Template, relief: Relief, distance: SurfaceDistance, tell: Tell | None
) -> "Design":
    """The sheet of `template`, fitted to the relief at the recipe's preset."""
    from fabcraft.fit.optimize import PRESETS as FIT_PRESETS
    from fabcraft.fit.optimize import fit

    deformed = recipe.method != "direct"
    settings = replace(FIT_PRESETS[recipe.preset], seed=recipe.seed, deformed=deformed)
    if recipe.device:
        settings = replace(settings, device=recipe.device)

    def watch(stage: str, step: int, steps: int, sheet: Mesh) -> None:
        if tell is not None:
            tell(f"fit: {stage}", step, steps)

    return fit(template, relief, settings, distance, watch)


def stopped(design: "Design") -> list[Finding]:
    """A warning when the fit did not come to its end."""
    if not design.cut_short:
        return []
    return [Finding(check="fit", severity="warn", advice=f"The fit stopped early: {design.stopped.value}.")]


def how(design: "Design", unit: str = "mm", units_per_mm: float = 1.0) -> tuple[str, str]:
    """The fit, in two lines of the route."""
    if not design.settings.deformed:
        return "not fitted", "outline and height taken as drawn: the direct baseline"
    if design.outline_direct:
        outline = "meshed from the drawing, as the direct baseline: the fitted one would have folded"
    else:
        laid = design.laid_mm / units_per_mm
        outline = f"from the fitted template, laid on the drawn one ({laid:.1f} {unit} at most)"
    pushed = design.pushed_mm / units_per_mm
    return (
        f"fitted: {design.stopped.value}, {design.remeshed} times remeshed, pushed {pushed:.2f} {unit}",
        f"outline {outline}",
    )


def _guidance(
    recipe: Recipe, given: Given, template: Template
) -> tuple[Drawing | None, Relief, tuple[str, ...], list[Note]]:
    """(drawing, relief, route, notes)."""
    if given.goal is not None:
        made = target_relief(
            given.goal, template, recipe.placement, placed_by(recipe.guidance_transform), recipe.force
        )
        said = [(False, text) for text in made.notes]
        return None, made.relief, (f"guidance mesh {Path(recipe.guidance).name}",), said
    drawing, line, notes = drawn(recipe, given)
    placed = place(drawing, template, recipe.placement)
    relief = inflate(placed, template, recipe.inflate)
    width, height = (placed.outline.max(0) - placed.outline.min(0)).tolist()
    route = (
        *line,
        f"placed by the {'drawn eyes' if placed.by_eyes else 'drawn outline'}: {width:.0f} x {height:.0f} mm",
        "inflated to a relief",
    )
    return drawing, relief, route, notes + [(False, text) for text in placed.notes]


def drawn(recipe: Recipe, given: Given) -> tuple[Drawing, tuple[str, ...], list[Note]]:
    """(drawing, lines of the route, notes) of the recipe's sketch, picture or text."""
    if given.drawing is not None:
        drawing, route = given.drawing, given.route
    else:
        assert given.picture is not None
        drawing = read_as(given.picture, recipe.foreground)
        kind = "photograph" if recipe.foreground else "sketch"
        route = (f"{kind} {Path(recipe.sketch).name}",)
    counts = (
        f"outline, {len(drawing.eyes)} eyes, {len(drawing.regions)} regions, {len(drawing.strokes)} strokes"
        f"{', ' if drawing.told_apart else ''}{drawing.told_apart}"
    )
    notes: list[Note] = [(True, text) for text in drawing.warnings]
    notes += [(False, f"Left out of the drawing: {text}.") for text in drawing.dropped]
    return drawing, (*route[:-1], f"{route[-1]}: {counts}"), notes + [(False, text) for text in given.notes]
