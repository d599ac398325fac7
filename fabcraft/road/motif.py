"""The road of a solid template: the drawing is a motif, fitted as a plate in one of its frames and made one with it."""

from dataclasses import replace

import numpy as np
import trimesh

from fabcraft.body.body import Body
from fabcraft.errors import InputError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.guidance.inflate import inflate
from fabcraft.guidance.motif import place_motif, with_openings
from fabcraft.judge import motif_likeness, worn_solid
from fabcraft.mesh import Mesh
from fabcraft.profile import PrinterProfile
from fabcraft.recipe import Recipe
from fabcraft.road.base import asked, built
from fabcraft.road.shaped import Clock, Given, Shaped, finished
from fabcraft.road.sheet import drawn, fitted, how, stopped
from fabcraft.solid.mount import mount
from fabcraft.solid.slab import slab
from fabcraft.template.motif_plate import plate
from fabcraft.template.picture_space import PictureSpace
from fabcraft.template.template import MotifFrame, Template

_BALL = trimesh.creation.icosphere(1)
_NOBODY = Mesh(_BALL.vertices + [0.0, 1e4, 0.0], _BALL.faces.astype(np.int32), "nobody")
"""Far behind any picture."""


def shape_motif(recipe: Recipe, given: Given, body: Body, profile: PrinterProfile, clock: Clock) -> Shaped:
    """The ring, bangle, helmet, ... of a recipe, with the drawing worked into a motif frame.

    Ctrl-C during the fit keeps the best so far.  Raises `InputError` for what cannot be placed, `SolidError` when no
    closed manifold comes out.
    """
    with clock.stage("template"):
        template = built(recipe.template, body, asked(recipe, profile), recipe.own)
        frame = frame_of(template, recipe.frame, recipe.reading)
        distance = SurfaceDistance(template.body.mesh)
    with clock.stage("guidance"):
        drawing, line, notes = drawn(recipe, given)
        width, height = np.ptp(drawing.outline, axis=0)
        aspect = None if frame.openings and frame.depth_mm else float(width / height)
        sheet, space = plate(template, frame, recipe.motif_mm or None, aspect)
        placed = place_motif(drawing, sheet, recipe.placement, space.scale)
        drawing = with_openings(drawing, sheet)
        even = frame.depth_mm > 0.0 and not frame.follows
        relief = inflate(placed, sheet, replace(recipe.inflate, swell=0.0) if even else recipe.inflate)
    with clock.stage("fit"):
        # an even plate knows no body: what is in its way is taken out of the solid
        near = SurfaceDistance(_NOBODY if even else space.seen(template.body.mesh))
        design = fitted(recipe, sheet, relief, near, clock.tell)
    with clock.stage("solid"):
        least_mm = max(profile.min_wall_mm, profile.min_wall_supported_mm)
        keep_mm = max(template.listed_mm[0], 0.0)
        parts = (design.mesh, sheet, relief, space, frame.carrier or template.mesh, distance)
        solid, alone = slab(*parts, keep_mm) if frame.depth_mm else mount(*parts, least_mm, keep_mm)
        one, object_ = finished(solid.mesh, template, recipe)
    width, height = (placed.outline.max(0) - placed.outline.min(0)) / space.scale
    return Shaped(
        template=template,
        object=object_,
        worn=worn_solid(one, template, distance),
        drawing=drawing,
        stages=_stages(template, space, design.stages),
        route=(
            *line,
            _where(template, frame, width, height),
            *how(design, units_per_mm=space.scale),
        ),
        notes=(*notes, *((False, text) for text in template.notes)),
        solid_notes=solid.notes,
        findings=tuple(stopped(design)),
        metrics=motif_likeness(alone, sheet, relief, space.seen(template.mesh) if frame.depth_mm else None),
        interrupted=design.interrupted,
    )


def frame_of(template: Template, name: str, reading: str) -> MotifFrame:
    """The frame called `name`, or the usual one, for a drawing that shows a motif or the object."""
    fitting = [frame for frame in template.motifs if not reading or frame.reading == reading]
    found = [frame for frame in fitting if frame.name == name or not name]
    if found:
        return found[0]
    words = f"the whole {template.name}" if reading == "object" else f"a motif on the {template.name}"
    known = ", ".join(f"{frame.name} ({frame.reading})" for frame in template.motifs)
    raise InputError(
        f"there is no place '{name}' for {words}" if name else f"there is no place for {words}",
        f"Places, and what is drawn there: {known}.",
    )


def _where(template: Template, frame: MotifFrame, width: float, height: float) -> str:
    """Size and place of the drawing, as a line of the route."""
    what = f"the whole {template.name}" if frame.reading == "object" else "a motif"
    return f"{what}, {width:.0f} x {height:.0f} mm, on the {frame.name}"


def _stages(
    template: Template, space: PictureSpace, stages: tuple[tuple[str, Mesh], ...]
) -> tuple[tuple[str, Mesh], ...]:
    """The template with the plate before it, stage by stage, mm."""
    joined = [("template", template.mesh)]
    for label, sheet in stages[1:]:
        placed = sheet.with_vertices(space.outside(sheet.vertices))
        vertices = np.concatenate([template.mesh.vertices, placed.vertices])
        faces = np.concatenate([template.mesh.faces, placed.faces + np.int32(len(template.mesh.vertices))])
        joined.append((label, Mesh(vertices, faces, template.name)))
    return tuple(joined)
