"""`Template`: the base mesh of a kind of wearable, placed on a body before anything deforms it.

A *sheet* is the middle of a wall that print-prep makes later. Its front view carries height fields (`FrontSurface`) that
say how far in front of what is behind it the sheet has to stay, and where it may touch. A *solid* is finished as it is;
what a drawing adds to it goes into its motif frames, whose plates are sheets in their turn.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float64, Int32

from fabcraft.body.body import Body
from fabcraft.errors import InputError
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
class MotifFrame:
    """A place of a template for a drawing: a picture plane before its outer surface, mm.

    Whoever looks at the picture sees `right` to the right and `up` upwards; right x up points at them, off the object.
    """

    name: str
    """What makers call the place: bezel, band, pendant, brow, crown, toe, front."""
    origin: Float64[np.ndarray, "3"]
    """Middle of the picture, on the outer surface."""
    right: Float64[np.ndarray, "3"]
    up: Float64[np.ndarray, "3"]
    size_mm: tuple[float, float]
    """Width and height that a motif gets without being asked for another size."""
    reach_mm: float
    """How far beyond that size it may grow before it hits the body, the donning path or another part."""
    axis: tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]] | None = None
    """(a point, the unit direction along `up`) of the axis that the picture is rolled around; None: the picture is flat."""
    openings: tuple[Float64[np.ndarray, "_ 2"], ...] = ()
    """Contours (right, up) from the middle of the picture, mm, that stay open: lenses, the wearer's right one first."""
    depth_mm: float = 0.0
    """0: a motif lies on the surface.  Else the drawing is the object itself in this view: an even plate, this thick."""
    follows: bool = False
    """A drawn object follows the template's surface, instead of lying in the picture."""
    free: Mesh | None = None
    """What a drawn object must leave free, mm: the hollow of a helmet."""
    carrier: Mesh | None = None
    """What a drawn object is made one with instead of the template, mm: a necklace without its pendant."""

    @property
    def reading(self) -> Literal["object", "motif"]:
        """What a drawing in this frame shows."""
        return "object" if self.depth_mm else "motif"

    @property
    def outward(self) -> Float64[np.ndarray, "3"]:
        """Unit normal of the picture, towards the viewer."""
        return np.cross(self.right, self.up)


@dataclass(frozen=True, eq=False)
class StrapHole:
    """Where an elastic is tied to a solid: a slot with round ends through its wall, cut when everything else is done."""

    centre: Float64[np.ndarray, "3"]
    """In the wall, mm."""
    along: Float64[np.ndarray, "3"]
    """Unit vector along the slot."""
    through: Float64[np.ndarray, "3"]
    """Unit vector through the wall, square to `along`."""
    length_mm: float
    width_mm: float
    depth_mm: float
    """Of what is cut, half of it to either side of the centre."""


@dataclass(frozen=True, eq=False)
class HingeAxis:
    """What a part of a solid turns about."""

    point: Float64[np.ndarray, "3"]
    """Its middle, mm."""
    along: Float64[np.ndarray, "3"]
    """Unit vector; a right-handed turn about it folds."""
    folds_deg: float
    """How far."""


@dataclass(frozen=True, eq=False)
class DonningPath:
    """How the worn object comes off: rigid poses from its seat outwards, and what gives on the way."""

    poses: Float64[np.ndarray, "K 4 4"]
    """Transforms of the worn object, K >= 30; the first is the identity."""
    allowed_mm: float
    """Press into the body that skin and the object's flex take together on the way."""
    why: str
    """Where that allowance comes from, for the report."""
    through: Mesh | None = None
    """What passes through the object on the way where that is not the body as it stands: the folded hand."""


@dataclass(frozen=True)
class Parameter:
    """A number that a maker may set: `--set name=value`."""

    name: str
    unit: str
    """mm, deg, or empty for a plain number."""
    low: float
    high: float
    meaning: str
    choices: tuple[str, ...] = ()
    """The words that it may be instead; where `low` equals `high`, it may be nothing else."""


@dataclass(frozen=True, eq=False)
class Template:
    """A placed base mesh and what the fit and print-prep must know of it."""

    name: str
    body: Body
    """The part of the body that wears it."""
    mesh: Mesh
    """The sheet, faces towards the viewer, or the closed solid, faces outward; mm."""
    rims: tuple[Int32[np.ndarray, " _"], ...]
    """Of a sheet, vertex indices of its boundary loops: the outline, then the openings, the wearer's right eye first."""
    surface: FrontSurface | None
    """Of a sheet, its height fields; None for a solid."""
    wall_mm: float
    """Thickness of the wall that print-prep gives a sheet; the thinnest part of a solid."""
    genus: int
    """Expected genus of the closed solid, summed over its parts."""
    contacts: tuple[str, ...]
    """Regions of the body that it rests on."""
    edge_mm: float
    """Wanted edge length."""
    donning: tuple[float, float, float] = (0.0, -1.0, 0.0)
    """Direction in which the object comes off."""
    path: DonningPath | None = None
    """How it comes off where that is no straight way along `donning`."""
    locked: Bool[np.ndarray, " _"] | None = None
    """(F,) of a solid, the faces that meet the body and keep their shape."""
    holds: bool = True
    """Whether a fit keeps the locked faces as they were built, as a bore that something goes through.  What hooks, hangs or
    is strapped on sits by its contacts and its clearance; held too, it would bend, thin and lose the design's horns where
    guidance made for another body has its inner side elsewhere."""
    mirrored: bool = False
    """Symmetric to the plane x = 0 of the body."""
    pair: bool = False
    """Made twice, the second one mirrored to x = 0 (slippers)."""
    motifs: tuple[MotifFrame, ...] = ()
    """Places for a drawing, of either reading; the usual one first."""
    parts: int = 1
    """Of a solid, bodies that nowhere touch: three of hinged glasses."""
    hinges: tuple[HingeAxis, ...] = ()
    """Of a solid, what its parts turn about, the wearer's right one first."""
    straps: tuple[StrapHole, ...] = ()
    """Of a solid, the slots for its elastic, the wearer's right one first."""
    listed_mm: tuple[float, float] = (0.0, 0.0)
    """Clearance that the kind asks for: at least, and typically (median over the faces that look at the skin)."""
    parameters: Mapping[str, float] = field(default_factory=dict)
    """What it was built with, by name (`Parameter`)."""
    notes: tuple[str, ...] = ()
    """What was chosen or changed on the way, in sentences for the user."""
    resting_mm: float = 0.3
    """Distance to the skin where it rests."""
    opening_share: float = 0.7
    """How small an opening may be drawn, over the template's own."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", MappingProxyType(dict(self.parameters)))

    @property
    def kind(self) -> Literal["sheet", "solid"]:
        """Whether print-prep still has to make its wall."""
        return "solid" if self.surface is None else "sheet"

    @property
    def front(self) -> FrontSurface:
        """The height fields of a sheet.  Raises `InputError` for a solid."""
        if self.surface is None:
            raise InputError(
                f"the {self.name} is a solid and has no front view", "Use one of its motif frames."
            )
        return self.surface

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
