"""`make`: one recipe through every stage; the only module that names them all.

files, drawing → guidance → fit → solid → check → write. Every stage can also be called alone; see the README.
"""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fabcraft.body.body import Body
from fabcraft.body.character import CHARACTERS, character
from fabcraft.body.contacts import read_contacts, with_contacts
from fabcraft.body.human import PRESETS, human
from fabcraft.check.inspect import Inspection, inspect_mesh
from fabcraft.check.report import Finding, PrintReport
from fabcraft.errors import InputError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.guidance.drawing import Drawing
from fabcraft.guidance.edges import understand
from fabcraft.guidance.inflate import Relief, inflate
from fabcraft.guidance.placement import place
from fabcraft.guidance.target import target_relief
from fabcraft.judge import contact_findings, likeness, seat_findings, worn
from fabcraft.mesh import Mesh
from fabcraft.profile import PrinterProfile, load_profile
from fabcraft.read.image_file import read_image
from fabcraft.read.mesh_file import read_mesh
from fabcraft.recipe import Recipe
from fabcraft.solid.orient import onto_bed
from fabcraft.solid.shell import shell
from fabcraft.solid.slots import strap_slots
from fabcraft.solid.thicken import SolidResult, SolidSettings
from fabcraft.template.mask import mask, natural_wall_mm
from fabcraft.template.template import Template

if TYPE_CHECKING:
    from fabcraft.fit.optimize import Design

Tell = Callable[[str, int, int], None]
"""Progress: called with the name of the stage, the step done and the number of steps."""

CELLS_MM = {"draft": 0.6, "standard": 0.45}
NO_SLOTS = "There is no room for strap slots beside the eyes; glue a band or a stick to the mask."


@dataclass(frozen=True, eq=False)
class Made:
    """What came out of a recipe."""

    object: Mesh
    """The closed object, mm, where it is worn."""
    on_bed: Mesh
    """The same, as it lies on the printer's bed; places in the report are in this position."""
    report: PrintReport
    recipe: Recipe
    body: Body
    template: Template
    design: "Design"
    profile: PrinterProfile
    drawing: Drawing | None
    """What was understood of the sketch."""
    inspection: Inspection
    clearance_mm: np.ndarray
    """(V,) signed distance of the object's vertices to the body."""
    interrupted: bool
    """The fit was stopped early; the best so far was used."""


@dataclass(frozen=True, eq=False)
class _Clock:
    """Seconds of every stage, in order."""

    seconds: dict[str, float]
    tell: Tell | None

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        if self.tell is not None:
            self.tell(name, 0, 1)
        start = time.perf_counter()
        yield
        self.seconds[name] = time.perf_counter() - start
        if self.tell is not None:
            self.tell(name, 1, 1)


def find_body(
    name: str,
    units: str = "",
    measures: Mapping[str, str | float | int] | None = None,
    height_mm: float | int = 0.0,
) -> Body:
    """The body called `name`, of the given measures, or the head scan in that file.

    height_mm : of a character; 0 is its own.
    Raises `InputError` when there is no such body, for measures that it cannot have, and for a height that is not for it.
    """
    path = Path(name)
    if height_mm and name not in CHARACTERS:
        raise InputError(
            f"a height of {height_mm:g} mm was asked for {name}, which is no character",
            "People have it as a measure: --measure height=1700; scans have their own.",
        )
    if name in PRESETS:
        return human(name, measures)
    known = (*PRESETS, *CHARACTERS)
    if name not in CHARACTERS and not (path.suffix or path.exists()):
        close = get_close_matches(name, known, n=1)
        raise InputError(
            f"there is no body called {name!r}" + (f"; did you mean {close[0]}?" if close else ""),
            f"Choose one of: {', '.join(known)}; or give the path of a head scan.",
        )
    if measures:
        kind = "a character, which its height decides" if name in CHARACTERS else "a scan, which has its own"
        raise InputError(
            f"measures were given ({', '.join(measures)}), but {path.name} is {kind}",
            f"Leave them out, or give one of {', '.join(PRESETS)} as the body.",
        )
    if name in CHARACTERS:
        return character(name, height_mm)
    from fabcraft.body.scan import scan

    return scan(path, units or None)


def require_wearable(body: Body, template: str) -> None:
    """Raise `InputError` when `template` does not go on `body`, with the reason."""
    if template in body.unwearable:
        raise InputError(
            f"the {body.name} cannot wear a {template}: {body.unwearable[template]}",
            "Choose another template or another body (fabcraft bodies).",
        )


def make(recipe: Recipe, tell: Tell | None = None) -> Made:
    """Run the recipe, without writing anything.

    Ctrl-C during the fit keeps the best so far and goes on; see `Made.interrupted`.
    Raises `InputError` for what cannot be read or placed, `SolidError` when no closed manifold comes out.
    """
    if bool(recipe.sketch) == bool(recipe.guidance):
        given = (
            "both a sketch and a guidance mesh" if recipe.sketch else "neither a sketch nor a guidance mesh"
        )
        raise InputError(
            f"{given} was given; one of them was expected", "Give --sketch FILE or --guidance MESH."
        )
    clock = _Clock({}, tell)
    with clock.stage("read"):
        profile = load_profile(recipe.printer)
        contacts = read_contacts(recipe.contacts) if recipe.contacts else ()
        picture = read_image(recipe.sketch) if recipe.sketch else None
        goal = read_mesh(Path(recipe.guidance)) if recipe.guidance else None
    with clock.stage("body"):
        body = find_body(recipe.body, recipe.body_units, recipe.measures, recipe.height_mm)
        require_wearable(body, recipe.template)
        body = with_contacts(body, contacts)
        template = mask(body, recipe.wall_mm or max(natural_wall_mm(body), profile.wall_mm))
        distance = SurfaceDistance(template.body.mesh)
    with clock.stage("guidance"):
        drawing, relief, route, notes = _guidance(recipe, picture, goal, template)
    with clock.stage("fit"):
        design = _fit(recipe, template, relief, distance, tell)
    with clock.stage("solid"):
        settings = SolidSettings(wall_mm=template.wall_mm, cell_mm=_cell(recipe.preset, template))
        slots = strap_slots(template, relief) if recipe.strap_slots else ()
        if recipe.strap_slots and not slots:
            notes.append((True, NO_SLOTS))
        solid = shell(design.mesh, template, relief, distance, settings, slots)
    with clock.stage("check"):
        placed = onto_bed(replace(solid.mesh, name=recipe.title or template.name), profile)
        inspection = inspect_mesh(placed.mesh, profile, worn=worn(solid.mesh, template, relief, distance))
        clearance = distance.signed(solid.mesh.vertices)
    clock.seconds.update({f"check.{name}": value for name, value in inspection.report.seconds.items()})
    found = inspection.report
    report = replace(
        found,
        findings=(
            *found.findings,
            *seat_findings(template, relief),
            *contact_findings(solid.mesh, template, relief),
            *_said(notes, body, solid),
            *_stopped(design),
        ),
        route=(*_person(body), *route, *_how(design), f"laid on the bed {placed.words}"),
        metrics={
            **found.metrics,
            **likeness(solid.mesh, design.template, relief, design.direct),
            "clearance_slack_mm": solid.numbers["clearance_slack_mm"],
            **{f"measure_{name}_asked_mm": one.asked_mm for name, one in body.measures.items()},
            **{f"measure_{name}_mm": one.reached_mm for name, one in body.measures.items()},
        },
        seconds=clock.seconds,
    )
    return Made(
        object=solid.mesh,
        on_bed=placed.mesh,
        report=report,
        recipe=recipe,
        body=body,
        template=template,
        design=design,
        profile=profile,
        drawing=drawing,
        inspection=replace(inspection, report=report),
        clearance_mm=clearance,
        interrupted=design.interrupted,
    )


def _person(body: Body) -> tuple[str, ...]:
    """The asked measures, in a line of the route; nothing when none were asked."""
    told = [
        f"{name.replace('_', ' ')} {f'{one.words}, ' if one.words else ''}{one.asked_mm:.1f} mm asked, "
        f"{one.reached_mm:.1f} reached"
        for name, one in body.measures.items()
    ]
    return (f"{body.name} of the measures given: {'; '.join(told)}",) if told else ()


def _said(notes: list[tuple[bool, str]], body: Body, solid: SolidResult) -> list[Finding]:
    """What the stages before the check had to say."""
    told = [Finding(check="input", severity="warn" if warn else "note", advice=text) for warn, text in notes]
    told += [Finding(check="body", severity="note", advice=text) for text in body.notes]
    return told + [Finding(check="solid", severity="note", advice=text + ".") for text in solid.notes]


def _stopped(design: "Design") -> list[Finding]:
    """A warning when the fit did not come to its end."""
    if not design.cut_short:
        return []
    return [Finding(check="fit", severity="warn", advice=f"The fit stopped early: {design.stopped.value}.")]


def _how(design: "Design") -> tuple[str, str]:
    """The fit, in a line of the route."""
    return (
        f"fitted: {design.stopped.value}, {design.remeshed} times remeshed, pushed {design.pushed_mm:.2f} mm",
        "outline "
        + (
            "meshed from the drawing, as the direct baseline: the fitted one would have folded"
            if design.outline_direct
            else "from the fitted template"
        ),
    )


def _cell(preset: str, template: Template) -> float:
    """Cell of the grid that the wall is made on; on a character it goes with the size of its head."""
    return min(CELLS_MM[preset] * max(template.scale, 0.5), 0.5 * template.wall_mm)


def _guidance(
    recipe: Recipe, picture: np.ndarray | None, goal: Mesh | None, template: Template
) -> tuple[Drawing | None, Relief, tuple[str, ...], list[tuple[bool, str]]]:
    """(drawing, relief, route, notes); a note is (whether it is a warning, sentence)."""
    if goal is not None:
        relief, said = target_relief(goal, template, recipe.placement)
        return (
            None,
            relief,
            (f"guidance mesh {Path(recipe.guidance).name}",),
            [(False, text) for text in said],
        )
    assert picture is not None
    drawing = understand(picture)
    placed = place(drawing, template, recipe.placement)
    relief = inflate(placed, template, recipe.inflate)
    width, height = np.ptp(placed.outline, axis=0)
    route = (
        f"sketch {Path(recipe.sketch).name}: outline, {len(drawing.eyes)} eyes, {len(drawing.regions)} regions, "
        f"{len(drawing.strokes)} strokes",
        f"placed by the {'drawn eyes' if placed.by_eyes else 'drawn outline'}: {width:.0f} x {height:.0f} mm",
        "inflated to a relief",
    )
    notes = [(True, text) for text in drawing.warnings]
    notes += [(False, f"Left out of the drawing: {text}.") for text in drawing.dropped]
    return drawing, relief, route, notes + [(False, text) for text in placed.notes]


def _fit(
    recipe: Recipe, template: Template, relief: Relief, distance: SurfaceDistance, tell: Tell | None
) -> "Design":
    from fabcraft.fit.optimize import PRESETS as FIT_PRESETS
    from fabcraft.fit.optimize import fit

    settings = replace(FIT_PRESETS[recipe.preset], seed=recipe.seed)

    def watch(stage: str, step: int, steps: int, sheet: Mesh) -> None:
        if tell is not None:
            tell(f"fit: {stage}", step, steps)

    return fit(template, relief, settings, distance, watch)
