"""`Template`: the base mesh of a kind of wearable, placed on a body before anything deforms it.

A shell-like template is a *sheet*: the middle of a wall that print-prep makes later. Its front view carries height
fields (`FrontSurface`) that say how far in front of the skin the sheet has to stay, and where it may touch.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int32

from fabcraft.body.body import Body
from fabcraft.geometry.plane import Plane
from fabcraft.mesh import Mesh


@dataclass(frozen=True, eq=False)
class FrontSurface:
    """Height fields over a front-view grid, (H, W), heights towards the viewer (-y) in mm."""

    plane: Plane
    skin: Float64[np.ndarray, "H W"]
    """The body itself; -inf beside it."""
    floor: Float64[np.ndarray, "H W"]
    """Lowest height of the sheet (its middle) that keeps every clearance; -inf beside the body."""
    base: Float64[np.ndarray, "H W"]
    """The template's own height, going on smoothly beyond its outline."""
    clearance: Float64[np.ndarray, "H W"]
    """Least distance of the printed object to the skin behind this pixel."""
    contact: Float64[np.ndarray, "H W"]
    """1 where the object is to rest on the skin, 0 where it is not, smooth between."""
    core: Bool[np.ndarray, "H W"]
    """Where the sheet follows the body."""

    def at(
        self, field: Float64[np.ndarray, "H W"], xz: Float64[np.ndarray, "N 2"]
    ) -> Float64[np.ndarray, " N"]:
        """One of the fields, bilinear, at points (x, z) in mm."""
        return self.plane.sample(field, xz)

    def base_at(self, xz: Float64[np.ndarray, "N 2"]) -> Float64[np.ndarray, " N"]:
        """The template's own height, cubic, at points (x, z) in mm."""
        return self.plane.sample(self.base, xz, order=3)


@dataclass(frozen=True, eq=False)
class Template:
    """A placed base mesh and what the fit and print-prep must know of it."""

    name: str
    body: Body
    """The part of the body that wears it."""
    mesh: Mesh
    """The sheet, faces towards the viewer, mm."""
    rims: tuple[Int32[np.ndarray, " _"], ...]
    """Vertex indices of its boundary loops: the outline first, then the openings, the wearer's right eye first."""
    front: FrontSurface
    wall_mm: float
    """Thickness of the wall that print-prep gives the sheet."""
    genus: int
    """Expected genus of the closed solid."""
    contacts: tuple[str, ...]
    """Regions of the body that it rests on."""
    edge_mm: float
    """Wanted edge length."""
    donning: tuple[float, float, float] = (0.0, -1.0, 0.0)
    """Direction in which the object comes off."""
    resting_mm: float = 0.3
    """Distance to the skin where it rests."""
    opening_share: float = 0.7
    """How small an opening may be drawn, over the template's own."""

    @property
    def scale(self) -> float:
        """Size of the wearer's part over a person's: lengths that are no printer's go with it."""
        return self.body.scale

    @property
    def outline(self) -> Float64[np.ndarray, "N 2"]:
        """(x, z) of the outer rim, mm."""
        return self.mesh.vertices[self.rims[0]][:, [0, 2]]

    @property
    def openings(self) -> tuple[Float64[np.ndarray, "_ 2"], ...]:
        """(x, z) of the rims of the openings, mm, the wearer's right eye first (left in the picture)."""
        return tuple(self.mesh.vertices[rim][:, [0, 2]] for rim in self.rims[1:])
