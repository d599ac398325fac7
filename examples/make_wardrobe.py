"""Re-makes the pictures of all templates: plain on every body, with a star, and drawn as a whole.

Run in the repository's root: python examples/make_wardrobe.py (about twenty minutes).
"""

import os

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # before torch is imported

from pathlib import Path

import numpy as np
from PIL import Image

import fabcraft
from fabcraft.errors import InputError
from fabcraft.fitting_room import try_on
from fabcraft.template.kinds import NAMES, SOLIDS
from fabcraft.wearer import CHARACTERS, PRESETS, find_body
from fabcraft.write.camera import View
from fabcraft.write.picture import png_bytes
from fabcraft.write.sheet import contact_sheet
from fabcraft.write.wardrobe import wardrobe_picture, worn_picture

HERE = Path(__file__).parent
BODIES = (*PRESETS, *CHARACTERS)
SIZE = (420, 420)
VIEWS = {"slippers": View(35.0, 35.0), "helmet": View(40.0, 15.0)}
"""Where the usual view hides what was drawn."""


def plain() -> np.ndarray:
    """Every template on every body."""
    columns = []
    for body in map(find_body, BODIES):
        column = []
        for name in NAMES:
            try:
                tried = try_on(name, body)
            except InputError as error:
                column.append(error.message)
            else:
                column.append((tried.template, tried.object))
        columns.append(column)
    picture = Image.fromarray(wardrobe_picture(NAMES, BODIES, columns))
    return np.asarray(picture.reduce(2))


def drawn(reading: str) -> np.ndarray:
    """A drawing beside what became of it, for every solid template."""
    cells, labels = [], []
    for name in SOLIDS:
        sketch = HERE / "objects" / f"{'star' if reading == 'motif' else name}.png"
        recipe = fabcraft.Recipe(template=name, sketch=str(sketch), reading=reading, preset="standard")
        made = fabcraft.make(recipe)
        if reading == "object":
            cells.append(page(sketch))
            labels.append(f"objects/{sketch.name}")
        view = VIEWS.get(name) if reading == "object" else None
        cells.append(worn_picture(made.template, made.object, view, SIZE))
        labels.append(f"{name}, overlap {made.report.metrics['silhouette_iou']:.3f}")
    return contact_sheet(cells, labels, columns=4)


def page(sketch: Path) -> np.ndarray:
    """The drawing on a page of the cells' size."""
    drawing = Image.open(sketch).convert("RGB")
    drawing.thumbnail((SIZE[0] - 20, SIZE[1] - 20))
    paper = Image.new("RGB", SIZE, "white")
    paper.paste(drawing, ((SIZE[0] - drawing.width) // 2, (SIZE[1] - drawing.height) // 2))
    return np.asarray(paper)


def main() -> None:
    """Write examples/pictures/wardrobe.png, stars.png and objects.png."""
    folder = HERE / "pictures"
    folder.mkdir(exist_ok=True)
    (folder / "wardrobe.png").write_bytes(png_bytes(plain()))
    (folder / "stars.png").write_bytes(png_bytes(drawn("motif")))
    (folder / "objects.png").write_bytes(png_bytes(drawn("object")))


if __name__ == "__main__":
    main()
