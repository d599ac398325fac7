"""Pictures that measure: colours over the surface with a bar in millimetres, and a design's history in a
strip."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Float64, UInt8

from fabcraft.mesh import Mesh
from fabcraft.write.camera import VIEWS, View
from fabcraft.write.colours import (
    BODY,
    OBJECT,
    Colour,
    distance_colours,
    rounded_up,
    share,
    thickness_colours,
)
from fabcraft.write.picture import Item, scene_picture
from fabcraft.write.sheet import contact_sheet, with_colour_bar

_GLOSS = 0.08
"""A highlight would hide the colour under it."""


def penetration_map(
    mesh: Mesh,
    signed_mm: Float[np.ndarray, " V"],
    view: View = VIEWS["front"],
    size: tuple[int, int] = (900, 900),
    *,
    limit_mm: float | None = None,
) -> UInt8[np.ndarray, "H W 3"]:
    """`mesh` coloured by its signed distance to the body, mm: blue outside, white touching, red inside.

    signed_mm : (V,), positive outside.  limit_mm : where the colours end; a round number over 95 % of them
    when None. The picture is wider than `size` by the colour bar.
    """
    limit = rounded_up(share(np.abs(signed_mm), 95.0)) if limit_mm is None else limit_mm
    picture = _coloured_picture(mesh, distance_colours(signed_mm, limit), view, size)
    bar = distance_colours(np.linspace(-limit, limit, 256), limit)
    ticks = [(0.5 + 0.5 * part, f"{part * limit:+.3g}") for part in (-1.0, -0.5, 0.5, 1.0)]
    return with_colour_bar(picture, bar, [*ticks, (0.5, "0")], "to body, mm")


def thickness_map(
    mesh: Mesh,
    thickness_mm: Float[np.ndarray, " V"],
    wall_mm: float,
    view: View = VIEWS["front"],
    size: tuple[int, int] = (900, 900),
) -> UInt8[np.ndarray, "H W 3"]:
    """`mesh` coloured by its wall, mm, from 0 to twice `wall_mm`: red under it, green and blue over it."""
    high = 2.0 * wall_mm
    picture = _coloured_picture(mesh, thickness_colours(thickness_mm, 0.0, high), view, size)
    bar = thickness_colours(np.linspace(0.0, high, 256), 0.0, high)
    ticks = [(0.0, "0"), (0.5, f"{wall_mm:.3g} wall"), (1.0, f"{high:.3g}+")]
    return with_colour_bar(picture, bar, ticks, "wall, mm")


def evolution_strip(
    steps: Sequence[Mesh] | Sequence[UInt8[np.ndarray, "_ _ 3"]],
    labels: Sequence[str],
    *,
    body: Mesh | None = None,
    view: View = VIEWS["three_quarter"],
    size: tuple[int, int] = (360, 360),
    colour: Colour = OBJECT,
) -> UInt8[np.ndarray, "H W 3"]:
    """A design's history from left to right, all seen from the same place; meshes are drawn, pictures taken
    as they are."""
    meshes = [step for step in steps if isinstance(step, Mesh)]
    everything = np.concatenate([mesh.vertices for mesh in meshes]) if meshes else np.zeros((0, 3))
    frame = Mesh(everything, np.zeros((0, 3), dtype=np.int32)) if meshes else None
    wearer = [] if body is None else [Item(body, BODY, gloss=0.15)]
    pictures = [
        scene_picture([*wearer, Item(step, colour)], view, size, frame_on=frame)
        if isinstance(step, Mesh)
        else step
        for step in steps
    ]
    return contact_sheet(pictures, labels, columns=max(len(pictures), 1))


def _coloured_picture(
    mesh: Mesh, colours: Float64[np.ndarray, "V 3"], view: View, size: tuple[int, int]
) -> UInt8[np.ndarray, "H W 3"]:
    """The mesh with its own colours, lit without cast shadows so that they stay readable."""
    return scene_picture([Item(mesh, vertex_colours=colours, gloss=_GLOSS)], view, size, shadows=False)
