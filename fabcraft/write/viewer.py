"""The meshes as the page's 3D view wants them: decimated copies, quantised, in base64.

Positions are unsigned 16-bit steps of the mesh's box (2 µm steps on a 130 mm mask), normals signed 8-bit,
map values 8-bit steps of the map's range with 255 for "not measured", faces unsigned 32-bit; all
little-endian.
"""

import base64
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Float64, Int64
from scipy.spatial import cKDTree

from fabcraft.mesh import Mesh
from fabcraft.write.colours import (
    BODY,
    OBJECT,
    Colour,
    distance_colours,
    rounded_up,
    share,
    thickness_colours,
    to_bytes,
)
from fabcraft.write.normals import split_at_creases

OBJECT_FACES = 60_000
"""Faces of the object in the view; more are decimated."""
BODY_FACES = 30_000
"""Faces of the body in the view."""
_STEPS = 254


def scene_data(
    object: Mesh,
    body: Mesh | None = None,
    thickness: Float[np.ndarray, " V"] | None = None,
    clearance: Float[np.ndarray, " V"] | None = None,
    wall_mm: float | None = None,
) -> dict:
    """What the viewer reads: meshes, maps and where to look; see `fabcraft.write.page.write_page`."""
    maps, values = {}, {}
    if thickness is not None:
        high = 2.0 * wall_mm if wall_mm else rounded_up(share(thickness, 95.0))
        ticks = ["0", f"{high / 2:.3g}" + (" (wall)" if wall_mm else ""), f"{high:.3g}+"]
        ramp = thickness_colours(np.linspace(0.0, high, _STEPS + 1), 0.0, high)
        maps["wall"] = {
            "title": "Wall thickness, mm",
            "ticks": ticks,
            "ramp": _text(to_bytes(ramp).tobytes()),
        }
        values["wall"] = (thickness, 0.0, high)
    if clearance is not None:
        limit = rounded_up(share(np.abs(clearance), 95.0))
        ticks = [f"−{limit:.3g} inside", "0", f"+{limit:.3g} outside"]
        ramp = distance_colours(np.linspace(-limit, limit, _STEPS + 1), limit)
        maps["fit"] = {
            "title": "Distance to the body, mm",
            "ticks": ticks,
            "ramp": _text(to_bytes(ramp).tobytes()),
        }
        values["fit"] = (clearance, -limit, limit)
    meshes = [_packed(object, "object", OBJECT_FACES, OBJECT, 0.35, values)]
    if body is not None and len(body.faces):
        meshes.append(_packed(body, "body", BODY_FACES, BODY, 0.15, {}))
    return {"meshes": meshes, "maps": maps, "focus": _focus(object, body)}


def decimated(mesh: Mesh, faces: int) -> Mesh:
    """A copy for the eye with at most about `faces` faces; closedness is not promised."""
    if len(mesh.faces) <= faces:
        return mesh
    import fast_simplification  # only pages of large meshes need it

    # Copies: it refuses read-only arrays.
    points, triangles = fast_simplification.simplify(
        np.array(mesh.vertices), np.array(mesh.faces), target_count=faces
    )
    return Mesh(points.astype(np.float64), triangles.astype(np.int32), mesh.name)


def _packed(
    mesh: Mesh,
    role: str,
    faces: int,
    colour: Colour,
    gloss: float,
    values: Mapping[str, tuple[np.ndarray, float, float]],
) -> dict:
    """One mesh, quantised; `values`: per vertex of `mesh`, with the ends of its scale."""
    view = decimated(mesh, faces)
    source, triangles, normals = split_at_creases(view)
    nearest = np.arange(len(mesh.vertices))
    if view is not mesh:
        nearest = _counterparts(view, mesh)
    lower, upper = view.bounds
    span = np.maximum(upper - lower, 1e-9)
    # four components each, because a graphics card wants rows of a multiple of four bytes
    positions = np.zeros((len(source), 4), "<u2")
    positions[:, :3] = np.round((view.vertices[source] - lower) / span * 65535)
    directions = np.zeros((len(source), 4), "i1")
    directions[:, :3] = np.round(normals * 127)
    return {
        "role": role,
        "low": lower.tolist(),
        "span": span.tolist(),
        "colour": list(colour),
        "gloss": gloss,
        "count": 3 * len(triangles),
        "positions": _text(positions.tobytes()),
        "normals": _text(directions.tobytes()),
        "faces": _text(triangles.astype("<u4").tobytes()),
        "values": {
            name: _text(_steps(array[nearest][source], low, high))
            for name, (array, low, high) in values.items()
        },
    }


def _counterparts(view: Mesh, mesh: Mesh) -> Int64[np.ndarray, " W"]:
    """For every vertex of `view` the nearest of `mesh` that faces the same way: a thin wall has two sides."""
    count = min(12, len(mesh.vertices))
    near = cKDTree(mesh.vertices).query(view.vertices, k=count)[1].reshape(len(view.vertices), count)
    agree = np.einsum("wkj,wj->wk", mesh.vertex_normals[near], view.vertex_normals) > 0.3
    first = np.where(agree.any(1), agree.argmax(1), 0)
    return near[np.arange(len(near)), first]


def _steps(values: Float[np.ndarray, " N"], low: float, high: float) -> bytes:
    """Values as 0 … 254 between the ends of the scale, 255 where not measured."""
    known = np.isfinite(values)
    place = np.clip((np.where(known, values, low) - low) / (high - low), 0.0, 1.0)
    return np.where(known, np.round(place * _STEPS), 255).astype("u1").tobytes()


def _focus(object: Mesh, body: Mesh | None) -> dict:
    """Where the camera looks: at the object alone, or at the object with enough of the body around it."""
    lower, upper = object.bounds
    centre, radius = (lower + upper) / 2, float(np.linalg.norm(upper - lower)) / 2
    both = object.vertices if body is None else np.concatenate([object.vertices, body.vertices])
    reach = float(np.linalg.norm(both - centre, axis=1).max())
    # A ring on a whole body would be a dot: never farther than 1.65 times the object.
    around = min(reach, 1.65 * radius)
    middle = (both.min(0) + both.max(0)) / 2
    pull = _pull(centre, middle, around, radius)
    return {
        "centre": centre.tolist(),
        "radius": radius,
        "centre_body": pull.tolist(),
        "radius_body": around,
        "reach": 2.0 * reach + radius,
    }


def _pull(
    centre: Float64[np.ndarray, "3"], middle: Float64[np.ndarray, "3"], around: float, radius: float
) -> Float64[np.ndarray, "3"]:
    """From the object's centre towards the scene's middle, as far as the object stays in the picture."""
    way = middle - centre
    length = float(np.linalg.norm(way))
    return centre + way * (min(1.0, max(around - radius, 0.0) / length) if length > 0 else 0.0)


def _text(data: bytes) -> str:
    """Base64."""
    return base64.b64encode(data).decode("ascii")
