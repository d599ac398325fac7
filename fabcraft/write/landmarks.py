"""Pictures of a head: what fills them, and its landmarks with their names."""

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from fabcraft.body.body import Body
from fabcraft.mesh import Mesh
from fabcraft.write.camera import VIEWS, camera_for
from fabcraft.write.colours import BODY
from fabcraft.write.picture import Item, scene_picture
from fabcraft.write.sheet import contact_sheet

BELOW_CHIN_MM = 40.0
"""How much neck is in a picture of the head."""


def head_frame(body: Body, object: Mesh | None = None) -> Mesh:
    """Points that fill a picture of the head: everything above the upper neck, and the object."""
    points = body.mesh.vertices[body.mesh.vertices[:, 2] > body.landmarks["menton"][2] - BELOW_CHIN_MM * body.scale]
    if object is not None:
        points = np.concatenate([points, object.vertices])
    return Mesh(points, np.zeros((0, 3), dtype=np.int32))


def body_picture(body: Body) -> np.ndarray:
    """The head from the front and from its left, with a dot and a name at every landmark."""
    return contact_sheet([_marked(body, view) for view in ("front", "side")], columns=2)


def _marked(body: Body, name: str) -> np.ndarray:
    """One view of the head; landmarks on its far side are left out."""
    head, size, view = head_frame(body), (1150, 1000), VIEWS[name]
    image = Image.fromarray(scene_picture([Item(body.mesh, BODY, gloss=0.15)], view, size, frame_on=head))
    towards = head.vertices @ view.axes[2]
    far = 0.5 * (towards.min() + towards.max()) - 0.1 * np.ptp(towards)
    near = {name: point for name, point in body.landmarks.items() if point @ view.axes[2] > far}
    camera = camera_for(view, body.mesh.vertices[np.unique(body.mesh.faces)], size, head)
    seen = camera.project(np.stack(list(near.values())))[:, :2]
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(16)
    rows = {True: 0.0, False: 0.0}
    for index in np.argsort(seen[:, 1], kind="stable"):
        label, (x, y) = list(near)[index], seen[index]
        right = bool(x >= size[0] / 2)
        row = rows[right] = max(float(y), rows[right] + 20.0)  # labels of near landmarks give way downwards
        edge = size[0] - 12.0 if right else 12.0
        start = edge - draw.textlength(label, font) - 8 if right else edge + draw.textlength(label, font) + 8
        draw.line([(x, y), (start, row)], fill=(128, 134, 142), width=1)
        draw.text((edge, row), label, (38, 42, 48), font, anchor="rm" if right else "lm")
        draw.ellipse((x - 4, y - 4, x + 4, y + 4), fill=(190, 38, 42), outline=(255, 255, 255))
    return np.asarray(image)
