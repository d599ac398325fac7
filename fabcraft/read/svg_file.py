"""An SVG file becomes an (H, W, 4) array, its longer side 1200 px, what is not drawn on transparent.

The drawing is copied into a clean document first: only shapes, groups, clips, masks, gradients and style sheets go
across, and only references to the document itself.  So what the renderer (resvg) sees has no entity, script, font, file
or address in it, and is bounded: 8 MB, 64 levels, 20,000 elements after every `use` is followed.
"""

import io
import math
import re
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np
from jaxtyping import UInt8

from fabcraft.errors import InputError

SIDE = 1200
MOST_BYTES = 8_000_000
MOST_ELEMENTS = 20_000
MOST_DEPTH = 64
MOST_ASPECT = 30.0
SVG = "http://www.w3.org/2000/svg"
HREFS = ("href", "{http://www.w3.org/1999/xlink}href")
KNOWN = frozenset(
    [
        "svg",
        "g",
        "a",
        "defs",
        "symbol",
        "use",
        "path",
        "circle",
        "ellipse",
        "rect",
        "line",
        "polyline",
        "polygon",
        "style",
        "clipPath",
        "mask",
        "linearGradient",
        "radialGradient",
        "stop",
        "switch",
    ]
)
SILENT = frozenset(
    ["title", "desc", "metadata", "view", "cursor", "animate", "animateTransform", "animateMotion", "set"]
)
"""Draws nothing."""
REFUSED = {
    "text": "Turn the text into paths and save again.",
    "image": "Save the picture inside it as PNG or JPEG and give that.",
    "script": "Save it as plain SVG, or export it as PNG.",
}
AS_PNG = "Export it as PNG, or save it as plain SVG of shapes and paths."
# in px; a share of the window (%), em and ex have no size of their own
UNITS = {"": 1.0, "px": 1.0, "pt": 4 / 3, "pc": 16.0, "mm": 96 / 25.4, "cm": 96 / 2.54, "in": 96.0}


def is_svg(head: bytes) -> bool:
    """Whether a file that begins with `head` is XML text, as an SVG is."""
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    return text.startswith((b"<?xml", b"<svg", b"<!--", b"<!DOCTYPE svg")) or b"<svg" in text[:512]


def read_svg(path: Path) -> UInt8[np.ndarray, "H W 4"]:
    """(H, W, 4) uint8 RGBA, alpha not premultiplied.

    Raises `InputError` for what is no SVG, too large, or would need a font, a script or another file.
    """
    import resvg_py
    from PIL import Image

    root = _parsed(path)
    width, height = _size(root, path)
    clean = _clean(root, path)
    clean.attrib.update(width=str(width), height=str(height))
    try:
        png = resvg_py.svg_to_bytes(
            svg_string=ElementTree.tostring(clean, "unicode"),
            skip_system_fonts=True,
            width=width,
            height=height,
        )
    except ValueError as error:
        raise InputError(f"{path} cannot be drawn: {error}", AS_PNG) from error
    with Image.open(io.BytesIO(png), formats=["PNG"]) as image:
        return np.array(image.convert("RGBA"), dtype=np.uint8)


def _parsed(path: Path) -> ElementTree.Element:
    """The document's root; nothing outside the file is ever asked for, and no entity is declared."""
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise InputError(f"{path} has {size / 1e6:.0f} MB, more than the limit of 8 MB for an SVG", AS_PNG)
    builder = ElementTree.TreeBuilder()
    parser = expat.ParserCreate(namespace_separator="}")
    depth = count = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        if depth > MOST_DEPTH or count > MOST_ELEMENTS:
            raise InputError(
                f"{path} has more than {MOST_ELEMENTS:,} elements or {MOST_DEPTH} levels of groups", AS_PNG
            )
        builder.start(_qualified(tag), {_qualified(name): value for name, value in attributes.items()})

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(_qualified(tag))

    def refuse(*_: object) -> None:
        raise InputError(f"{path} declares entities of its own", "Save it as plain SVG, or export it as PNG.")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler, parser.EntityDeclHandler = builder.data, refuse
    try:
        parser.Parse(path.read_bytes(), True)
        root = builder.close()
    except (expat.ExpatError, ValueError, AssertionError) as error:
        raise InputError(f"{path} is damaged: {error}", "Save it again as plain SVG.") from error
    if _name(root) != "svg":
        raise InputError(
            f"{path} is XML, but its first element is no <svg>", "Name an SVG, PNG, JPEG or WebP file."
        )
    return root


def _qualified(name: str) -> str:
    return "{" + name if "}" in name else name


def _name(element: ElementTree.Element) -> str:
    """The SVG name of an element; empty for one of another vocabulary. A file may leave the namespace out."""
    space, _, name = element.tag.rpartition("}")
    return name if space in ("", "{" + SVG) else ""


def _size(root: ElementTree.Element, path: Path) -> tuple[int, int]:
    """Width and height to draw it at, px; a missing view box is added, so that it scales."""
    sides = [_length(root.get(name, "")) for name in ("width", "height")]
    box = re.split(r"[\s,]+", root.get("viewBox", "").strip())
    try:
        view = [float(v) for v in box] if len(box) == 4 else []
    except ValueError:
        view = []
    if len(view) != 4 or not all(map(math.isfinite, view)) or min(view[2:]) <= 0:
        if None in sides:
            raise InputError(
                f"{path} says neither its view box nor its width and height", "Save it as plain SVG."
            )
        root.set("viewBox", f"0 0 {sides[0]} {sides[1]}")
        view = [0.0, 0.0, *(s for s in sides if s is not None)]
    across, down = (v if s is None else s for s, v in zip(sides, view[2:], strict=True))
    if not 1 / MOST_ASPECT <= across / down <= MOST_ASPECT:
        raise InputError(
            f"{path} is {across:g} x {down:g}, far from a drawing's shape", "Crop it to the drawing."
        )
    scale = SIDE / max(across, down)
    return max(1, round(across * scale)), max(1, round(down * scale))


def _length(text: str) -> float | None:
    """Px of an absolute length; None for any other."""
    found = re.fullmatch(r"\s*([0-9.]+(?:[eE][+-]?\d+)?)\s*([a-z]*)\s*", text)
    if not found or found[2] not in UNITS:
        return None
    try:
        value = float(found[1]) * UNITS[found[2]]
    except ValueError:
        return None
    return value if 1e-6 < value < 1e9 else None


def _clean(root: ElementTree.Element, path: Path) -> ElementTree.Element:
    """A copy of what may be drawn, in the SVG namespace."""
    _require_few(root, path)

    def copied(element: ElementTree.Element) -> ElementTree.Element | None:
        name = _name(element)
        if not name or name in SILENT:
            return None
        if name not in KNOWN:
            step = REFUSED.get("text" if name in ("tspan", "textPath") else name, AS_PNG)
            raise InputError(f"{path} holds a <{name}>, which is not read from an SVG", step)
        kept = ElementTree.Element(name)
        for key, value in element.attrib.items():
            if key in HREFS:
                if not value.startswith("#"):
                    raise InputError(
                        f"{path} refers to {value[:60]!r}, outside itself",
                        "Embed it as shapes, or export it as PNG.",
                    )
                kept.set("href", value)
            elif "}" not in key and not key.startswith("on"):
                kept.set(key, _local(value, path))
        if name == "style":
            kept.text = _local("".join(element.itertext()), path)
        kept.extend([part for child in element if (part := copied(child)) is not None])
        return kept

    clean = copied(root)
    assert clean is not None  # the root is an <svg>
    clean.set("xmlns", SVG)
    return clean


def _local(text: str, path: Path) -> str:
    """Style or attribute text that names nothing outside the document."""
    if re.search(r"url\(\s*['\"]?\s*(?!['\"#\s])", text) or "@import" in text:
        raise InputError(
            f"{path} refers to a file or address in its style", "Save it as plain SVG, or export it as PNG."
        )
    return text


def _require_few(root: ElementTree.Element, path: Path) -> None:
    """Bounds how many elements there are once every `use` stands for what it points at."""
    named = {element.get("id"): element for element in root.iter() if element.get("id")}
    known: dict[int, int] = {}
    open_now: set[int] = set()

    def size(element: ElementTree.Element, depth: int) -> int:
        if id(element) in known:
            return known[id(element)]
        if id(element) in open_now or depth > 4 * MOST_DEPTH:
            raise InputError(f"{path} has a <use> that points at itself", "Save it as plain SVG.")
        open_now.add(id(element))
        total = 1 + sum(size(child, depth + 1) for child in element)
        for key in HREFS:
            if (target := named.get(element.get(key, "")[1:])) is not None:
                total += size(target, depth + 1)
        open_now.discard(id(element))
        if total > MOST_ELEMENTS:
            raise InputError(f"{path} unfolds into more than {MOST_ELEMENTS:,} elements", AS_PNG)
        known[id(element)] = total
        return total

    size(root, 0)
