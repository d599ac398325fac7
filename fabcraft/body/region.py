"""`Region`: a named patch of a body's skin, and how near an object may come to it.

Contacts are rows of (where, how strongly wanted, largest gap wanted, never closer than), all in mm; the
numbers of a human head are in `HEAD_RULES`.  Ease: conventions of mask and glasses makers; for a rigid mask
1 mm, against a mean fit error of 0.62 mm reached in practice (Li et al. 2021, Int J Bioprinting 7, 417).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from jaxtyping import Int


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
    """The object stays at least this far from the skin."""

    def __post_init__(self) -> None:
        indices = np.unique(np.asarray(self.vertex_indices, dtype=np.int64))
        indices.setflags(write=False)
        object.__setattr__(self, "vertex_indices", indices)

    def at(self, vertex_indices: Int[np.ndarray, " N"]) -> "Region":
        """The same rule for other vertices."""
        return replace(self, vertex_indices=vertex_indices)


HEAD_RULES: Mapping[str, tuple[float, float, float]] = MappingProxyType(
    {
        "forehead": (1.0, 1.0, 0.0),
        "cheekbone_left": (1.0, 1.0, 0.0),
        "cheekbone_right": (1.0, 1.0, 0.0),
        "nose_bridge": (1.0, 1.0, 0.0),
        "nose_tip": (0.0, 3.0, 2.0),
        "lips": (0.0, 8.0, 4.0),
        "eye_left": (0.0, 12.0, 6.0),
        "eye_right": (0.0, 12.0, 6.0),
        "ear_left": (0.0, 8.0, 5.0),
        "ear_right": (0.0, 8.0, 5.0),
        "chin": (0.0, 4.0, 1.0),
    }
)
"""Region name to (weight, gap_mm, never_closer_mm)."""


def head_region(name: str, vertex_indices: Int[np.ndarray, " N"]) -> Region:
    """The region `name` of a human head at the given vertices, with the rule of `HEAD_RULES`."""
    weight, gap_mm, never_closer_mm = HEAD_RULES[name]
    return Region(name, vertex_indices, weight, gap_mm, never_closer_mm)
