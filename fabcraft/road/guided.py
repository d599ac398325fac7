"""The road of a guidance mesh or a text: a closed solid is deformed as a whole, seen from all sides (the paper's road)."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float64

from fabcraft.body.body import Body
from fabcraft.check.report import Finding
from fabcraft.fit import presets
from fabcraft.fit.presets import Baseline, DeformSettings, baseline, for_text
from fabcraft.fit.refit import refitted
from fabcraft.geometry.along import face_distances
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.guidance.alignment import Aligned, aligned, laid_on, placed_by, seated
from fabcraft.guidance.clean import cleaned
from fabcraft.guidance.openings import opened
from fabcraft.judge import nearest_tenth, worn_solid
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

_BEFORE = 0.5
"""Cosine of the skin's normal with the way to the guidance from which on the guidance is before the skin, not beside it."""
_LOOKS = 0.9
"""Cosine with the way to the skin from which on a face looks at it."""
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
        least_mm = max(profile.min_wall_mm, profile.min_wall_supported_mm)
        settings = replace(row.settings, wall_mm=least_mm)
        locked = locked_of(template, distance) if row.locked and template.holds else None
        if settings.settle:
            # the fit is mended exactly after the loop: no need to turn the guidance down
            settings = replace(settings, guidance_then=1.0)
        guidance: list["Guide"] = []
        route: tuple[str, ...]
        said: tuple[str, ...] = ()
        goal, placed = None, rest
        if given.goal is not None and (row.base == "guidance" or row.guided != "nothing"):
            goal, said = goal_on(given.goal, rest, recipe, template, distance)
        if row.base == "guidance":
            assert goal is not None
            rest, locked, route = goal.mesh, None, (f"the guidance mesh itself, {goal.words}",)
        elif row.guided == "nothing":
            route = ("the template itself",)
        elif goal is not None:
            seat = None if locked is None else rest.submesh(locked)
            wanted = goal.mesh
            if row.body and settings.weights.penetration > 0.0:
                wanted = refitted(wanted, seat, distance, settings.clearance_mm, least_mm, template.wall_mm)
            guidance, words = _towards(wanted, rest, recipe, settings)
            route = (f"guidance mesh {Path(recipe.guidance).name}, {goal.words}", *words)
        else:
            guidance, route = _worded(recipe, template, settings)
        held = contacts_of(template, placed, goal.mesh if goal is not None else None) if row.body else None
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
            contacts=held,
            guidance=guidance,
            settings=settings,
            locked=locked,
            watch=watch,
        )
        stages.append(("fitted", made.mesh))
    with clock.stage("solid"):
        notes: tuple[str, ...] = ()
        if recipe.method in ("", "ours"):
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


def _worded(
    recipe: Recipe, template: Template, settings: DeformSettings
) -> tuple[list["Guide"], tuple[str, ...]]:
    """(the objectives of a text, what they are, in lines of the route)."""
    from fabcraft.geometry.device import device_of
    from fabcraft.guidance.clip import DEFAULT, load_clip
    from fabcraft.guidance.text import TextGuidance

    model = load_clip(recipe.encoder or DEFAULT, device_of(settings.device))
    name = template.name
    article = "an" if name[0] in "aeiou" else "a"
    text = TextGuidance(model, recipe.text, f"{article} {name}", seed=recipe.seed)
    return [text], (text.describe(),)


def _towards(
    goal: Mesh, rest: Mesh, recipe: Recipe, settings: DeformSettings
) -> tuple[list["Guide"], tuple[str, ...]]:
    """(the objectives of a guidance mesh on `rest`, what they are, in lines of the route)."""
    import torch

    from fabcraft.fit.render import Topology
    from fabcraft.fit.views import ViewBank
    from fabcraft.geometry.device import device_of
    from fabcraft.geometry.frame import Frame
    from fabcraft.guidance.picture import PictureGuidance, targets_of
    from fabcraft.guidance.target_points import TargetPoints

    inside = torch.from_numpy(Frame.of(rest).inside(goal.vertices)).float().to(device_of(settings.device))
    bank = ViewBank.around(rest, settings)
    views = bank.chunks(inside, Topology.of(goal.faces), ("shaded", "mask", "normal"))
    pictures = PictureGuidance(targets_of(views))
    points = TargetPoints.of(goal, rest, weight=100.0, seed=recipe.seed)
    return [pictures, points], (pictures.describe(), points.describe())


def goal_on(
    goal: Mesh, rest: Mesh, recipe: Recipe, template: Template, distance: SurfaceDistance
) -> tuple[Aligned, tuple[str, ...]]:
    """(the recipe's guidance mesh, cleaned and brought onto the solid `rest`, notes of what was left out)."""
    clean = cleaned(goal, single=template.pair)
    placed = placed_by(recipe.guidance_transform)
    if placed is not None:
        return laid_on(clean.mesh, rest, placed), clean.notes
    found = aligned(clean.mesh, rest, recipe.force)
    if template.kind == "sheet":
        return opened(found, rest), clean.notes
    locked = locked_of(template, distance)
    return (found if locked is None else seated(found, rest.submesh(locked))), clean.notes


def locked_of(template: Template, distance: SurfaceDistance) -> Bool[np.ndarray, " F"] | None:
    """The locked faces that stay on the surface that they were built on; None where there are none.

    Of the edge of a wall, which does not look at the skin, guidance may make what it likes; a temple, locked on all its
    sides, is none.  A sheet's solid has other faces than the template.
    """
    if template.kind != "solid" or template.locked is None or not template.locked.any():
        return None
    mesh, free = template.mesh, ~template.locked
    away = distance.signed_with_gradient(mesh.corners.mean(1))[1]
    looking = np.einsum("ij,ij->i", away, mesh.face_normals) < -_LOOKS
    wall = 1.5 * template.wall_mm
    inland = ~np.isfinite(face_distances(mesh, free, wall)) if free.any() else template.locked
    locked = template.locked & (looking | inland)
    return locked if locked.any() else None


def contacts_of(template: Template, rest: Mesh, goal: Mesh | None = None) -> "ContactSet | None":
    """The skin that the placed solid `rest` is nearest to, with the gaps that it has there; None where it rests on nothing.

    A region's nearest tenth: a temple or a tube crosses it on a line; where it only hangs (weight below 1, as a bangle on a
    wrist), nothing is to touch.  The seat that the template was built for is kept, a ring's room for the knuckle with it.
    goal : aligned guidance. Where it has nothing before the skin, nothing can rest: drawn there all the same, the tips of a
    butterfly's wings would be bent into the notch between them. If that leaves nothing, all is kept.
    """
    from fabcraft.fit.body_terms import ContactSet

    body, surface = template.body, SurfaceDistance(rest)
    regions = [body.regions[name] for name in template.contacts if body.regions[name].weight >= 1.0]
    if not regions:
        return None
    chosen, weights, gaps = [], [], []
    for region in regions:
        nearest, away = nearest_tenth(surface, body.mesh.vertices[region.vertex_indices])
        chosen.append(region.vertex_indices[nearest])
        weights.append(region.weight * np.maximum(region.emphasis[nearest], 1e-3))
        gaps.append(away)
    rows = np.concatenate(chosen)
    points, normals = body.mesh.vertices[rows], body.mesh.vertex_normals[rows]
    kept = np.ones(len(rows), dtype=bool) if goal is None else stands_before(points, normals, goal)
    return ContactSet(points[kept], normals[kept], np.concatenate(gaps)[kept], np.concatenate(weights)[kept])


def stands_before(
    points: Float64[np.ndarray, "N 3"], normals: Float64[np.ndarray, "N 3"], goal: Mesh
) -> Bool[np.ndarray, " N"]:
    """Which places of the skin have the guidance before them, or behind; all of them where none has."""
    way = SurfaceDistance(goal).closest(points).points - points
    along = np.abs(np.einsum("ij,ij->i", way, normals))
    kept = along >= _BEFORE * np.linalg.norm(way, axis=1)
    return kept if kept.any() else ~kept


def _how(made: "Deformed") -> str:
    return (
        f"deformed as a solid: {made.stopped.value}, {made.remeshed} times refined, "
        f"settled by {made.settled_mm:.2f} mm, pushed {made.pushed_mm:.2f} mm"
    )


def _stopped(made: "Deformed") -> list[Finding]:
    if made.stopped.name not in ("INTERRUPTED", "NOT_FINITE"):
        return []
    return [Finding(check="fit", severity="warn", advice=f"The fit stopped early: {made.stopped.value}.")]
