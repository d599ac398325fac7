"""Sharp edges on the side of the skin: what would press or scratch the wearer.

An edge counts when its two faces turn outward by more than 60 degrees at once: a rounded rim turns in many small steps.
It is on the skin's side when it lies within 2 mm of the body.  A sliver, a triangle too low to be printed, looks any
way: it counts as part of the face beyond its longest edge.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from fabcraft.check.edges import Edges, edges_of, welded
from fabcraft.check.report import Finding, places
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh

TURN_DEG = 60.0
NEAR_MM = 2.0
_SLIVER_MM, _SLIVERS = 0.05, 4
"""Height under which a triangle is a sliver, and how many may lie beside one another."""
_SHORT_MM = 3.0
"""All sharp edges together below this are a speck of the mesh."""


@dataclass(frozen=True, eq=False)
class SharpEdges:
    """Sharp edges near the skin."""

    length_mm: float
    places: Float64[np.ndarray, "E 3"]
    """Their middles, the longest first."""


def measure_sharp_edges(mesh: Mesh, body: SurfaceDistance) -> SharpEdges:
    """The sharp convex edges of a closed mesh within 2 mm of the body."""
    vertices, faces = welded(mesh)
    edges = edges_of(faces, len(vertices))
    one, other = edges.face[edges.pairs].T
    normals = _printed_normals(mesh, vertices, edges)
    turns = (normals[one] * normals[other]).sum(1) < np.cos(np.radians(TURN_DEG))
    # Convex: the neighbour's far corner lies behind the face.
    convex = ((mesh.corners.mean(1)[other] - mesh.corners.mean(1)[one]) * normals[one]).sum(1) < 0.0
    sharp = edges.pairs[turns & convex, 0]
    start, end = vertices[edges.start[sharp]], vertices[edges.end[sharp]]
    middles, lengths = 0.5 * (start + end), np.linalg.norm(end - start, axis=1)
    if len(sharp):
        near = (
            np.minimum.reduce([body.closest(points).distances for points in (start, middles, end)]) < NEAR_MM
        )
        middles, lengths = middles[near], lengths[near]
    order = np.argsort(-lengths, kind="stable")
    return SharpEdges(float(lengths.sum()), middles[order])


def _printed_normals(
    mesh: Mesh, vertices: Float64[np.ndarray, "W 3"], edges: Edges
) -> Float64[np.ndarray, "F 3"]:
    """Normals of the faces, those of slivers from the next face that is none."""
    normals = np.array(mesh.face_normals)
    longest = np.linalg.norm(mesh.corners - np.roll(mesh.corners, 1, axis=1), axis=2).max(1)
    slivers = np.flatnonzero(2.0 * mesh.face_areas < _SLIVER_MM * longest)
    if not len(slivers):
        return normals
    first = edges.pairs[:, 0]
    length = np.linalg.norm(vertices[edges.end[first]] - vertices[edges.start[first]], axis=1)
    owner = edges.face[edges.pairs].T.reshape(-1)
    beyond = edges.face[edges.pairs[:, ::-1]].T.reshape(-1)
    order = np.lexsort((np.tile(length, 2), owner))  # the longest edge of every face comes last
    across = np.arange(len(normals))
    across[owner[order]] = beyond[order]
    for _ in range(_SLIVERS):
        normals[slivers] = normals[across[slivers]]
    return normals


def sharp_findings(found: SharpEdges) -> list[Finding]:
    """A warning when there are more than 3 mm of them."""
    if found.length_mm <= _SHORT_MM:
        return []
    return [
        Finding(
            check="sharp_edges",
            severity="warn",
            value=round(found.length_mm, 1),
            limit=_SHORT_MM,
            unit="mm",
            where=places(found.places),
            advice=f"Edges that turn by more than {TURN_DEG:g} degrees lie next to the skin: round or sand them.",
        )
    ]
