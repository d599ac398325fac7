"""Re-makes the pictures of the README: every example drawing as a mask on somebody's face.

Run in the repository's root: python examples/make_gallery.py (about five minutes).
"""

import os

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # before torch is imported

from pathlib import Path

import numpy as np
from PIL import Image

import fabcraft
from fabcraft.mesh import Mesh
from fabcraft.write.camera import VIEWS
from fabcraft.write.maps import evolution_strip
from fabcraft.write.picture import Item, png_bytes, scene_picture
from fabcraft.write.sheet import contact_sheet

HERE = Path(__file__).parent
WEARERS = {
    "cat-mask": "man",
    "bunny": "child",
    "owl": "woman",
    "crown": "woman",
    "butterfly": "woman",
    "fox": "child",
}
COLOURS = {
    "cat-mask": (0.16, 0.44, 0.70),
    "bunny": (0.86, 0.55, 0.62),
    "owl": (0.55, 0.40, 0.28),
    "crown": (0.80, 0.60, 0.20),
    "butterfly": (0.46, 0.33, 0.66),
    "fox": (0.84, 0.42, 0.16),
}
SKIN = (0.84, 0.74, 0.66)
SIZE = (420, 480)


def on_the_body(made: "fabcraft.Made", colour: tuple[float, float, float], view: str) -> np.ndarray:
    """The mask on its wearer, framed on the head."""
    head = made.template.body
    above = head.mesh.vertices[:, 2] > head.landmarks["menton"][2] - 40.0
    points = np.vstack([head.mesh.vertices[above], made.object.vertices])
    frame = Mesh(points, np.zeros((0, 3), dtype=np.int32))
    items = [Item(head.mesh, SKIN, gloss=0.15), Item(made.object, colour)]
    return scene_picture(items, VIEWS[view], SIZE, frame_on=frame, supersample=3)


def main() -> None:
    """Write examples/pictures/*.png."""
    folder = HERE / "pictures"
    folder.mkdir(exist_ok=True)
    shown, labels = [], []
    for name, wearer in WEARERS.items():
        made = fabcraft.make(
            fabcraft.Recipe(sketch=str(HERE / f"{name}.png"), body=wearer, preset="standard")
        )
        drawing = Image.open(HERE / f"{name}.png").convert("RGB")
        drawing.thumbnail(SIZE)
        page = Image.new("RGB", SIZE, "white")
        page.paste(drawing, ((SIZE[0] - drawing.width) // 2, (SIZE[1] - drawing.height) // 2))
        shown += [np.asarray(page), on_the_body(made, COLOURS[name], "three_quarter")]
        overlap = made.report.metrics["silhouette_iou"]
        labels += [f"{name}.png", f"on a {wearer}, overlap {overlap:.3f}"]
        if name == "cat-mask":
            views = [on_the_body(made, COLOURS[name], view) for view in ("front", "three_quarter", "side")]
            inside = scene_picture([Item(made.object, COLOURS[name])], VIEWS["back"], SIZE, supersample=3)
            sheet = contact_sheet([*views, inside], ["front", "three quarters", "side", "inside"], columns=4)
            (folder / "cat-mask.png").write_bytes(png_bytes(sheet))
            stages = [*made.stages, ("printed object", made.object)]
            strip = evolution_strip(
                [mesh for _, mesh in stages],
                [label for label, _ in stages],
                size=(300, 340),
                colour=COLOURS[name],
            )
            (folder / "evolution.png").write_bytes(png_bytes(strip))
    (folder / "gallery.png").write_bytes(png_bytes(contact_sheet(shown, labels, columns=4)))


if __name__ == "__main__":
    main()
