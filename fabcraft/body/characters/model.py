"""`Model`: a character as it is modelled, in millimetres at the size it was drawn at, standing on z = 0.

Only the wearer's left (+x) is written down; the right is its mirror image.  A `Place` is near a point of the skin, which
is put onto it; other points lie inside.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from fabcraft.body.characters.shapes import Number, Point, Shape

Place = Point
Cut = tuple[Point, Point]
"""(a point of the plane, the direction of what is kept)."""


@dataclass(frozen=True, kw_only=True)
class Ear:
    """An ear that can be seen."""

    shape: Shape
    tip: Place
    outermost: Place


@dataclass(frozen=True, kw_only=True)
class Head:
    """The head: the joint in its middle, heights of what lies in the plane of symmetry, and the left side."""

    middle: Point
    eye: Point
    eye_radius: Number
    glabella_z: Number
    sellion_z: Number
    nose_z: Number
    mouth: Place
    chin: Place
    breadth_z: Number
    """Where the skull is widest, above the ears."""
    cheek: Place
    temple: Place
    """Where the side piece of glasses rests: on top of the ear's root, or where that would be."""
    ear: Ear | None
    cut: Cut


@dataclass(frozen=True, kw_only=True)
class Neck:
    """The neck and what a necklace rests on."""

    root: Point
    notch: Place
    nape: Place
    """The seventh vertebra (cervicale), or where it would be."""
    collarbone: Place
    cut: Cut
    """Of the bust."""


@dataclass(frozen=True, kw_only=True)
class Arm:
    """A fore-limb, from the elbow to the tip."""

    elbow: Point
    wrist: Point
    tip: Point
    """End of hand, paw or hoof, inside."""
    back: Point
    """Direction of the back of the hand."""
    girth_mm: Number
    """Radius of the forearm that a band around the wrist stays within."""
    fingers: tuple[tuple[Point, Point, Point], tuple[Point, Point, Point]] | None = None
    """(base, knuckle, tip) of the first and the last finger; None for a hand without fingers."""


@dataclass(frozen=True, kw_only=True)
class Foot:
    """A foot that a shoe goes on."""

    ankle: Point
    reach_mm: Number
    """Every part of the foot is nearer than this to the ankle, seen from above; other feet are not."""
    cut_z: Number
    """The foot part ends at this height,"""
    behind_mm: Number
    """this far behind the ankle,"""
    inner_x: Number = 1.0
    """and here towards the other foot."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Model:
    """A character."""

    name: str
    title: str
    height_mm: Number
    """Height when nothing else is asked."""
    shape: Callable[[], Shape]
    bounds: tuple[Point, Point]
    cell_mm: Number
    """Edge length of its mesh at the size it is modelled at."""
    head: Head
    neck: Neck
    arm: Arm
    foot: Foot
    unwearable: Mapping[str, str] = field(default_factory=dict)
    """Template to why it does not go on, in words."""
