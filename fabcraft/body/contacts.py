"""Contacts: where an object rests on a body, and what it keeps away from; from the body's rules or a user's file.

By itself a template rests on regions that it names, by the rules that the body's regions carry.  A contact file changes
that, row by row: other numbers for a region, or a place of its own, as TOML (or the same as JSON):

    [[contact]]
    region = "forehead"          # one of the body's: fabcraft bodies show BODY
    weight = 0                   # how strongly it is to rest there; 0: not at all

    [[contact]]
    point = [31, -92, 1610]      # mm, or the name of a landmark
    name = "scar"
    radius_mm = 8
    never_closer_mm = 5

Left-out numbers keep the region's rule; a place of its own that no weight is given for is kept clear of.
"""

import difflib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, Int64
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from fabcraft.body.body import Body
from fabcraft.body.region import Region
from fabcraft.errors import InputError
from fabcraft.mesh import Mesh
from fabcraft.read.table_file import read_table

MAX_ROWS = 200
RANGES = {
    "weight": (0.0, 10.0),
    "gap_mm": (0.0, 50.0),
    "never_closer_mm": (-1.0, 50.0),
    "radius_mm": (0.5, 150.0),
}
"""Least and greatest value of each number of a row."""
RADIUS_MM, GAP_MM = 8.0, 1.0
"""Of a place of its own, when the row does not say."""


@dataclass(frozen=True)
class Contact:
    """A row of a contact file; None: not said."""

    region: str = ""
    """A region of the body, or empty where a point is given."""
    point: tuple[float, float, float] | str | None = None
    """A place in the body's coordinates (mm), put onto the skin, or the name of a landmark."""
    name: str = ""
    """What a place of its own is called."""
    radius_mm: float | None = None
    """Reach of a place of its own."""
    weight: float | None = None
    """How strongly the object is to rest there; 0: not at all."""
    gap_mm: float | None = None
    """Largest gap wanted where it rests."""
    never_closer_mm: float | None = None
    """The object stays at least this far away."""


def read_contacts(path: Path | str) -> tuple[Contact, ...]:
    """The rows of a contact file (.toml or .json).

    Raises `InputError` for a file that cannot be read, an unknown key, or a value of the wrong kind or out of range.
    """
    path = Path(path)
    table = read_table(path, "contact file")
    if not isinstance(table, dict):
        raise InputError(f"{path.name} holds no table", 'Give {"contact": [...]}.')
    unknown = [key for key in table if key != "contact"]
    rows = table.get("contact")
    if unknown or not isinstance(rows, list) or not rows:
        given = f"the key {unknown[0]!r}" if unknown else "no list of contacts"
        raise InputError(
            f"{path.name} has {given}; rows called contact were expected", "Begin each with [[contact]]."
        )
    if len(rows) > MAX_ROWS:
        raise InputError(f"{path.name} has {len(rows)} contacts", f"Give at most {MAX_ROWS}.")
    return tuple(_contact(row, f"{path.name}, contact {number}") for number, row in enumerate(rows, 1))


def with_contacts(body: Body, contacts: Sequence[Contact]) -> Body:
    """`body` with the rules of the rows, and with their places as regions; `asked` names them all.

    Raises `InputError` for a region or landmark that the body has not, a point away from the skin, a name that is taken
    or a distance that no gap can keep.
    """
    regions, asked = dict(body.regions), list(body.asked)
    for number, row in enumerate(contacts, 1):
        if row.region:
            region = _known(row.region, regions, body, "region")
        else:
            region = _place(row, body, row.name or f"contact {number}")
            if region.name in regions:
                raise InputError(
                    f"a contact is called '{region.name}', but {body.name} has a region of that name",
                    "Give it another name, or say region instead of name.",
                )
        said = {key: getattr(row, key) for key in ("weight", "gap_mm", "never_closer_mm")}
        region = replace(region, **{key: value for key, value in said.items() if value is not None})
        if region.weight > 0.0 and region.never_closer_mm > region.gap_mm:
            raise InputError(
                f"at {region.name} the gap wanted is at most {region.gap_mm:g} mm, but nothing may come closer than "
                f"{region.never_closer_mm:g} mm",
                "Give a larger gap_mm, or weight = 0 to keep clear of it.",
            )
        regions[region.name] = region
        if region.name not in asked:
            asked.append(region.name)
    return replace(body, regions=regions, asked=tuple(asked))


def resting_on(body: Body, usual: Sequence[str]) -> tuple[str, ...]:
    """Regions that a template rests on: of the `usual` ones those with a weight, then what the user asked for besides."""
    wanted = [name for name in usual if name in body.regions]
    wanted += [name for name in body.asked if name in body.regions and name not in usual]
    return tuple(name for name in wanted if body.regions[name].weight > 0.0)


def skin_disc(mesh: Mesh, points: Float64[np.ndarray, "N 3"], radius_mm: float) -> Int64[np.ndarray, " M"]:
    """Vertices within `radius_mm` of one of the points, and joined to it by skin; at least the nearest to each.

    Paths run along edges and so are up to a third longer than the way along the skin: they only keep out what lies across
    a gap, such as the other lip.
    """
    vertices = mesh.vertices
    seeds = cKDTree(vertices).query(points)[1]
    near = cKDTree(vertices[seeds]).query(vertices, distance_upper_bound=1.01 * radius_mm)[0] <= radius_mm
    faces = mesh.faces[near[mesh.faces].any(1)]
    ends = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    lengths = np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1)
    # every edge inside is there once in each direction, so no length is added up twice
    graph = coo_matrix((lengths, ends.T), shape=(len(vertices),) * 2).tocsr()
    reach = dijkstra(graph, directed=False, indices=np.unique(seeds), min_only=True, limit=1.5 * radius_mm)
    near[seeds] = True
    return np.flatnonzero(np.isfinite(reach) & near)


def _contact(row: Any, where: str) -> Contact:
    """A checked row; `where` names it in errors."""
    if not isinstance(row, dict):
        raise InputError(f"{where} is {row!r}, not a table", "Begin it with [[contact]].")
    known = [entry.name for entry in fields(Contact)]
    for key in row:
        if key not in known:
            close = difflib.get_close_matches(key, known, n=1)
            hint = f"Did you mean {close[0]}?" if close else f"Known: {', '.join(known)}."
            raise InputError(f"{where}: unknown key {key}", hint)
    for key in ("region", "name"):
        if not isinstance(row.get(key, ""), str) or len(row.get(key, "")) > 80:
            raise InputError(f"{where}: {key} is {row[key]!r}", "Give a short name.")
    if bool(row.get("region")) == ("point" in row):
        raise InputError(f"{where}: one of region and point was expected", "Say where it is, in one way.")
    if row.get("region") and ("radius_mm" in row or "name" in row):
        raise InputError(
            f"{where}: a region has its own size and name", "Leave out radius_mm and name, or give a point."
        )
    for key, (low, high) in RANGES.items():
        value = row.get(key, low)
        if not _number(value) or not low <= value <= high:
            raise InputError(f"{where}: {key} is {value!r}", f"Give a number from {low:g} to {high:g}.")
        if key in row:
            row = {**row, key: float(value)}
    if "point" in row and not isinstance(row["point"], str):
        point = row["point"]
        if not isinstance(point, list) or len(point) != 3 or not all(map(_number, point)):
            raise InputError(
                f"{where}: point is {point!r}", "Give [x, y, z] in mm, or the name of a landmark."
            )
        row = {**row, "point": tuple(float(value) for value in point)}
    return Contact(**row)


def _number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _known(name: str, named: Mapping[str, Any], body: Body, kind: str) -> Any:
    """What `named` has under `name`.  Raises `InputError` with the names that come close."""
    if name in named:
        return named[name]
    close = difflib.get_close_matches(name, named, n=3, cutoff=0.5)
    raise InputError(
        f"body {body.name} has no {kind} '{name}'",
        f"Nearest: {', '.join(close)}." if close else f"It has: {', '.join(sorted(named))}.",
    )


def _place(row: Contact, body: Body, name: str) -> Region:
    """The skin round a point of the user's, to be kept clear of unless the row says otherwise."""
    point = np.array(
        _known(row.point, body.landmarks, body, "landmark") if isinstance(row.point, str) else row.point
    )
    radius_mm = row.radius_mm or RADIUS_MM
    away, vertex = cKDTree(body.mesh.vertices).query(point)
    longest = float(np.linalg.norm(np.diff(body.mesh.corners[:, [0, 1, 2, 0]], axis=1), axis=2).max())
    if away > max(radius_mm, longest):
        near = min(body.landmarks, key=lambda key: float(np.linalg.norm(body.landmarks[key] - point)))
        raise InputError(
            f"{name} at ({point[0]:g}, {point[1]:g}, {point[2]:g}) is {away:.0f} mm away from the skin of {body.name}",
            f"Nearest landmark: {near} at ({', '.join(f'{value:.0f}' for value in body.landmarks[near])}).",
        )
    return Region(name, skin_disc(body.mesh, body.mesh.vertices[[vertex]], radius_mm), 0.0, GAP_MM, 0.0)
