"""Plain templates tried on: built for a body, measured there, and taken off, before any drawing shapes them."""

import time
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fabcraft.body.body import Body
from fabcraft.check.inspect import Worn
from fabcraft.check.thickness import measure_thickness
from fabcraft.check.topology import inspect_topology
from fabcraft.check.wear import Donning, measure_donning, measure_path, surface_samples
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.guidance.inflate import plain_relief
from fabcraft.judge import worn, worn_solid
from fabcraft.mesh import Mesh
from fabcraft.road.base import built
from fabcraft.solid.shell import shell
from fabcraft.solid.thicken import SolidSettings
from fabcraft.template.own import OwnSettings, looks_at
from fabcraft.template.template import Template
from fabcraft.wearer import require_wearable

_CELL_MM = 0.6
_FACING_MM = 15.0  # what is farther from the skin does not look at it
_BUILT_IN = OwnSettings()


@dataclass(frozen=True, eq=False)
class Tried:
    """A plain template on a body."""

    template: Template
    object: Mesh
    """The closed solid where it is worn, mm; of a pair the left one."""
    faces: int
    genus: int
    """Summed over the parts."""
    parts: int
    watertight: bool
    self_intersections: int | None
    """None when the counter is not installed."""
    pen_max_mm: float
    clearance_min_mm: float
    clearance_median_mm: float
    """Over the surface that looks at the skin."""
    wall_min_mm: float
    donning: Donning
    seconds: float
    """To build the template; the wall of a sheet is not in it."""

    @property
    def faults(self) -> tuple[str, ...]:
        """Promises of the template that it does not keep on this body."""
        template, least = self.template, self.template.listed_mm[0]
        checks = {
            f"genus {self.genus}, not {template.genus}": self.genus != template.genus,
            f"{self.parts} parts, not {template.parts}": self.parts != template.parts,
            "not watertight": not self.watertight,
            f"{self.self_intersections} self-intersections": bool(self.self_intersections),
            f"{self.clearance_min_mm:.2f} mm from the skin, not {least:g}": self.clearance_min_mm
            < least - 0.05,
            f"wall {self.wall_min_mm:.2f} mm, not {template.wall_mm:g}": self.wall_min_mm
            < 0.95 * template.wall_mm,
            f"presses {self.donning.pen_max_mm:.2f} mm on its way": not self.donning.donnable,
        }
        return tuple(words for words, wrong in checks.items() if wrong)


def try_on(
    name: str,
    body: Body,
    settings: Mapping[str, float | str] | None = None,
    own: OwnSettings = _BUILT_IN,
) -> Tried:
    """Build the plain template `name`, or the own mesh in that file, on `body` and measure it.

    Raises `InputError` where the body cannot wear it, with the reason.
    """
    start = time.perf_counter()
    template = plain(name, body, settings, own)
    seconds = time.perf_counter() - start
    distance = SurfaceDistance(template.body.mesh)
    solid, seat = _solid(template, distance)
    return _measured(template, solid, seat, distance, seconds)


def plain(
    name: str,
    body: Body,
    settings: Mapping[str, float | str] | None = None,
    own: OwnSettings = _BUILT_IN,
) -> Template:
    """The template `name` for `body`.  Raises `InputError` where it cannot be worn, and for a wrong setting."""
    require_wearable(body, own.like or name)
    return built(name, body, settings or {}, own)


def _solid(template: Template, distance: SurfaceDistance) -> tuple[Mesh, Worn]:
    """The closed object, and what it is held to; a sheet gets its wall."""
    if template.surface is None:
        return template.mesh, worn_solid(template.mesh, template, distance)
    relief = plain_relief(template)
    settings = SolidSettings(wall_mm=template.wall_mm, cell_mm=_CELL_MM * max(template.scale, 0.5))
    solid = shell(template.mesh, template, relief, distance, settings).mesh
    return solid, worn(solid, template, relief, distance)


def _measured(
    template: Template, solid: Mesh, seat: Worn, distance: SurfaceDistance, seconds: float
) -> Tried:
    topology = inspect_topology(solid)
    thickness = measure_thickness(solid, 0.95 * template.wall_mm, limit_mm=1.5 * template.wall_mm)
    signed = distance.signed(np.concatenate([surface_samples(solid), solid.vertices]))
    if seat.path is not None:
        donning = measure_path(solid, seat.passes or seat.body, seat.path, seat.flex_mm)
    else:
        donning = measure_donning(solid, seat.body, template.donning, seat.flex_mm)
    return Tried(
        template=template,
        object=solid,
        faces=len(template.mesh.faces),
        genus=-1 if topology.genus is None else topology.genus,
        parts=topology.parts,
        watertight=topology.solid,
        self_intersections=topology.self_intersections,
        pen_max_mm=max(0.0, -float(signed.min())),
        clearance_min_mm=float(signed.min()),
        clearance_median_mm=_facing_median(solid, distance),
        wall_min_mm=thickness.min_mm,
        donning=donning,
        seconds=seconds,
    )


def _facing_median(solid: Mesh, distance: SurfaceDistance) -> float:
    """Median distance to the skin over the faces that look straight at it, mm."""
    chosen = looks_at(solid, distance, _FACING_MM)
    if not chosen.any():
        return float("nan")
    areas, away = solid.face_areas[chosen], distance.closest(solid.corners[chosen].mean(1)).distances
    order = np.argsort(away)
    share = np.cumsum(areas[order]) / areas.sum()
    return float(away[order[np.searchsorted(share, 0.5)]])
