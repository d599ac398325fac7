"""Pictures of a body: every part it has from two sides, with its landmarks, regions and measured lines."""

import colorsys
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float64, UInt8
from PIL import Image, ImageDraw, ImageFont

from fabcraft.body.body import Body
from fabcraft.body.measures import MEASURES, sided, tapes
from fabcraft.body.tape import Tape
from fabcraft.errors import InputError
from fabcraft.mesh import Mesh
from fabcraft.write.camera import VIEWS, Camera, View, camera_for
from fabcraft.write.colours import BODY
from fabcraft.write.picture import Item, scene_picture
from fabcraft.write.sheet import INK, PAPER, contact_sheet

SIZE = (820, 710)
_CLOSE = (560, 560)
_PANELS = (("bust", "head"), ("hand_left", "hand_right"), ("foot_left", "foot_right"))
"""Of each group the first part that the body has is shown."""
_DOT, _LINE, _LEADER = (190, 38, 42), (20, 60, 150), (128, 134, 142)


def body_picture(body: Body) -> UInt8[np.ndarray, "H W 3"]:
    """Head, hand and foot of `body`, as far as it has them, or all of it: two views each; a character also as a whole."""
    lines = tapes(body)
    parts = [part for group in _PANELS if (part := _first(body, group)) is not None] or [body]
    if body.kind == "character":
        parts = [body, *parts]
    views = [_marked(part, view, lines) for part in parts for view in _views(part)]
    return contact_sheet(views, columns=2)


def beside_body(body: Body, mesh: Mesh) -> UInt8[np.ndarray, "H W 3"]:
    """How `mesh` lies on `body`: from the front, from the left and from between, as large as the mesh."""
    items = [Item(body.mesh, BODY, gloss=0.1), Item(mesh)]
    views = [VIEWS["front"], VIEWS["side"], VIEWS["three_quarter"]]
    return contact_sheet([scene_picture(items, view, _CLOSE, frame_on=mesh) for view in views], columns=3)


def _first(body: Body, names: tuple[str, ...]) -> Body | None:
    for name in names:
        try:
            return body.part(name)
        except InputError:  # it has no such part
            continue
    return None


def _views(part: Body) -> tuple[View, View]:
    """Front and left; of a hand its back and its palm; of a foot its outer side and its sole."""
    if "sellion" in part.landmarks:
        return VIEWS["front"], VIEWS["side"]
    for side in ("left", "right"):
        if {f"wrist_back_{side}", f"wrist_palm_{side}"} <= part.landmarks.keys():
            back = part.landmarks[f"wrist_back_{side}"] - part.landmarks[f"wrist_palm_{side}"]
            return _towards(back), _towards(-back)
        if f"instep_{side}" in part.landmarks:
            return View(60.0 if side == "left" else -60.0, 15.0), View(0.0, -88.0)
    return VIEWS["front"], VIEWS["side"]


def _towards(direction: Float64[np.ndarray, "3"]) -> View:
    """The view from where `direction` points."""
    x, y, z = direction / np.linalg.norm(direction)
    return View(float(np.degrees(np.arctan2(x, -y))), float(np.degrees(np.arcsin(z))))


def _marked(part: Body, view: View, lines: Mapping[str, Tape]) -> UInt8[np.ndarray, "H W 3"]:
    """One view; what lies on the far side is left out."""
    palette = _palette(part)
    items = [Item(part.mesh, vertex_colours=_painted(part, palette), gloss=0.1)]
    image = Image.fromarray(scene_picture(items, view, SIZE, shadows=False))
    camera = camera_for(view, part.mesh.vertices, SIZE)
    draw = ImageDraw.Draw(image)
    texts = [_drawn(draw, camera, view, name, tape) for name, tape in _of_part(part, lines)]
    near = _near(part, view)
    labels = [(name, point, _DOT) for name, point in near.items()]
    labels += [(text, middle, _LINE) for text, middle in texts]
    _labelled(draw, camera, labels)
    return np.concatenate([np.asarray(image), _legend(palette)])


def _palette(part: Body) -> dict[str, tuple[float, float, float]]:
    """A colour for every region; both of a pair alike."""
    names = sorted({name.removesuffix("_left").removesuffix("_right") for name in part.regions})
    return {name: colorsys.hsv_to_rgb(0.381 * index % 1.0, 0.62, 0.86) for index, name in enumerate(names)}


def _painted(part: Body, palette: Mapping[str, tuple[float, float, float]]) -> Float64[np.ndarray, "V 3"]:
    """Skin with the regions in their colours, as strong as their emphasis."""
    colours = np.tile(np.array(BODY), (len(part.mesh.vertices), 1))
    for name, region in part.regions.items():
        colour = np.array(palette[name.removesuffix("_left").removesuffix("_right")])
        strength = region.emphasis[:, None]
        rows = region.vertex_indices
        colours[rows] = strength * colour + (1.0 - strength) * colours[rows]
    return colours


def _of_part(part: Body, lines: Mapping[str, Tape]) -> list[tuple[str, Tape]]:
    """The measured lines that lie on the part."""
    lower, upper = part.mesh.bounds
    return [
        (name, tape)
        for name, tape in lines.items()
        if MEASURES[sided(name)[0]].part
        and (tape.points >= lower - 1.0).all()
        and (tape.points <= upper + 1.0).all()
    ]


def _drawn(
    draw: ImageDraw.ImageDraw, camera: Camera, view: View, name: str, tape: Tape
) -> tuple[str, Float64[np.ndarray, "3"]]:
    """Draws the line, its far side thin; returns its text and where that belongs."""
    line = np.concatenate([tape.points, tape.points[:1]]) if tape.closed else tape.points
    seen = camera.project(line)[:, :2]
    depth = (line - line.mean(0)) @ view.axes[2]
    for start, end, ahead in zip(seen[:-1], seen[1:], depth[:-1] + depth[1:], strict=True):
        draw.line([tuple(start), tuple(end)], fill=_LINE, width=1 if tape.closed and ahead < -1e-9 else 3)
    return f"{name.replace('_', ' ')} {tape.length_mm:.1f} mm", line[int(np.argmax(depth))]


def _near(part: Body, view: View) -> dict[str, Float64[np.ndarray, "3"]]:
    """The landmarks on the near side."""
    towards = part.mesh.vertices @ view.axes[2]
    far = 0.5 * (towards.min() + towards.max()) - 0.1 * np.ptp(towards)
    return {name: point for name, point in part.landmarks.items() if point @ view.axes[2] > far}


def _labelled(
    draw: ImageDraw.ImageDraw,
    camera: Camera,
    labels: list[tuple[str, Float64[np.ndarray, "3"], tuple[int, int, int]]],
) -> None:
    """Names at the nearer border of the picture, led to their places; near ones give way downwards."""
    if not labels:
        return
    font = ImageFont.load_default(14)
    seen = camera.project(np.stack([point for _, point, _ in labels]))[:, :2]
    rows = {True: 0.0, False: 0.0}
    for index in np.argsort(seen[:, 1], kind="stable"):
        (text, _, colour), (x, y) = labels[index], seen[index]
        right = bool(x >= SIZE[0] / 2)
        row = rows[right] = max(float(y), rows[right] + 17.0)
        edge = SIZE[0] - 12.0 if right else 12.0
        width = draw.textlength(text, font) + 8
        draw.line([(x, y), (edge - width if right else edge + width, row)], fill=_LEADER, width=1)
        ink, anchor = INK if colour == _DOT else _LINE, "rm" if right else "lm"
        draw.text((edge, row), text, ink, font, anchor=anchor, stroke_width=2, stroke_fill=PAPER)
        draw.ellipse((x - 4, y - 4, x + 4, y + 4), fill=colour, outline=(255, 255, 255))


def _legend(palette: Mapping[str, tuple[float, float, float]]) -> UInt8[np.ndarray, "H W 3"]:
    """A strip with the name of every region in its colour."""
    font = ImageFont.load_default(14)
    strip = Image.new("RGB", (SIZE[0], 62), PAPER)
    draw, x, y = ImageDraw.Draw(strip), 12.0, 12.0
    for name, colour in palette.items():
        text = name.replace("_", " ")
        width = draw.textlength(text, font) + 40
        if x + width > SIZE[0]:
            x, y = 12.0, y + 20.0
        draw.rectangle((x, y - 7, x + 14, y + 7), fill=tuple(round(255 * channel) for channel in colour))
        draw.text((x + 20, y), text, INK, font, anchor="lm")
        x += width
    return np.asarray(strip)
