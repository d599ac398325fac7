"""Templates as they are worn, many in one picture: a row for every kind, a column for every body."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont

from fabcraft.mesh import Mesh
from fabcraft.template.template import Template
from fabcraft.write.camera import VIEWS, View, views_towards
from fabcraft.write.landmarks import head_frame
from fabcraft.write.picture import Item, scene_picture
from fabcraft.write.sheet import INK, PAPER, contact_sheet
from fabcraft.write.wearer import wearer_items

SIZE = (330, 330)


def wardrobe_picture(
    names: Sequence[str], bodies: Sequence[str], worn: Sequence[Sequence[tuple[Template, Mesh] | str]]
) -> UInt8[np.ndarray, "H W 3"]:
    """All of `worn`, by body and then by name; where there is a string instead, it is the reason why there is nothing."""
    cells, labels = [], []
    for row, name in enumerate(names):
        for column, body in enumerate(bodies):
            one = worn[column][row]
            cells.append(reason_cell(one) if isinstance(one, str) else worn_picture(*one))
            labels.append(f"{name}, {body}")
    return contact_sheet(cells, labels, columns=len(bodies))


def worn_picture(
    template: Template, object: Mesh, view: View | None = None, size: tuple[int, int] = SIZE
) -> UInt8[np.ndarray, "H W 3"]:
    """The object on the part that wears it, from where its motif faces, a little from the side."""
    seen = views_towards(template.motifs[0].outward) if template.motifs else VIEWS
    items = [*wearer_items(template.body), Item(object)]
    frame = head_frame(template.body, object)
    return scene_picture(items, view or seen["three_quarter"], size, frame_on=frame)


def reason_cell(text: str, size: tuple[int, int] = SIZE) -> UInt8[np.ndarray, "H W 3"]:
    """An empty cell with the reason in it."""
    cell = Image.new("RGB", size, PAPER)
    draw, font = ImageDraw.Draw(cell), ImageFont.load_default(14)
    lines, line = [], ""
    for word in text.split():
        if line and font.getlength(f"{line} {word}") > size[0] - 40:
            lines.append(line)
            line = word
        else:
            line = f"{line} {word}".strip()
    middle = (size[0] / 2, size[1] / 2)
    draw.multiline_text(middle, "\n".join([*lines, line]), INK, font, anchor="mm", align="center")
    return np.asarray(cell)
