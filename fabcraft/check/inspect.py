"""`check_mesh`: every check that applies, as one `PrintReport`.  Measures, never changes.

A check that raises does not stop the others: it becomes a failure of its own name. Heavy libraries are
imported by the checks that need them, and nothing here needs torch, so that `fabcraft check part.stl` starts
quickly.
"""

import resource
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from fabcraft.check.report import Finding, PrintReport, Severity, Value, could_not_run
from fabcraft.mesh import Mesh
from fabcraft.profile import PrinterProfile

if TYPE_CHECKING:
    from fabcraft.check.thickness import Thickness
    from fabcraft.check.topology import Topology
    from fabcraft.geometry.distance import SurfaceDistance

Result = TypeVar("Result")

_LISTED_REGIONS = 8
_CLEARLY_THIN = 0.95  # of the minimum: between this and the minimum it is a warning


@dataclass(frozen=True, eq=False)
class Worn:
    """The body an object is checked against, and what it promises there."""

    body: "SurfaceDistance"
    object: Mesh | None = None
    """The object where it is worn, when the mesh that is checked lies elsewhere (on a bed)."""
    clearance_mm: float = 0.0
    """Wanted distance from the skin everywhere."""
    penetration_limit_mm: float = 0.1
    """What measuring and skin forgive."""
    contacts: np.ndarray | None = None
    """(C, 3) points on the body where the object rests."""
    gaps_mm: np.ndarray | float = 0.0
    """Wanted gap at the contacts."""
    contact_limit_mm: float = 1.0
    """Largest contact rms that still sits well."""
    donning: tuple[float, float, float] | None = None
    """The straight way off the body (a mask: 0, -1, 0); None: not checked."""
    path: np.ndarray | None = None
    """(K, 4, 4) poses of the object from its seat outwards, instead of a straight way."""
    passes: "SurfaceDistance | None" = None
    """What the object has to pass on that path where it is not the body as it stands: a folded hand."""
    flex_mm: float = 0.5
    """What material and skin give on the way."""
    eyes: np.ndarray | None = None
    """(E, 3) eye centres; None: the object covers no eye."""
    view: tuple[float, float, float] = (0.0, -1.0, 0.0)
    """Where the eyes look."""


@dataclass(frozen=True, eq=False)
class Inspection:
    """The report and the maps behind it; a map is None when its check could not run."""

    report: PrintReport
    topology: "Topology | None" = None
    thickness: "Thickness | None" = None


@dataclass(eq=False)
class _Ledger:
    """What the checks have said so far."""

    findings: list[Finding] = field(default_factory=list)
    metrics: dict[str, Value] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    def run(self, check: str, function: Callable[[], Result]) -> Result | None:
        """The result of a check, timed; None and a failure when it raises."""
        start = time.perf_counter()
        try:
            return function()
        except Exception as error:
            self.findings.append(could_not_run(check, f"{error}" or type(error).__name__))
            return None
        finally:
            self.seconds[check] = time.perf_counter() - start


def check_mesh(
    mesh: Mesh,
    profile: PrinterProfile,
    *,
    worn: Worn | None = None,
    route: tuple[str, ...] = (),
    files: tuple[str, ...] = (),
) -> PrintReport:
    """Check `mesh` for `profile`; `worn`: also on its body."""
    return inspect_mesh(mesh, profile, worn=worn, route=route, files=files).report


def inspect_mesh(
    mesh: Mesh,
    profile: PrinterProfile,
    *,
    worn: Worn | None = None,
    route: tuple[str, ...] = (),
    files: tuple[str, ...] = (),
    pieces: tuple[Mesh, ...] = (),
    parts: int = 1,
) -> Inspection:
    """`check_mesh` with the maps: problem faces, thickness by sample, face and vertex.

    pieces : what `mesh` consists of, when each is to fit the build volume and not all of them together.
    parts : of how many separate closed surfaces it is to be.
    """
    ledger = _Ledger()
    topology = ledger.run("topology", lambda: _topology(mesh, ledger, parts))
    thickness = None
    if topology is not None and topology.faces:
        solid = topology.solid
        ledger.run("printability", lambda: _printability(mesh, profile, solid, pieces, ledger))
        if solid:
            thickness = ledger.run("wall", lambda: _wall(mesh, profile, ledger))
            ledger.run("gap", lambda: _gaps(mesh, topology, profile, ledger))
        else:
            ledger.findings.append(
                could_not_run(
                    "wall", "the surface encloses nothing", "Repair the surface first: fabcraft solid."
                )
            )
        if worn is not None:
            _wear(worn.object or mesh, worn, ledger)
    report = PrintReport(
        findings=tuple(ledger.findings),
        route=route,
        metrics=ledger.metrics,
        seconds=ledger.seconds,
        peak_memory_bytes=peak_memory_bytes(),
        files=files,
    )
    return Inspection(report, topology, thickness)


def peak_memory_bytes() -> int:
    """The most memory this process has held so far."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def _topology(mesh: Mesh, ledger: _Ledger, parts: int) -> "Topology":
    from fabcraft.check.topology import inspect_topology, topology_findings

    topology = inspect_topology(mesh)
    ledger.findings += topology_findings(topology, parts)
    names = (
        "faces",
        "open_edges",
        "facets_reversed",
        "parts",
        "genus",
        "degenerate_faces",
        "self_intersections",
    )
    ledger.metrics |= {name: getattr(topology, name) for name in names if getattr(topology, name) is not None}
    ledger.metrics["non_manifold_edges"] = topology.branching_edges + topology.touching_edges
    return topology


def _printability(
    mesh: Mesh, profile: PrinterProfile, solid: bool, pieces: tuple[Mesh, ...], ledger: _Ledger
) -> None:
    from fabcraft.check.bridges import bridge_findings, measure_bridges
    from fabcraft.check.printability import (
        file_findings,
        inspect_printability,
        printability_findings,
        size_findings,
    )
    from fabcraft.geometry.support import support_of

    state = inspect_printability(mesh, profile, solid)
    found = printability_findings(state, profile)
    if len(pieces) > 1:
        found = [one for one in found if one.check != "size"]
        for piece in pieces:
            found += size_findings(inspect_printability(piece, profile, solid), profile)
    ledger.findings += [*found, *file_findings(len(mesh.faces), profile)]
    if solid and profile.process == "fdm":
        bed = float(mesh.bounds[0, 2])
        ledger.findings += bridge_findings(measure_bridges(mesh, bed + profile.layer_mm), profile)
    if solid and profile.process in ("fdm", "sla"):
        ledger.metrics["support_estimate_mm3"] = support_of(mesh, profile).volume_mm3
    ledger.metrics |= {
        "size_mm": state.size_mm,
        "overhang_share": state.overhang_share,
        "bed_contact_mm2": state.bed_contact_mm2,
    }
    if state.volume_mm3 is not None:
        ledger.metrics["volume_mm3"] = state.volume_mm3


def _wall(mesh: Mesh, profile: PrinterProfile, ledger: _Ledger) -> "Thickness":
    from fabcraft.check.thickness import measure_thickness

    profile = profile.for_size(mesh.size_mm)
    supported, free = profile.min_wall_supported_mm, profile.min_wall_mm
    limit = max(1.5 * profile.wall_mm, 1.5 * max(supported, free))
    thickness = measure_thickness(mesh, free, supported, limit)
    ledger.findings += wall_findings(thickness)
    ledger.metrics |= {
        "wall_min_mm": thickness.min_mm,
        "wall_ray_min_mm": thickness.ray_min_mm,
        "wall_measured_to_mm": thickness.limit_mm,
        "wall_ok_share": thickness.ok_share,
    }
    return thickness


def _gaps(mesh: Mesh, topology: "Topology", profile: PrinterProfile, ledger: _Ledger) -> None:
    from fabcraft.check.gap import gap_findings, measure_gaps

    gaps = measure_gaps(mesh, topology.part_of_face, profile.clearance_moving_mm, profile.min_engrave_mm)
    ledger.findings += gap_findings(gaps, profile)
    for name, width in (("gap_between_mm", gaps.between_mm), ("gap_within_mm", gaps.within_mm)):
        if width is not None:
            ledger.metrics[name] = width


def wall_findings(thickness: "Thickness") -> list[Finding]:
    """The thin patches: a failure when clearly under the minimum, a warning within 5 % of it."""
    found = []
    severities: tuple[Severity, ...] = ("fail", "warn")
    for severity in severities:
        regions = [
            region
            for region in thickness.regions
            if (region.thinnest_mm < _CLEARLY_THIN * region.limit_mm) == (severity == "fail")
        ]
        if not regions:
            continue
        thinnest = min(regions, key=lambda region: region.thinnest_mm / region.limit_mm)
        area = sum(region.area_mm2 for region in regions)
        kind = "with a free border" if thinnest.free else "joined to the rest"
        found.append(
            Finding(
                check="wall",
                severity=severity,
                value=round(thinnest.thinnest_mm, 3),
                limit=thinnest.limit_mm,
                unit="mm",
                where=tuple(region.centre for region in regions[:_LISTED_REGIONS]),
                advice=f"{area:.0f} mm² in {len(regions)} places are thinner than the printer makes reliably "
                f"(walls {kind}); fabcraft solid --wall thickens them.",
            )
        )
    return found


def _wear(mesh: Mesh, worn: Worn, ledger: _Ledger) -> None:
    from fabcraft.check import wear

    def seat() -> None:
        fit = wear.measure_fit(mesh, worn.body, worn.contacts, worn.gaps_mm, worn.clearance_mm)
        ledger.metrics.update(fit.metrics())
        ledger.findings += wear.fit_findings(
            fit, worn.penetration_limit_mm, worn.clearance_mm, worn.contact_limit_mm
        )

    def path() -> None:
        if worn.path is not None:
            donning = wear.measure_path(mesh, worn.passes or worn.body, worn.path, worn.flex_mm)
        else:
            donning = wear.measure_donning(mesh, worn.body, worn.donning or (0.0, -1.0, 0.0), worn.flex_mm)
        ledger.metrics |= {"donnable": donning.donnable, "donning_pen_max_mm": donning.pen_max_mm}
        ledger.findings += wear.donning_findings(donning)

    def sight() -> None:
        sights = wear.measure_sight(mesh, np.asarray(worn.eyes, dtype=np.float64), worn.view)
        ledger.metrics["sight_open_share"] = min(one.open_share for one in sights)
        ledger.findings += wear.sight_findings(sights)

    def edges() -> None:
        from fabcraft.check.sharp import measure_sharp_edges, sharp_findings

        ledger.findings += sharp_findings(measure_sharp_edges(mesh, worn.body))

    ledger.run("fit", seat)
    ledger.run("sharp_edges", edges)
    if worn.donning is not None or worn.path is not None:
        ledger.run("donning", path)
    if worn.eyes is not None and len(worn.eyes):
        ledger.run("sight", sight)
