"""Re-makes the contact sheet of the characters: each as it looks, and with its landmarks and contacts.

Run in the repository's root: python examples/make_characters.py (about a minute).  Dots are landmarks; green is skin
that something may rest on, amber what is kept clear of.
"""

from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from fabcraft.body.body import Body
from fabcraft.body.character import CHARACTERS, character
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.write.camera import View, camera_for
from fabcraft.write.picture import Item, png_bytes, scene_picture
from fabcraft.write.sheet import contact_sheet, labelled
from fabcraft.write.wearer import contact_colours, wearer_items

COLOURS = {
    "dinosaur": (0.55, 0.72, 0.50),
    "cow": (0.86, 0.82, 0.76),
    "dog": (0.80, 0.62, 0.43),
    "figure": (0.95, 0.78, 0.30),
    "bear": (0.62, 0.45, 0.33),
    "frog": (0.52, 0.74, 0.38),
}
VIEW = View(32.0, 12.0)
SIZE = (430, 430)
DOT = (178, 30, 40)


def portrait(body: Body) -> np.ndarray:
    """The character in its colour."""
    skin = np.tile(COLOURS[body.name], (len(body.mesh.vertices), 1))
    return scene_picture(wearer_items(body, skin), VIEW, SIZE)


def chart(body: Body) -> np.ndarray:
    """Its contacts in colour, and a dot at every landmark that can be seen."""
    resting = [name for name, region in body.regions.items() if region.weight > 0.0]
    item = Item(body.mesh, vertex_colours=contact_colours(body, resting), gloss=0.1)
    image = Image.fromarray(scene_picture([item], VIEW, SIZE))
    draw, camera = ImageDraw.Draw(image), camera_for(VIEW, body.mesh.vertices, SIZE)
    points = np.stack([point for name, point in body.landmarks.items() if not name.startswith("eye")])
    faces = SurfaceDistance(body.mesh).closest(points).faces
    towards = body.mesh.face_normals[faces] @ VIEW.axes[2] > 0.0
    for x, y in camera.project(points[towards])[:, :2]:
        draw.ellipse((x - 2.5, y - 2.5, x + 2.5, y + 2.5), fill=DOT, outline=(255, 255, 255))
    return np.asarray(image)


def main() -> None:
    """Write examples/pictures/characters.png."""
    cells = []
    for name, model in CHARACTERS.items():
        body = character(name)
        pair = contact_sheet([portrait(body), chart(body)], columns=2, gap=0)
        cannot = (
            f"; cannot wear {', '.join(model.unwearable)}" if model.unwearable else "; can wear everything"
        )
        cells.append(labelled(pair, f"{name}, {model.height_mm:g} mm{cannot}", height=30))
    sheet = contact_sheet(cells, columns=2)
    path = Path(__file__).parent / "pictures" / "characters.png"
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(png_bytes(sheet))


if __name__ == "__main__":
    main()
