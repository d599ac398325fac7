"""What the roads from an input to an object have in common: the clock they run by, and what they hand to the check."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from fabcraft.check.inspect import Worn
from fabcraft.check.report import Finding, Value
from fabcraft.guidance.drawing import Drawing
from fabcraft.mesh import Mesh
from fabcraft.recipe import Recipe
from fabcraft.solid.manifolds import to_manifold, to_mesh
from fabcraft.solid.slots import with_straps
from fabcraft.template.template import Template

Tell = Callable[[str, int, int], None]
"""Progress: called with the name of the stage, the step done and the number of steps."""
Note = tuple[bool, str]
"""(whether it is a warning, sentence)."""

CELLS_MM = {"draft": 0.6, "standard": 0.45}
"""Side of a grid cell of a wall."""


@dataclass(frozen=True, eq=False)
class Given:
    """The recipe's input, read: one of the three."""

    picture: np.ndarray | None = None
    """(H, W, 4) uint8."""
    goal: Mesh | None = None
    """A guidance mesh, mm."""
    drawing: Drawing | None = None
    """Of a text; a picture's is understood on the way."""
    route: tuple[str, ...] = ()
    """Where that drawing is from."""
    notes: tuple[str, ...] = ()
    """What was read into the words."""


@dataclass(frozen=True, eq=False)
class Clock:
    """Seconds of every stage, in order."""

    seconds: dict[str, float]
    tell: Tell | None

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time what happens inside as the stage `name`."""
        if self.tell is not None:
            self.tell(name, 0, 1)
        start = time.perf_counter()
        yield
        self.seconds[name] = time.perf_counter() - start
        if self.tell is not None:
            self.tell(name, 1, 1)


def finished(solid: Mesh, template: Template, recipe: Recipe) -> tuple[Mesh, Mesh]:
    """(the solid with its strap slots, all of the object: of a pair both, the second mirrored to x = 0).

    Raises `SolidError` when a slot misses the solid.
    """
    one = with_straps(solid, template.straps if recipe.strap_slots else ())
    if not template.pair:
        return one, one
    return one, to_mesh(to_manifold(one) + to_manifold(mirrored(one)), one.name)


def mirrored(one: Mesh) -> Mesh:
    """The other one of a pair."""
    return Mesh(one.vertices * [-1.0, 1.0, 1.0], one.faces[:, ::-1].copy(), one.name)


@dataclass(frozen=True, eq=False)
class Shaped:
    """A shaped and solid object, before it is checked."""

    template: Template
    object: Mesh
    """The closed object, mm, where it is worn."""
    worn: Worn
    """What it is held to on its body."""
    drawing: Drawing | None
    """What was understood of the sketch."""
    stages: tuple[tuple[str, Mesh], ...]
    """(label, mesh) along the way, mm, for the evolution strip."""
    route: tuple[str, ...]
    notes: tuple[Note, ...] = ()
    """Of the input."""
    solid_notes: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    metrics: Mapping[str, Value] = field(default_factory=dict)
    interrupted: bool = False
    """The fit was stopped early by the user; the best so far was used."""
