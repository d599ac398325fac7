"""The paper's figures, composed of the pictures that the cells keep.

A figure that lacks a cell (weights that are not here, an object that could not be made) shows the reason in its place; one
that has none at all is left out, and says why.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8

from fabcraft.check.slicer import ask_slicer
from fabcraft.evaluate.cells import SIZE, Cell
from fabcraft.evaluate.layers import bounds_of, layer_picture, read_layers
from fabcraft.evaluate.suite import ABLATION, BODIES, JOINT, SUITE, TARGETS, WORDS, Design
from fabcraft.profile import load_profile
from fabcraft.read.image_file import read_image
from fabcraft.read.mesh_file import read_mesh
from fabcraft.write.sheet import contact_sheet
from fabcraft.write.wardrobe import reason_cell

SLICED = ("star-ring", "alligator-bangle")
"""The designs whose layers are shown."""
ABLATED = "cat-mask"
"""The design of the ablation, as in the paper."""
EVOLVED = ("spiked-helmet", "cat-mask", "star-ring")
"""The design of the evolution: the first of these that is there."""


@dataclass(frozen=True, eq=False)
class Figure:
    """A picture with its words; no picture where nothing of it is there."""

    name: str
    title: str
    caption: str
    picture: UInt8[np.ndarray, "H W 3"] | None
    why: str = ""
    """Why there is no picture."""


def extra_cells(quick: bool) -> list[tuple[str, Design]]:
    """What the figures need besides the table."""
    if quick:
        return []
    ablated = next(design for design in SUITE if design.name == ABLATED)
    more = [(method, ablated) for method in ABLATION]
    more += [("ours", design) for design in (*TARGETS, *BODIES) if design not in SUITE]
    return more + [(method, design) for design in JOINT for method in ("guidance", "guidance+body", "ours")]


class Shot(NamedTuple):
    """A picture of a cell in a figure."""

    method: str
    design: str
    picture: str = "worn"
    label: str = ""
    """The cell's own title where it is empty."""


def figures(cells: Sequence[Cell], out: Path) -> tuple[Figure, ...]:
    """All figures of the paper that the cells give."""
    found = {(cell.method, cell.design): cell for cell in cells}
    suite = [design.name for design in SUITE if ("ours", design.name) in found]
    evolved = [
        name for name in (*EVOLVED, *suite) if ("ours", name) in found and not found["ours", name].error
    ]

    def compose(name: str, title: str, caption: str, shots: Sequence[Shot], columns: int = 4) -> Figure:
        there = [(found[key], shot) for shot in shots if (key := (shot.method, shot.design)) in found]
        if all(cell.error for cell, _ in there):
            why = "; ".join(sorted({cell.error for cell, _ in there}))
            return Figure(name, title, caption, None, why or "its cells were not asked for")
        if len(shots) > len(there) == 1:
            return Figure(name, title, caption, None, "there is nothing to compare with")
        pictures = [_picture(cell, shot.picture, out) for cell, shot in there]
        labels = [shot.label or cell.title for cell, shot in there]
        if columns == 1:  # a strip has labels of its own
            return Figure(name, title, f"{caption[:-1]}: {labels[0]}.", pictures[0])
        sheet = contact_sheet(pictures, labels, columns=min(columns, len(pictures)))
        return Figure(name, title, caption, sheet)

    def told(method: str, design: str, picture: str = "worn") -> Shot:
        return Shot(method, design, picture, f"{WORDS[method]}: {design.replace('-', ' ')}")

    def measured(method: str, picture: str) -> Shot:
        return Shot(method, ABLATED, picture, WORDS[method] + _numbers(found.get((method, ABLATED))))

    joint = [(method, design.name) for design in JOINT for method in ("guidance", "guidance+body", "ours")]
    return (
        compose(
            "gallery",
            "Gallery",
            "Every design of the suite, as fabcraft makes it.",
            [Shot("ours", name) for name in suite],
        ),
        compose(
            "targets",
            "One template, many targets",
            "The same ring, towards different guidance.",
            [Shot("ours", one.name, label=one.prompt) for one in TARGETS],
        ),
        compose(
            "bodies",
            "One design, many bodies",
            "The same guidance mesh, fitted to different wearers.",
            [Shot("ours", one.name) for one in BODIES],
        ),
        compose(
            "text-image",
            "Text against image",
            "Deformed by a prompt alone, and by the guidance mesh.",
            [told(method, name) for name in suite[:4] for method in ("textdeformer", "ours")]
            if any(method == "textdeformer" and not cell.error for (method, _), cell in found.items())
            else [told("textdeformer", name) for name in suite],
        ),
        compose(
            "ablation",
            "The body's losses",
            "What the loop alone achieves with neither of the body's terms, each alone, and both; red is inside the body.",
            [measured(method, kind) for method in ABLATION for kind in ("worn", "map")],
        ),
        compose(
            "penetration",
            "Penetration",
            "Without the body's losses and with them: blue is clear of the body, red is inside.",
            [told(method, name, "map") for name in suite for method in ("no-body-loss", "ours")],
        ),
        compose(
            "joint",
            "Joint against two-stage",
            "Guidance that is refined afterwards stays as thin and as closed as it came; a deformed template keeps its "
            "wall and its opening.",
            [told(method, name, kind) for method, name in joint for kind in ("worn", "map")],
            6,
        ),
        compose(
            "evolution",
            "Evolution",
            "From the template to the object.",
            [Shot("ours", name, "evolution") for name in evolved[:1]],
            1,
        ),
        _sliced(found, out),
    )


def _picture(cell: Cell, kind: str, out: Path) -> UInt8[np.ndarray, "H W 3"]:
    """A picture that a cell keeps, or the reason why it has none."""
    if cell.error:
        return reason_cell(cell.error, SIZE)
    return np.ascontiguousarray(read_image(out / cell.folder / f"{kind}.png")[..., :3])


def _numbers(cell: Cell | None) -> str:
    if cell is None or cell.error:
        return ""
    contact = cell.metrics.get("contact_rms_mm")
    return f": {cell.metrics['pen_max_mm']:.2f} mm deep" + (
        "" if contact is None else f", contacts {contact:.2f} mm"
    )


def _sliced(found: Mapping[tuple[str, str], Cell], out: Path) -> Figure:
    """Four layers of the parts, as the slicer lays them."""
    name, title, caption = (
        "sliced",
        "Fabricated",
        "Layers of the G-code, from above: walls blue, infill orange, supports grey.",
    )
    profile = load_profile("prusa-mk4")
    pictures, labels, why = [], [], "its cells were not asked for"
    for design in SLICED:
        cell = found.get(("ours", design))
        if cell is None or cell.error:
            continue
        gcode = out / cell.folder / "part.gcode"
        answer = ask_slicer(read_mesh(out / cell.folder / "part.stl"), profile, keep=gcode)
        if not answer.sliced:
            why = answer.error or "the slicer made nothing"
            continue
        layers = read_layers(gcode.read_text("utf-8", "replace").splitlines())
        if not layers:
            why = f"{answer.program} wrote no moves"
            continue
        bounds = bounds_of(layers)
        for share in (0.1, 0.35, 0.6, 0.85):
            layer = layers[min(int(share * len(layers)), len(layers) - 1)]
            pictures.append(layer_picture(layer, bounds, SIZE, profile.bead_mm))
            labels.append(f"{cell.title}: layer {layers.index(layer) + 1} of {len(layers)}")
    if not pictures:
        return Figure(name, title, caption, None, why)
    return Figure(name, title, caption, contact_sheet(pictures, labels, columns=4))
