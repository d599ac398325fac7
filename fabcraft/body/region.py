"""`Region`: a named patch of a body's skin, and how near an object may come to it.

Contacts are rows of (where, how strongly wanted, largest gap wanted, never closer than), all in mm; the
numbers of a person are in `RULES`.  They are the bare skin's: a template that wears pads adds their thickness.
Ease: conventions of makers; for a rigid mask 1 mm, against a mean fit error of 0.62 mm reached in practice (Li et
al. 2021, Int J Bioprinting 7, 417); glasses and slippers may press 0.3 and 0.5 mm into the skin.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True, eq=False)
class Region:
    """A set of skin vertices with its contact rule."""

    name: str
    vertex_indices: Int[np.ndarray, " N"]
    """Indices into the vertices of the body's mesh, ascending; read-only int64."""
    weight: float
    """Weight of the contact loss; 0 means that the object should not rest here."""
    gap_mm: float
    """Largest gap wanted between skin and object; meaningful where the weight is above 0."""
    never_closer_mm: float
    """The object stays at least this far from the skin; below 0 it may press into it by that much."""
    emphasis: Float[np.ndarray, " _"] = field(default_factory=lambda: np.ones(0))
    """(N,) share of `weight` at every vertex, in [0, 1]; all 1 when none were given.  Read-only float64."""

    def __post_init__(self) -> None:
        indices, first = np.unique(np.asarray(self.vertex_indices, dtype=np.int64), return_index=True)
        given = np.array(self.emphasis, dtype=np.float64)
        emphasis = given[first] if len(given) else np.ones(len(indices))
        for name, array in (("vertex_indices", indices), ("emphasis", emphasis)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def at(
        self, vertex_indices: Int[np.ndarray, " N"], emphasis: Float[np.ndarray, " N"] | None = None
    ) -> "Region":
        """The same rule for other vertices."""
        return replace(
            self, vertex_indices=vertex_indices, emphasis=np.ones(0) if emphasis is None else emphasis
        )


_ONE: Mapping[str, tuple[float, float, float]] = {
    # the face: mask, visor
    "forehead": (1.0, 1.0, 0.0),
    "nose_bridge": (1.0, 1.0, 0.0),
    "nose_tip": (0.0, 3.0, 2.0),
    "lips": (0.0, 8.0, 4.0),
    "chin": (0.0, 4.0, 1.0),
    # the skull: helmet, visor
    "crown": (1.0, 1.0, 0.0),
    "nape": (1.0, 1.0, 0.0),
    # the neck: necklace
    "nape_low": (1.0, 2.0, 0.0),
    "throat": (0.0, 12.0, 6.0),
}
_TWO: Mapping[str, tuple[float, float, float]] = {
    "cheekbone": (1.0, 1.0, 0.0),
    "eye": (0.0, 12.0, 6.0),
    "ear": (0.0, 8.0, 5.0),
    "temple": (1.0, 1.0, 0.0),
    # glasses
    "nose_flank": (1.0, 0.5, -0.3),
    "ear_root": (1.0, 0.5, -0.3),
    "collarbone": (1.0, 2.0, 0.0),
    # bangle, ring
    "wrist": (0.3, 12.0, 0.0),
    "ring_finger": (1.0, 0.3, 0.0),
    # slippers
    "sole_heel": (1.0, 0.5, -0.5),
    "sole_ball": (1.0, 0.5, -0.5),
    "sole_toes": (1.0, 0.5, -0.5),
    "instep": (0.3, 2.0, -0.5),
    "toes": (0.0, 12.0, 6.0),
}
RULES: Mapping[str, tuple[float, float, float]] = MappingProxyType(
    {**_ONE, **{f"{name}_{side}": rule for name, rule in _TWO.items() for side in ("left", "right")}}
)
"""Region name to (weight, gap_mm, never_closer_mm)."""


def human_region(
    name: str, vertex_indices: Int[np.ndarray, " N"], emphasis: Float[np.ndarray, " N"] | None = None
) -> Region:
    """The region `name` of a person at the given vertices, with the rule of `RULES`."""
    weight, gap_mm, never_closer_mm = RULES[name]
    return Region(name, vertex_indices, weight, gap_mm, never_closer_mm).at(vertex_indices, emphasis)
