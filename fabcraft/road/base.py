"""The template that every road starts from: a built-in kind, or a mesh of the user's own, made sound and placed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from fabcraft.body.body import Body
from fabcraft.check.thickness import measure_thickness
from fabcraft.errors import InputError, SolidError
from fabcraft.geometry.align import Similarity, axis_rotations, settled_on
from fabcraft.geometry.crossing import self_intersecting_faces
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.isotropic import isotropic
from fabcraft.geometry.sampling import area_samples
from fabcraft.guidance.alignment import aligned
from fabcraft.mesh import Mesh
from fabcraft.profile import PrinterProfile
from fabcraft.read.mesh_file import read_mesh
from fabcraft.recipe import Recipe
from fabcraft.solid.manifolds import part_count, to_manifold, try_manifold
from fabcraft.solid.thicken import SolidSettings, solidify
from fabcraft.template.catalogue import Settings
from fabcraft.template.kinds import is_own, kind_of
from fabcraft.template.own import OwnSettings, own
from fabcraft.template.own_place import by_landmarks, by_transform, part_for
from fabcraft.template.template import Template

MAX_FACES, SIZES_MM = 400_000, (3.0, 3000.0)
"""Of an own mesh: faces at most, and its longest side on the body."""
SHEET_WALL_MM, SHEET_CELL_MM = 2.0, 2.0
"""Wall of an own mesh that is a sheet; largest cell when a built-in sheet is made a solid."""
_WALL_MM, _WALL_LIMIT_MM = 1.0, 6.0
"""How finely walls of an own mesh are measured; thicker than the limit is as good as the limit."""
_EVEN_FACES, _CREASE_DEG = 9000, 40.0
_SAMPLES, _KEPT, _REFINED = 3000, 0.9, 3
_DECLARED = OwnSettings()


def built(
    name: str,
    body: Body,
    settings: Settings,
    own_settings: OwnSettings = _DECLARED,
    even: bool = False,
) -> Template:
    """The template `name`, a built-in kind or the file of an own mesh, for `body`.

    settings : parameters of the built-in kind, or of the one that the own mesh is like.
    even : an own mesh is remeshed evenly, to be deformed as a whole.
    Raises `InputError` for what cannot be worn, read, placed or made a solid.
    """
    if not is_own(name):
        kind = kind_of(name)
        return kind.build(body, kind.settled(settings))
    if settings and not own_settings.like:
        raise InputError(
            f"{next(iter(settings))} was set of an own template, which has no parameters",
            "Say which built-in template it is like (--like), to set that one's.",
        )
    like = built(own_settings.like, body, settings) if own_settings.like else None
    mesh, notes = _sound(read_mesh(name, own_settings.units or None), Path(name).name)
    placed, part, told = _placed(mesh, body, own_settings, like)
    size = placed.scale * float(mesh.size_mm.max())
    if not SIZES_MM[0] <= size <= SIZES_MM[1]:
        raise InputError(
            f"{Path(name).name} is {size:.3g} mm long; {SIZES_MM[0]:g} to {SIZES_MM[1]:g} were expected",
            "Say its unit (--template-units).",
        )
    if even:
        mesh = evened(mesh)
    genus = to_manifold(mesh).genus()
    template = own(mesh, placed, part, own_settings, like, genus=genus, notes=(*notes, *told))
    wall_mm = measure_thickness(template.mesh, _WALL_MM, limit_mm=_WALL_LIMIT_MM).min_mm
    return replace(template, wall_mm=wall_mm)


def asked(recipe: Recipe, profile: PrinterProfile) -> Settings:
    """The parameters that a recipe sets, and the play between moving parts that its printer needs."""
    like = recipe.own.like if is_own(recipe.template) else recipe.template
    return (
        kind_of(like).playing(recipe.parameters, profile.clearance_moving_mm) if like else recipe.parameters
    )


def as_solid(template: Template) -> Mesh:
    """The closed mesh of a template; a sheet gets its wall."""
    if template.kind == "solid":
        return template.mesh
    settings = SolidSettings(wall_mm=template.wall_mm, cell_mm=min(SHEET_CELL_MM, 0.5 * template.wall_mm))
    return solidify(template.mesh, settings).mesh


def _sound(mesh: Mesh, file: str) -> tuple[Mesh, tuple[str, ...]]:
    """The mesh as one closed solid that crosses itself nowhere, and notes of what that took."""
    if len(mesh.faces) > MAX_FACES:
        raise InputError(
            f"{file} has {len(mesh.faces):,} triangles; a template has at most {MAX_FACES:,}",
            "Simplify it in the program that made it.",
        )
    notes: tuple[str, ...] = ()
    if try_manifold(mesh) is None or len(self_intersecting_faces(mesh)):
        try:
            made = solidify(mesh, SolidSettings(wall_mm=SHEET_WALL_MM))
        except SolidError as error:
            raise InputError(
                f"{file} cannot be made a closed solid: {error.message}",
                "Close it in the program that made it, or check its unit (--template-units).",
            ) from error
        sheets = made.numbers["sheets"] > 0.0
        first = (
            f"{file} was an open surface: it got a wall of {SHEET_WALL_MM:g} mm."
            if sheets
            else f"{file} was repaired."
        )
        mesh, notes = made.mesh, (first, *(f"{text}." for text in made.notes))
    if (parts := part_count(to_manifold(mesh))) != 1:
        raise InputError(
            f"{file} has {parts} separate parts; one was expected", "Join them, or give one of them."
        )
    return mesh, notes


def _placed(
    mesh: Mesh, body: Body, settings: OwnSettings, like: Template | None
) -> tuple[Similarity, Body, tuple[str, ...]]:
    """(where the mesh sits, the part of the body that wears it, notes)."""
    if settings.landmarks:
        whole = {**body.joints, **body.landmarks}
        found, note = by_landmarks(settings.landmarks, whole, settings.scale)
        part = like.body if like else part_for(_moved(mesh, found), body)
        # on the part's smoothed skin the landmarks are a little elsewhere
        nearer = {**whole, **part.joints, **part.landmarks}
        found, note = by_landmarks(settings.landmarks, nearer, settings.scale)
        return found, part, (note,)
    if settings.transform:
        found = by_transform(settings.transform)
    elif like is not None:
        found, note = _by_likeness(mesh, like, settings.scale)
        return found, like.body, (note,)
    else:
        found = Similarity()
    return found, like.body if like else part_for(_moved(mesh, found), body), ()


def _by_likeness(mesh: Mesh, like: Template, scaled: bool) -> tuple[Similarity, str]:
    """Where the mesh comes nearest to the built-in template, and a note of how near that is."""
    onto = as_solid(like)
    first = aligned(mesh, onto, what="template", scaled=scaled).placed
    faces, weights = area_samples(mesh.face_areas, _SAMPLES, np.random.default_rng(1))
    points = (weights[:, :, None] * mesh.corners[faces]).sum(1)
    surface = SurfaceDistance(onto)

    def missed(placed: Similarity) -> float:
        return float(surface.closest(placed.points(points)).distances.mean())

    # the nearest point tells the bezel of a round ring too little: its like is looked for all round
    some = points[:: _SAMPLES // 600]
    tried = [settled_on(surface, some, one, scaled, _KEPT, 8) for one in _turned(first, points)]
    best = sorted(tried, key=missed)[:_REFINED]
    found = min((settled_on(surface, points, one, scaled, _KEPT) for one in best), key=missed)
    miss = missed(found)
    note = f"It was placed on the built-in {like.name}, {miss:.1f} mm off on average, scaled {found.scale:.3g} times."
    return found, note


def _turned(placed: Similarity, points: Float64[np.ndarray, "N 3"]) -> list[Similarity]:
    """The placement itself, and with the mesh turned about the principal axes of its points."""
    moved = placed.points(points)
    middle = moved.mean(0)
    axes = np.linalg.svd(moved - middle, full_matrices=False)[2]
    turns = [axes.T @ turn @ axes for turn in axis_rotations()]
    return [
        Similarity(placed.scale, turn @ placed.rotation, middle + turn @ (placed.translation - middle))
        for turn in turns
    ]


def _moved(mesh: Mesh, placed: Similarity) -> Mesh:
    return mesh.with_vertices(placed.points(mesh.vertices))


def evened(mesh: Mesh) -> Mesh:
    """The mesh in even triangles, its creases kept."""
    edge = float(np.sqrt(4.0 / np.sqrt(3.0) * mesh.area_mm2 / _EVEN_FACES))
    try:
        return isotropic(mesh, edge, crease_deg=_CREASE_DEG)
    except SolidError:
        return isotropic(mesh, 0.5 * edge, crease_deg=_CREASE_DEG)
