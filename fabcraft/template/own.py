"""A user's own mesh as a template: what of it is locked, how it comes off, where it rests.

What is not said of it is taken from the built-in kind that it is like.  Points in a user's files are in the mesh's own
frame, mm, as it is read (Z up).
"""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64

from fabcraft.body.body import Body
from fabcraft.body.contacts import resting_on
from fabcraft.errors import InputError
from fabcraft.geometry.align import Similarity
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh
from fabcraft.read.mesh_file import UNITS_MM
from fabcraft.read.table_file import read_table
from fabcraft.template.kinds import known
from fabcraft.template.own_frame import front_frame, reanchored, restrapped
from fabcraft.template.template import Template

NAME = "object"
"""What an own template is called that is like no built-in one."""
INSIDE_MM = 10.0
"""Faces that look at skin no farther away than this are locked, unless another distance is asked."""
LOOKS_AT = 0.7
"""Least cosine between a face's normal and the way to the nearest skin."""
DIRECTIONS = {
    "front": (0, -1, 0),
    "back": (0, 1, 0),
    "up": (0, 0, 1),
    "down": (0, 0, -1),
    "left": (1, 0, 0),
    "right": (-1, 0, 0),
}
"""Words for directions, the wearer's."""
MAX_SPHERES = 200
_NO_SLOTS = (
    "It gets no strap slots: they go into the wall of an own visor only, where the built-in one has them."
)
_AWAY_MM, _WITHIN = 60.0, 0.5
"""Farther from the skin, or with a larger share inside the body, it is in the wrong place."""


@dataclass(frozen=True)
class OwnSettings:
    """What is said of a user's own template mesh."""

    like: str = ""
    """The built-in kind that it is one of: placed by ICP to it if not otherwise, and it comes off like that."""
    transform: str = ""
    """Its 4 x 4 matrix to the body's space, mm: a .json or .toml file with `transform`."""
    landmarks: str = ""
    """File of landmarks of the body, name to a point of the mesh, mm: JSON, TOML or CSV."""
    units: str = ""
    """Unit of the file: mm, cm, m or in; the format's own when left out."""
    scale: bool = False
    """Landmarks and ICP may change its size."""
    locked: str = ""
    """What keeps its shape: inside (faces that look at skin), none, or a .toml or .json file of spheres."""
    donning: str = ""
    """Direction in which it comes off: front, back, up, down, left, right, or x,y,z."""
    facing: str = ""
    """Direction that the place for a motif faces, likewise."""

    def __post_init__(self) -> None:
        if self.like:
            known(self.like)
        if self.units and self.units not in UNITS_MM:
            raise InputError(f"template units '{self.units}' were asked", f"Units: {', '.join(UNITS_MM)}.")
        if self.transform and self.landmarks:
            raise InputError(
                "both a transform and landmarks were given to place the template", "Give one of them."
            )
        for name in ("donning", "facing"):
            if getattr(self, name):
                direction(getattr(self, name), name)

    @property
    def said(self) -> tuple[str, ...]:
        """Names of what is not left out."""
        return tuple(entry.name for entry in fields(self) if getattr(self, entry.name) != entry.default)


def direction(text: str, what: str) -> Float64[np.ndarray, "3"]:
    """The unit vector of a word of `DIRECTIONS` or of "x,y,z".  Raises `InputError` for anything else."""
    try:
        given = DIRECTIONS.get(text) or [float(part) for part in text.split(",")]
    except ValueError:
        given = []
    vector = np.array(given, dtype=np.float64)
    if vector.shape != (3,) or not 1e-9 < float(np.linalg.norm(vector)) < 1e9:
        raise InputError(
            f"{what} '{text[:60]}' is no direction", f"Give {', '.join(DIRECTIONS)}, or x,y,z such as 0,-1,0."
        )
    return vector / np.linalg.norm(vector)


def looks_at(mesh: Mesh, skin: SurfaceDistance, within_mm: float) -> Bool[np.ndarray, " F"]:
    """Faces that look straight at the skin, no farther from it than `within_mm`."""
    middles = mesh.corners.mean(1)
    found = skin.closest(middles)
    towards = np.einsum("ij,ij->i", found.points - middles, mesh.face_normals)
    return (found.distances < within_mm) & (towards > LOOKS_AT * found.distances)


def own(
    mesh: Mesh,
    placed: Similarity,
    body: Body,
    settings: OwnSettings,
    like: Template | None,
    *,
    genus: int,
    notes: tuple[str, ...] = (),
) -> Template:
    """The template of a closed solid `mesh` in its own frame, mm, that `placed` brings onto `body`.

    body : the part that wears it.  like : the built-in template that it is one of.  Its wall has yet to be measured.
    Raises `InputError` where it is off the body or inside it, and for files that cannot be read.
    """
    mesh = Mesh(placed.points(mesh.vertices), mesh.faces, settings.like or NAME)
    skin = SurfaceDistance(body.mesh)
    signed = skin.signed(mesh.vertices)
    if float(signed.min()) > _AWAY_MM * max(body.scale, 0.2) or float((signed < 0.0).mean()) > _WITHIN:
        inside = float(signed.min()) <= 0.0
        share = f"has {(signed < 0.0).mean():.0%} of its vertices inside"
        where = share if inside else f"is {float(signed.min()):.0f} mm away from"
        raise InputError(
            f"the template {where} the {body.name}",
            "Place it: --template-landmarks FILE, --template-transform FILE or --like KIND; or say --template-units.",
        )
    within_mm, spheres = _locks(settings.locked)
    facing = looks_at(mesh, skin, within_mm)
    locked = facing.copy()
    for point, radius in spheres:
        middle = placed.points(np.array(point)[None])
        locked |= np.linalg.norm(mesh.corners.mean(1) - middle, axis=1) <= placed.scale * radius
    middle = mesh.bounds.mean(0)
    away = (middle - skin.closest(middle[None]).points[0]) * np.sign(skin.signed(middle[None])[0] or 1.0)
    ahead = (
        direction(settings.facing, "facing") if settings.facing else away / max(np.linalg.norm(away), 1e-9)
    )
    frames = () if like is None or settings.facing else reanchored(mesh, like)
    straps = () if like is None else restrapped(mesh, like)
    if like is not None and not straps and (like.straps or like.kind == "sheet"):
        notes = (*notes, _NO_SLOTS)
    gaps = skin.signed(mesh.corners.mean(1)[facing]) if facing.any() else np.zeros(1)
    straight = direction(settings.donning, "donning") if settings.donning else ahead
    lengths = np.linalg.norm(mesh.corners - np.roll(mesh.corners, 1, axis=1), axis=2)
    kept = like is not None and not settings.donning
    return Template(
        name=mesh.name,
        body=body,
        mesh=mesh,
        rims=(),
        surface=None,
        wall_mm=0.0,
        genus=genus,
        contacts=resting_on(body, () if like is None else like.contacts),
        edge_mm=float(lengths.mean()),
        donning=like.donning if like is not None and kept else tuple(straight.tolist()),
        path=like.path if like is not None and kept else None,
        locked=locked if locked.any() else None,
        pair=like is not None and like.pair,
        motifs=frames or front_frame(mesh, ahead),
        straps=straps,
        listed_mm=(0.0, max(float(np.median(gaps)), 0.0)) if like is None else like.listed_mm,
        notes=notes,
    )


def _locks(locked: str) -> tuple[float, list[tuple[list[float], float]]]:
    """(how near faces have to look at skin, spheres as (middle, radius)), mm."""
    if locked in ("", "inside", "none"):
        return (0.0 if locked == "none" else INSIDE_MM), []
    table, name = read_table(locked, "file of locked faces"), Path(locked).name
    if not isinstance(table, dict) or (set(table) - {"inside_mm", "sphere"}):
        raise InputError(
            f"{name} holds something else than inside_mm and rows called sphere",
            "Write inside_mm = 5, and for each sphere [[sphere]] with point and radius_mm.",
        )
    rows = table.get("sphere", [])
    if not isinstance(rows, list) or len(rows) > MAX_SPHERES:
        raise InputError(f"{name}: at most {MAX_SPHERES} rows called sphere were expected", "Give fewer.")
    within = _number(table.get("inside_mm", INSIDE_MM), f"{name}: inside_mm", 0.0, 100.0)
    return within, [_sphere(row, f"{name}, sphere {number}") for number, row in enumerate(rows, 1)]


def _sphere(row: Any, where: str) -> tuple[list[float], float]:
    point = row.get("point") if isinstance(row, dict) and set(row) == {"point", "radius_mm"} else None
    if not isinstance(point, list) or len(point) != 3:
        raise InputError(
            f"{where} is not a point and a radius_mm", "Write point = [x, y, z] and radius_mm = 5."
        )
    middle = [_number(value, f"{where}: point", -1e5, 1e5) for value in point]
    return middle, _number(row["radius_mm"], f"{where}: radius_mm", 0.01, 1e4)


def _number(value: Any, where: str, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise InputError(f"{where} is {str(value)[:40]}", f"Give a number of mm from {low:g} to {high:g}.")
    return float(value)
