"""Level undersides that a printer has to bridge, and how wide: from the edges they rest on to the middle, twice.

A patch is connected faces that look straight down at one height, off the bed. It rests on the edges where a neighbour
goes on below it. The span of a shelf that rests on one side only counts as if the other side were its mirror image.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.spatial import cKDTree

from fabcraft.check.edges import components, edges_of, welded
from fabcraft.check.report import Finding, places
from fabcraft.geometry.voxels import samples
from fabcraft.mesh import Mesh
from fabcraft.profile import PrinterProfile

_LEVEL = -0.99  # z of the normal
_SAMPLE_MM = 1.0


@dataclass(frozen=True, eq=False)
class Bridges:
    """The spans of all level undersides, the widest first; infinite where one rests on nothing."""

    spans_mm: Float64[np.ndarray, " B"]
    places: Float64[np.ndarray, "B 3"]


def measure_bridges(mesh: Mesh, above_mm: float) -> Bridges:
    """The bridges of a closed mesh as it lies, of what is higher than `above_mm`."""
    vertices, faces = welded(mesh)
    edges = edges_of(faces, len(vertices))
    level = (mesh.face_normals[:, 2] < _LEVEL) & (mesh.corners[:, :, 2].min(1) > above_mm)
    one, other = edges.face[edges.pairs].T
    both = level[one] & level[other]
    _, patch = components(one[both], other[both], len(faces))
    height = vertices[faces][:, :, 2]
    spans, where = [], []
    for number in np.unique(patch[level]):
        mine = level & (patch == number)
        border = mine[one] != mine[other]
        outer = np.where(mine[one[border]], other[border], one[border])
        rests = height[outer].min(1) < height[mine].min() - 1e-6
        half = edges.pairs[border, 0][rests]
        corners = mesh.corners[mine]
        points = _spread(corners)
        if len(half) == 0:
            spans.append(np.inf)
            where.append(points.mean(0))
            continue
        a, b = vertices[edges.start[half]], vertices[edges.end[half]]
        steps = np.linspace(0.0, 1.0, _steps(a, b))
        held = (a[:, None] + steps[None, :, None] * (b - a)[:, None]).reshape(-1, 3)
        gap = cKDTree(held).query(points, workers=2)[0]
        spans.append(2.0 * float(gap.max()))
        where.append(points[gap.argmax()])
    order = np.argsort(-np.array(spans), kind="stable")
    return Bridges(np.array(spans, dtype=np.float64)[order], np.array(where).reshape(-1, 3)[order])


def _steps(a: np.ndarray, b: np.ndarray) -> int:
    """Points along edges, at most half a sample apart on the longest."""
    return 1 + int(np.ceil(2 * np.linalg.norm(b - a, axis=1).max() / _SAMPLE_MM))


def _spread(corners: np.ndarray) -> np.ndarray:
    """Points on triangles, about `_SAMPLE_MM` apart."""
    size = float(np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0)))
    return samples(corners, max(0.5 * _SAMPLE_MM, size / 400))[0]


def bridge_findings(found: Bridges, profile: PrinterProfile) -> list[Finding]:
    """A note when a level underside is wider than the printer spans."""
    wide = found.spans_mm > profile.max_bridge_mm
    if not wide.any():
        return []
    held = found.spans_mm[wide & np.isfinite(found.spans_mm)]
    return [
        Finding(
            check="bridges",
            severity="note",
            value=round(float(held.max()), 1) if len(held) else None,
            limit=profile.max_bridge_mm,
            unit="mm",
            where=places(found.places[wide]),
            advice=f"{wide.sum()} level undersides are wider than the printer spans without support.",
        )
    ]
