"""`Reference`: what all methods of one design are held against: the placed template, its contacts, the aligned guidance.

The contacts are the skin that the placed template touches and the guidance stands before, with the gaps that the template
has there, the same for every method: the paper's table gives each row contacts of its own, and so cannot be read down a
column.
"""

from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float64

from fabcraft.evaluate.suite import Design, drawing_of
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.guidance.placement import PlacementSettings
from fabcraft.judge import worn_solid
from fabcraft.mesh import Mesh
from fabcraft.pipeline import make
from fabcraft.recipe import Recipe
from fabcraft.road.base import evened
from fabcraft.road.guided import SHEET_WALL_MM, goal_on, rest_of, stands_before
from fabcraft.road.motif import frame_of
from fabcraft.template.template import MotifFrame, Template
from fabcraft.wearer import find_body
from fabcraft.write.camera import VIEWS, View

THIN_MM = 0.35
"""Radius of the thin bangle's tube."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A rectangle of a plane, looked at squarely from far away, mm."""

    axes: Float64[np.ndarray, "2 3"]
    """Unit vectors to the right and up."""
    lower: Float64[np.ndarray, "2"]
    upper: Float64[np.ndarray, "2"]
    """Corners along the axes."""

    @property
    def size_mm(self) -> Float64[np.ndarray, "2"]:
        """Width and height."""
        return self.upper - self.lower

    @staticmethod
    def whole(view: View, *meshes: Mesh) -> "Picture":
        """All of the meshes, seen along `view`."""
        axes = np.ascontiguousarray(view.axes[:2])
        flat = np.concatenate([mesh.vertices @ axes.T for mesh in meshes])
        return Picture(axes, flat.min(0), flat.max(0))

    @staticmethod
    def within(frame: MotifFrame) -> "Picture":
        """What a drawing may fill in a motif frame: its size, and its reach on every side."""
        axes = np.stack([frame.right, frame.up])
        half = 0.5 * np.array(frame.size_mm) + frame.reach_mm
        return Picture(axes, axes @ frame.origin - half, axes @ frame.origin + half)


@dataclass(frozen=True, eq=False)
class Reference:
    """The fixed side of a comparison, mm."""

    body: SurfaceDistance
    contacts: Float64[np.ndarray, "C 3"] | None
    gaps_mm: Float64[np.ndarray, " C"] | float
    goal: Mesh
    """The guidance mesh, aligned with the template."""
    picture: Picture | None = None
    """Where the drawing lies on this wearer's template; None for a guidance mesh that no drawing gave."""


def reference_of(design: Design, guidance: Mesh) -> Reference:
    """The fixed side of `design`, for its guidance mesh as it was made.

    Raises `InputError` where the body cannot wear it, or the guidance resembles the template too little.
    """
    recipe = Recipe(template=design.template)
    template, rest = rest_of(recipe, find_body(design.body))
    body = SurfaceDistance(template.body.mesh)
    goal = goal_on(guidance, rest, recipe, template, body)[0].mesh
    contacts, gaps = worn_solid(rest, template, body).contacts, np.zeros(0)
    if contacts is not None:
        normals = body.mesh.face_normals[body.closest(contacts).faces]
        contacts = contacts[stands_before(contacts, normals, goal)]
        gaps = SurfaceDistance(rest).closest(contacts).distances
    return Reference(body, contacts, gaps, goal, _picture(design, template, goal))


def _picture(design: Design, template: Template, goal: Mesh) -> Picture | None:
    if design.shape:
        return None
    if template.kind == "sheet":  # drawn as a whole, from the front
        return Picture.whole(VIEWS["front"], goal, template.mesh)
    return Picture.within(frame_of(template, "", design.reading))


def guidance_recipe(design: Design) -> Recipe | None:
    """What makes the guidance mesh of a design; None for one that is a shape of its own."""
    if design.shape:
        return None
    wall = SHEET_WALL_MM if design.template == "mask" else 0.0
    return Recipe(
        template=design.template,
        body=design.made_for,
        preset="draft",
        method="direct",
        strap_slots=False,
        wall_mm=wall,
        placement=PlacementSettings(scale=design.scale),
        **drawing_of(design),
    )


def guidance_mesh(design: Design) -> Mesh:
    """The guidance mesh: the drawing as an object for another body, in even triangles; one of a pair."""
    recipe = guidance_recipe(design)
    if recipe is None:
        return _shape(design)
    made = make(recipe)
    return evened(made.worn.object or made.object)


def _shape(design: Design) -> Mesh:
    """A guidance mesh that no drawing gives: the template's wire, or its size as a closed ball."""
    _, rest = rest_of(Recipe(template=design.template), find_body(design.made_for))
    if design.shape == "closed helmet":
        ball = trimesh.creation.icosphere(4)
        half = 0.5 * rest.size_mm
        return Mesh(ball.vertices * half + rest.bounds.mean(0), ball.faces.astype(np.int32), design.shape)
    middle = rest.vertices.mean(0)
    axes = np.linalg.svd(rest.vertices - middle, full_matrices=False)[2]  # the last is the bangle's axis
    axes[2] *= np.linalg.det(axes)
    radius = float(np.linalg.norm((rest.vertices - middle) @ axes[:2].T, axis=1).mean())
    wire = trimesh.creation.torus(radius, THIN_MM, major_sections=160, minor_sections=12)
    return Mesh(wire.vertices @ axes + middle, wire.faces.astype(np.int32), design.shape)
