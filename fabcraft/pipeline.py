"""`make`: one recipe through every stage; the only module that names them all.

files, drawing → guidance → fit → solid → check → write. Every stage can also be called alone; see the README.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fabcraft.backends.ask import Consent, answered, refuse
from fabcraft.body.body import Body
from fabcraft.body.contacts import read_contacts, with_contacts
from fabcraft.check.inspect import Inspection, Worn, inspect_mesh
from fabcraft.check.report import Finding, PrintReport
from fabcraft.errors import InputError
from fabcraft.fit.presets import baseline
from fabcraft.guidance.drawing import Drawing
from fabcraft.mesh import Mesh
from fabcraft.plate import on_skin, prepare, size_words
from fabcraft.profile import PrinterProfile, load_profile
from fabcraft.read.image_file import read_image
from fabcraft.read.mesh_file import read_mesh
from fabcraft.recipe import Recipe
from fabcraft.road.guided import shape_guided
from fabcraft.road.motif import shape_motif
from fabcraft.road.shaped import Clock, Given, Shaped, Tell
from fabcraft.road.sheet import shape_sheet
from fabcraft.road.text import text_drawing, text_road
from fabcraft.solid.orient import moved_together
from fabcraft.template.template import Template
from fabcraft.wearer import body_of, require_wearable


@dataclass(frozen=True, eq=False)
class Made:
    """What came out of a recipe."""

    object: Mesh
    """The closed object, mm, where it is worn."""
    on_bed: Mesh
    """The same, as it lies on the printer's bed; places in the report are in this position."""
    pieces: tuple[Mesh, ...]
    """What `on_bed` consists of: one object of the file each."""
    report: PrintReport
    recipe: Recipe
    body: Body
    template: Template
    stages: tuple[tuple[str, Mesh], ...]
    """(label, mesh) from the template to the fitted sheet, mm."""
    profile: PrinterProfile
    drawing: Drawing | None
    """What was understood of the sketch, or chosen for the text."""
    inspection: Inspection
    clearance_mm: np.ndarray
    """(V,) signed distance of the object's vertices to the body."""
    worn: Worn
    """What the object is held to on its body."""
    interrupted: bool
    """The fit was stopped early; the best so far was used."""


def make(recipe: Recipe, tell: Tell | None = None, consent: Consent = refuse) -> Made:
    """Run the recipe, without writing anything.

    consent : asked before a back end that costs, sends something away or runs a recipe's command is called.
    Ctrl-C during the fit keeps the best so far and goes on; see `Made.interrupted`.
    Raises `InputError` for what cannot be read or placed, `SolidError` when no closed manifold comes out.
    """
    _require_one_input(recipe)
    clock, asked = Clock({}, tell), recipe
    route: tuple[str, ...] = ()
    outside = recipe.mesh_wanted or bool(recipe.text_to_image)
    with clock.stage("read"):
        profile = load_profile(recipe.printer)
        contacts = read_contacts(recipe.contacts) if recipe.contacts else ()
        inputs = Given() if outside else _given(recipe)
    with clock.stage("body"):
        body = body_of(recipe)
        require_wearable(body, recipe.own.like or recipe.template)
        body = with_contacts(body, contacts)
    if outside:  # what may cost is asked for when all else is known to be right
        with clock.stage("ask"):
            answers = answered(recipe, consent, tell)
            recipe, route = answers.recipe, answers.route
            inputs = _given(recipe)
    shaped = _road(recipe, inputs)(recipe, inputs, body, profile, clock)
    with clock.stage("check"):
        apart = moved_together(shaped.object) if shaped.template.pair else shaped.object
        named = replace(apart, name=recipe.title or shaped.template.name)
        pair = shaped.template.pair
        skin = on_skin(shaped.object, shaped.worn.body, pair) if recipe.plate.asked else None
        words = size_words(recipe.parameters, recipe.measures)
        placed = prepare(named, profile, recipe.plate, skin, words, pair)
        parts = max(shaped.template.parts * (1 + pair), len(placed.pieces))
        inspection = inspect_mesh(placed.whole, profile, worn=shaped.worn, pieces=placed.pieces, parts=parts)
        clearance = shaped.worn.body.signed(shaped.object.vertices)
    clock.seconds.update({f"check.{name}": value for name, value in inspection.report.seconds.items()})
    found = inspection.report
    report = replace(
        found,
        findings=(*found.findings, *shaped.findings, *placed.findings, *_said(shaped, body)),
        route=(*_person(body), *route, *shaped.route, *placed.route),
        metrics={**found.metrics, **shaped.metrics, **placed.numbers, **_measured(body)},
        seconds=clock.seconds,
    )
    return Made(
        object=shaped.object,
        on_bed=placed.whole,
        pieces=placed.pieces,
        report=report,
        recipe=asked,
        body=body,
        template=shaped.template,
        stages=shaped.stages,
        profile=profile,
        drawing=shaped.drawing,
        inspection=replace(inspection, report=report),
        clearance_mm=clearance,
        worn=shaped.worn,
        interrupted=shaped.interrupted,
    )


def _given(recipe: Recipe) -> Given:
    """The recipe's input, read."""
    if recipe.sketch:
        return Given(picture=read_image(recipe.sketch))
    if recipe.guidance:
        return Given(goal=read_mesh(recipe.guidance, largest_mm=math.inf))
    if text_road(recipe)[0] == "clip":
        return Given()
    drawing, route, notes = text_drawing(recipe)
    return Given(drawing=drawing, route=route, notes=notes)


def _person(body: Body) -> tuple[str, ...]:
    """The asked measures, in a line of the route; nothing when none were asked."""
    told = [
        f"{name.replace('_', ' ')} {f'{one.words}, ' if one.words else ''}{one.asked_mm:.1f} mm asked, "
        f"{one.reached_mm:.1f} reached"
        for name, one in body.measures.items()
    ]
    return (f"{body.name} of the measures given: {'; '.join(told)}",) if told else ()


def _measured(body: Body) -> dict[str, float]:
    """Asked and reached measures for the report, mm."""
    asked = {f"measure_{name}_asked_mm": one.asked_mm for name, one in body.measures.items()}
    return asked | {f"measure_{name}_mm": one.reached_mm for name, one in body.measures.items()}


def _said(shaped: Shaped, body: Body) -> list[Finding]:
    """What the stages before the check had to say."""
    told = [
        Finding(check="input", severity="warn" if warn else "note", advice=text)
        for warn, text in shaped.notes
    ]
    told += [Finding(check="body", severity="note", advice=text) for text in body.notes]
    return told + [Finding(check="solid", severity="note", advice=text + ".") for text in shaped.solid_notes]


def _road(recipe: Recipe, given: Given) -> Callable[[Recipe, Given, Body, PrinterProfile, Clock], Shaped]:
    """From the input to the object: by the drawing, by the motif, or by views from all sides."""
    compared = recipe.method not in ("", "direct")
    through_views = given.drawing is None and not recipe.sketch
    if compared or (through_views and (recipe.text or recipe.template != "mask")):
        return shape_guided
    return shape_sheet if recipe.template == "mask" else shape_motif


def _require_one_input(recipe: Recipe) -> None:
    """Raise `InputError` unless exactly one of sketch, guidance mesh and text is given (a picture has text and sketch)."""
    if recipe.via and not recipe.text:
        raise InputError(
            f"via is {recipe.via}, but there is no text", "Give --text WORDS, or leave --via out."
        )
    given = [name for name in ("sketch", "guidance", "text") if getattr(recipe, name)]
    if recipe.text_to_image and given == ["sketch", "text"]:
        return
    if len(given) != 1:
        both = "both " if len(given) == 2 else ""
        what = both + " and ".join(given) if given else "neither a sketch, a guidance mesh nor a text"
        raise InputError(
            f"{what} was given; one of them was expected",
            "Give --sketch FILE, --guidance MESH or --text WORDS.",
        )
    drawn = given[0] if given[0] == "text" and recipe.via == "subjects" else "sketch"
    wanted = {"": given[0], "direct": drawn}.get(recipe.method) or (
        "text" if baseline(recipe.method).guided == "text" else "guidance"
    )
    if given[0] != wanted:
        raise InputError(
            f"the method {recipe.method} was asked with a {given[0]}", f"Give --{wanted} for that method."
        )
