"""The road of a guidance mesh or a text: a closed solid is deformed as a whole, seen from all sides (the paper's road)."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fabcraft.body.body import Body
from fabcraft.check.report import Finding
from fabcraft.fit import presets
from fabcraft.fit.presets import Baseline, DeformSettings, baseline, for_text
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.guidance.alignment import Aligned, aligned, laid_on, placed_by
from fabcraft.guidance.clean import cleaned
from fabcraft.judge import worn_solid
from fabcraft.mesh import Mesh, concatenate
from fabcraft.profile import PrinterProfile
from fabcraft.recipe import Recipe
from fabcraft.road.base import as_solid, asked, built
from fabcraft.road.shaped import Clock, Given, Shaped, finished, mirrored
from fabcraft.road.sheet import asked_wall_mm
from fabcraft.solid.thicken import SolidSettings, solidify
from fabcraft.template.mask import mask
from fabcraft.template.template import Template

if TYPE_CHECKING:
    from fabcraft.fit.body_terms import ContactSet
    from fabcraft.fit.deform import Deformed
    from fabcraft.fit.views import Guide

SHEET_WALL_MM = 4.0
"""Wall of a sheet that is deformed as a closed solid: a thinner one needs twice as many triangles to bend well."""


def shape_guided(recipe: Recipe, given: Given, body: Body, profile: PrinterProfile, clock: Clock) -> Shaped:
    """The recipe's template, deformed towards its guidance mesh or its text while it keeps fitting the body.

    Ctrl-C during the fit keeps the best so far.  Raises `InputError` for a mesh that resembles the template too little,
    `MissingError` where the text's encoder has no weights here, `SolidError` when no closed manifold comes out.
    """
    from fabcraft.fit.deform import deform

    with clock.stage("template"):
        template, rest = rest_of(replace(recipe, parameters=dict(asked(recipe, profile))), body)
        distance = SurfaceDistance(template.body.mesh)
    with clock.stage("guidance"):
        row = _method(recipe, template)
        settings = row.settings
        locked = template.locked if row.locked and template.kind == "solid" else None
        guidance: list["Guide"] = []
        route: tuple[str, ...]
        said: tuple[str, ...] = ()
        if row.base == "guidance":
            assert given.goal is not None
            goal, said = goal_on(given.goal, rest, recipe, template.pair)
            rest, locked, route = goal.mesh, None, (f"the guidance mesh itself, {goal.words}",)
        elif row.guided == "nothing":
            route = ("the template itself",)
        else:
            guidance, route, said = _guidance(recipe, given, template, rest, distance, settings)
    with clock.stage("fit"):
        stages = [("template", rest)]
        shown = [settings.steps * quarter // 4 for quarter in (1, 2, 3)] if settings.steps >= 8 else []

        def watch(step: int, values: dict[str, float], mesh: Mesh) -> None:
            if step in shown:
                stages.append((f"step {step}", mesh))
            if clock.tell is not None:
                clock.tell("fit: views", step, settings.steps)

        made = deform(
            rest,
            body=distance if row.body else None,
            contacts=contacts_of(template) if row.body else None,
            guidance=guidance,
            settings=settings,
            locked=locked,
            watch=watch,
        )
        stages.append(("fitted", made.mesh))
    with clock.stage("solid"):
        notes: tuple[str, ...] = ()
        if recipe.method in ("", "ours"):
            least_mm = max(profile.min_wall_mm, profile.min_wall_supported_mm)
            solid = solidify(made.mesh, SolidSettings(wall_mm=least_mm, clearance_mm=0.0), distance)
            notes = solid.notes
            one, object_ = finished(solid.mesh, template, recipe)
        else:  # what is compared is measured as its loop leaves it
            one = made.mesh
            object_ = concatenate([one, mirrored(one)], one.name) if template.pair else one
    return Shaped(
        template=template,
        object=object_,
        worn=worn_solid(one, template, distance),
        drawing=None,
        stages=tuple(stages),
        route=(*route, _how(made)),
        notes=tuple((False, text) for text in (*said, *template.notes)),
        solid_notes=notes,
        findings=tuple(_stopped(made)),
        interrupted=made.stopped.name == "INTERRUPTED",
    )


def rest_of(recipe: Recipe, body: Body) -> tuple[Template, Mesh]:
    """The template, and the closed solid that is deformed."""
    if recipe.template == "mask":
        template = mask(body, asked_wall_mm(recipe) or SHEET_WALL_MM)
    else:
        template = built(recipe.template, body, recipe.parameters, recipe.own, even=True)
    return template, as_solid(template)


def _method(recipe: Recipe, template: Template) -> Baseline:
    """What is deformed towards what, and how: by the recipe's method, preset and number of steps."""
    chosen = presets.PRESETS[recipe.preset]
    row = baseline(recipe.method or "ours", for_text(chosen) if recipe.text and not recipe.method else chosen)
    least = template.listed_mm[0] if template.kind == "solid" else template.resting_mm
    settings = replace(row.settings, seed=recipe.seed, clearance_mm=max(least, 0.0))
    if recipe.device:
        settings = replace(settings, device=recipe.device)
    if recipe.steps and settings.steps:
        settings = replace(settings, steps=recipe.steps)
    return replace(row, settings=settings)


def _guidance(
    recipe: Recipe,
    given: Given,
    template: Template,
    rest: Mesh,
    distance: SurfaceDistance,
    settings: DeformSettings,
) -> tuple[list["Guide"], tuple[str, ...], tuple[str, ...]]:
    """(the objectives, what they are, in lines of the route, notes)."""
    import torch

    from fabcraft.fit.render import Topology
    from fabcraft.fit.views import ViewBank
    from fabcraft.geometry.device import device_of
    from fabcraft.geometry.frame import Frame

    if recipe.text:
        from fabcraft.guidance.clip import DEFAULT, load_clip
        from fabcraft.guidance.text import TextGuidance

        model = load_clip(recipe.encoder or DEFAULT, device_of(settings.device))
        name = template.name
        article = "an" if name[0] in "aeiou" else "a"
        text = TextGuidance(model, recipe.text, f"{article} {name}", seed=recipe.seed)
        return [text], (text.describe(),), ()
    from fabcraft.guidance.picture import PictureGuidance, targets_of
    from fabcraft.guidance.target_points import TargetPoints

    assert given.goal is not None
    goal, notes = goal_on(given.goal, rest, recipe, template.pair)
    inside = (
        torch.from_numpy(Frame.of(rest).inside(goal.mesh.vertices)).float().to(device_of(settings.device))
    )
    bank = ViewBank.around(rest, settings)
    views = bank.chunks(inside, Topology.of(goal.mesh.faces), ("shaded", "mask", "normal"))
    pictures = PictureGuidance(targets_of(views))
    points = TargetPoints.of(
        goal.mesh, rest, body=distance, clearance_mm=settings.clearance_mm, weight=100.0, seed=recipe.seed
    )
    file = Path(recipe.guidance).name
    route = (f"guidance mesh {file}, {goal.words}", pictures.describe(), points.describe())
    return [pictures, points], route, notes


def goal_on(goal: Mesh, rest: Mesh, recipe: Recipe, pair: bool) -> tuple[Aligned, tuple[str, ...]]:
    """(the recipe's guidance mesh, cleaned and brought onto the solid `rest`, notes of what was left out)."""
    clean = cleaned(goal, single=pair)
    placed = placed_by(recipe.guidance_transform)
    found = aligned(clean.mesh, rest, recipe.force) if placed is None else laid_on(clean.mesh, rest, placed)
    return found, clean.notes


def contacts_of(template: Template) -> "ContactSet | None":
    """The skin that the template rests on, with its rules; None where there is none."""
    from fabcraft.fit.body_terms import ContactSet

    body = template.body
    regions = [body.regions[name] for name in template.contacts if body.regions[name].weight > 0.0]
    if not regions:
        return None
    chosen = np.concatenate([region.vertex_indices for region in regions])
    weights = np.concatenate([region.weight * region.emphasis for region in regions])
    least = template.listed_mm[0] if template.kind == "solid" else template.resting_mm
    gaps = np.concatenate([np.full(len(region.vertex_indices), max(least, 0.0)) for region in regions])
    return ContactSet(body.mesh.vertices[chosen], body.mesh.vertex_normals[chosen], gaps, weights)


def _how(made: "Deformed") -> str:
    return (
        f"deformed as a solid: {made.stopped.value}, {made.remeshed} times refined, "
        f"settled by {made.settled_mm:.2f} mm, pushed {made.pushed_mm:.2f} mm"
    )


def _stopped(made: "Deformed") -> list[Finding]:
    if made.stopped.name not in ("INTERRUPTED", "NOT_FINITE"):
        return []
    return [Finding(check="fit", severity="warn", advice=f"The fit stopped early: {made.stopped.value}.")]
