"""`character(name, height_mm)`: a modelled figure as a `Body`, with the places and regions that people have.

Each is modelled once, at about 200 mm, in a module of `characters`; here it is meshed, measured and brought to the asked
height.  Twice the height is twice every coordinate; the distances of its contact rules grow alike, from a floor on.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np

from fabcraft.body.body import Body
from fabcraft.body.characters.bear import BEAR
from fabcraft.body.characters.cow import COW
from fabcraft.body.characters.dinosaur import DINOSAUR
from fabcraft.body.characters.dog import DOG
from fabcraft.body.characters.figure import FIGURE
from fabcraft.body.characters.frog import FROG
from fabcraft.body.characters.model import Model
from fabcraft.body.characters.nets import symmetric_mesh
from fabcraft.body.characters.patches import part_of, regions, scaled_rule
from fabcraft.body.characters.places import Points, joints, landmarks
from fabcraft.body.parts import Cut
from fabcraft.body.region import Region
from fabcraft.errors import InputError
from fabcraft.mesh import Mesh

CHARACTERS: Mapping[str, Model] = MappingProxyType(
    {model.name: model for model in (DINOSAUR, COW, DOG, FIGURE, BEAR, FROG)}
)
"""The characters by name."""

HEIGHT_MM = (60.0, 2500.0)
"""Lowest and highest height that can be asked."""

MAN_MM = {"breadth": 154.0, "height": 232.0, "wrist": 56.0, "foot": 271.0}
"""A median man's (ANSUR II, 2012): head breadth, vertex to menton, wrist girth over pi, foot length."""


def character(name: str, height_mm: float | int = 0.0) -> Body:
    """The character called `name`, `height_mm` tall (0: its own desk-toy height); about a second.

    Raises `InputError` for another name, or a height outside 60-2500 mm.
    """
    if name not in CHARACTERS:
        raise InputError(f"there is no character called '{name}'", f"Characters: {', '.join(CHARACTERS)}.")
    model = CHARACTERS[name]
    height = height_mm or model.height_mm
    if not HEIGHT_MM[0] <= height <= HEIGHT_MM[1]:
        raise InputError(
            f"a height of {height:g} mm was asked for the {name}",
            f"Choose between {HEIGHT_MM[0]:g} and {HEIGHT_MM[1]:g} mm; its own is {model.height_mm:g}.",
        )
    mesh, marks, bones, scales, patches = _modelled(name)
    factor = height / float(mesh.size_mm[2])
    return Body(
        name,
        Mesh(mesh.vertices * factor, mesh.faces, name),
        {key: point * factor for key, point in marks.items()},
        {key: scaled_rule(region, scales[part_of(key)] * factor) for key, region in patches.items()},
        "character",
        {key: point * factor for key, point in bones.items()},
        cuts=_cuts(model, bones, scales, factor),
        unwearable=model.unwearable,
    )


@cache
def _modelled(name: str) -> tuple[Mesh, Points, Points, dict[str, float], dict[str, Region]]:
    """Skin, landmarks, joints, sizes over a man's and regions as modelled, the same for every height."""
    model = CHARACTERS[name]
    shape = model.shape()
    mesh = symmetric_mesh(shape, np.array(model.bounds, dtype=np.float64), model.cell_mm)
    marks, bones = landmarks(model, shape, mesh), joints(model)
    scales = _scales(model, marks)
    return mesh, marks, bones, scales, regions(model, mesh, marks, bones, scales)


def _scales(model: Model, marks: Points) -> dict[str, float]:
    """Size of head, hand and foot, as modelled, over a median man's."""
    breadth = marks["euryon_left"][0] - marks["euryon_right"][0]
    height = marks["vertex"][2] - marks["menton"][2]
    wrist = np.linalg.norm(marks["wrist_back_left"] - marks["wrist_palm_left"])
    foot = marks["heel_left"][1] - marks["toe_tip_left"][1]
    return {
        "head": float(np.sqrt(breadth / MAN_MM["breadth"] * height / MAN_MM["height"])),
        "hand": float(wrist / MAN_MM["wrist"]),
        "foot": float(foot / MAN_MM["foot"]),
    }


def _cuts(model: Model, bones: Points, scales: Mapping[str, float], factor: float) -> dict[str, Cut]:
    """Where each part is cut off: as the model says, square to the forearm, and around the foot above its ankle."""

    def cut(planes: Sequence[tuple[Any, Any]], anchor: np.ndarray, scale: float, *kept: str) -> Cut:
        sized = [
            (factor * np.array(point), np.array(towards) / np.linalg.norm(towards))
            for point, towards in planes
        ]
        return Cut(tuple(sized), anchor * factor, scale=scale * factor, measured_from=kept)

    found = {
        "head": cut([model.head.cut], bones["head"], scales["head"]),
        "bust": cut([model.neck.cut], bones["head"], scales["head"]),
    }
    for side, sign in (("left", 1.0), ("right", -1.0)):
        elbow, wrist, ankle = (bones[f"{name}_{side}"] for name in ("lowerarm", "wrist", "foot"))
        found[f"hand_{side}"] = cut([(elbow, wrist - elbow)], wrist, scales["hand"], f"lowerarm_{side}")
        around = [
            ((0.0, 0.0, model.foot.cut_z), (0.0, 0.0, -1.0)),
            ((0.0, ankle[1] + model.foot.behind_mm, 0.0), (0.0, -1.0, 0.0)),
            ((sign * model.foot.inner_x, 0.0, 0.0), (sign, 0.0, 0.0)),
        ]
        kept = [f"{name}_{side}" for name in ("heel", "toe_tip", "ball_medial", "ball_lateral", "instep")]
        found[f"foot_{side}"] = cut(around, ankle, scales["foot"], *kept)
    return found
