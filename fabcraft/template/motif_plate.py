"""The plate: the sheet that carries a motif on a solid template, in the picture space of one of its motif frames.

It is to a ring what a mask is to a face: the smoothest sheet over the template's own surface, going on evenly beyond it
where the motif is wider, and kept off the body. Lengths are in picture units; `SIZE` of them are the motif's longer side.
"""

import numpy as np

from fabcraft.body.body import Body
from fabcraft.errors import InputError
from fabcraft.geometry.heights import front_heights, lifted_over, smoothest_over
from fabcraft.geometry.plane import Plane
from fabcraft.geometry.triangulate import triangulate
from fabcraft.mesh import Mesh
from fabcraft.template.picture_space import PictureSpace
from fabcraft.template.template import FrontSurface, MotifFrame, Template

SIZE = 120.0
"""Picture units of the longer side of a motif: about a face in mm, which the drawing's rules are made for."""
THICKNESS = 4.5
"""Of the plate, in picture units: also twice the radius of its rims, and what an arm of a star must exceed."""
EDGE = 2.6
_RIMS = 2.2
"""How much larger an object is worked on whose rims are narrow: glasses."""
_RIM_ROUNDNESS = 0.7
_OVER_MM = 1.0
"""How far the front of a drawn object that follows the surface stands out of it."""
_DEEP, _PROUD_MM = 30.0, 6.0
"""What lies farther behind (picture units) or before (mm on a person) the frame is another part of the object: a necklace
behind its pendant, a brim under a band."""


def plate(
    template: Template, frame: MotifFrame, size_mm: float | None = None, aspect: float | None = None
) -> tuple[Template, PictureSpace]:
    """The sheet for a motif in `frame`, and the space it lives in.

    size_mm : longer side of the motif; as large as the frame has room for when None.  aspect : its width over its height;
    the frame's own when None.  Raises `InputError` for a motif that has no room there.
    """
    shape = np.array(frame.size_mm) if aspect is None else np.array([aspect, 1.0])
    shape = shape / shape.max()
    fitting, room = (float((np.array(side) / shape).min()) for side in (frame.size_mm, _room(frame)))
    wanted = fitting if size_mm is None else size_mm
    if not 0.2 * fitting <= wanted <= room:
        raise InputError(
            f"a motif of {wanted:g} mm was asked for the {frame.name} of the {template.name}",
            f"Choose {0.2 * fitting:.0f} to {room:.0f} mm.",
        )
    size = SIZE if len(frame.openings) < 2 or not frame.depth_mm else _RIMS * SIZE
    space = PictureSpace(frame, size / wanted)
    half = 0.5 * size * shape
    carrier = space.seen(template.mesh)
    if frame.depth_mm and not frame.follows:
        front = _even(half)
    else:
        above = space.scale * _OVER_MM if frame.depth_mm else THICKNESS
        front = _front(carrier, half, above - 0.5 * THICKNESS, space.scale * _PROUD_MM * template.scale)
    openings = [space.scale * opening for opening in frame.openings] if frame.depth_mm else []
    flat = triangulate([_outline(half), *openings], EDGE)
    sheet = Mesh(
        np.column_stack([flat.points[:, 0], -front.base_at(flat.points), flat.points[:, 1]]),
        flat.faces,
        "plate",
    )
    behind = Body(f"{template.name} {frame.name}", carrier, {}, {}, template.body.kind)
    rims = tuple(loop.astype(np.int32) for loop in flat.loops)
    name = f"{template.name} {frame.name}"
    return Template(name, behind, sheet, rims, front, THICKNESS, len(openings), (), EDGE), space


def _room(frame: MotifFrame) -> tuple[float, float]:
    """The largest box that a motif may fill, mm."""
    width, height = frame.size_mm
    return width + 2.0 * frame.reach_mm, height + 2.0 * frame.reach_mm


def _outline(half: np.ndarray) -> np.ndarray:
    """A superellipse of the frame's proportions."""
    angle = np.linspace(0.0, 2.0 * np.pi, 480, endpoint=False)
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.column_stack(
        [
            half[0] * np.sign(cosine) * np.abs(cosine) ** _RIM_ROUNDNESS,
            half[1] * np.sign(sine) * np.abs(sine) ** _RIM_ROUNDNESS,
        ]
    )


def _even(half: np.ndarray) -> FrontSurface:
    """An even sheet whose outer side lies in the picture, with nothing behind it."""
    plane = _grid(half)
    empty = np.zeros(plane.centres()[0].shape)
    nothing = np.full_like(empty, -np.inf)
    base = np.full_like(empty, -0.5 * THICKNESS)
    return FrontSurface(plane, nothing, nothing, base, empty, empty, np.zeros(empty.shape, dtype=bool))


def _grid(half: np.ndarray) -> Plane:
    """Twice as wide as the drawing: ears and rays may leave the frame."""
    reach = 2.0 * half.max()
    return Plane(-reach, reach, 2.0, int(reach), int(reach))


def _front(carrier: Mesh, half: np.ndarray, above: float, proud: float) -> FrontSurface:
    """The height fields over the carrier's surface, `above` which the middle of the plate's wall lies at least."""
    plane = _grid(half)
    skin = front_heights(carrier, plane)
    # what stands out far before the frame (a brim under a band) is no more its ground than what lies far behind
    near = np.isfinite(skin) & (skin > -_DEEP) & (skin < proud)
    if not near.any():
        raise InputError("there is nothing of the template behind this motif frame", "Choose another frame.")
    x, z = plane.centres()
    inside = (np.abs(x) < half[0]) & (np.abs(z) < half[1])
    floor = np.where(near, skin + above, -np.inf)
    wanted = np.where(near, floor, above)
    pull = np.where(near & inside, 0.5, 0.02)
    sheet = smoothest_over(floor, wanted, pull, plane.pixel_mm, 14.0, 60.0)
    base = lifted_over(sheet, floor, plane.pixel_mm, 4.0)
    empty = np.zeros(plane.centres()[0].shape)
    return FrontSurface(plane, skin, floor, base, empty, empty, near & inside)
