"""Tape and calliper measures of a body, mm: what a maker would measure on the person.

A girth is the length of the convex hull of the section loop nearest to a point (the tape rule).  Definitions
follow ANSUR II (Hotzman et al. 2011, NATICK/TR-11/017): head circumference is the largest level girth above
the brows, head breadth the largest breadth above the ears, head length from glabella to the back of the head.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float64
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull

from fabcraft.body.body import Body
from fabcraft.mesh import Mesh


def girth_mm(mesh: Mesh, point: Float64[np.ndarray, "3"], normal: Float64[np.ndarray, "3"]) -> float:
    """Length of the hull of the section loop nearest to `point`; 0 where the plane misses the mesh."""
    normal = normal / np.linalg.norm(normal)
    height = (mesh.vertices - point) @ normal
    height = np.where(np.abs(height) < 1e-9, 1e-9, height)  # a plane through a vertex is moved past it
    crossed = mesh.faces[np.ptp(np.sign(height[mesh.faces]), axis=1) > 0]
    if not len(crossed):
        return 0.0
    edges = np.sort(crossed[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
    cuts = edges[np.prod(np.sign(height[edges]), axis=2) < 0]  # two per face, in order
    ends, which = np.unique(cuts, axis=0, return_inverse=True)
    t = height[ends[:, 0]] / (height[ends[:, 0]] - height[ends[:, 1]])
    points = mesh.vertices[ends[:, 0]] * (1 - t)[:, None] + mesh.vertices[ends[:, 1]] * t[:, None]
    pairs = which.reshape(-1, 2)
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(points),) * 2)
    _, loop = connected_components(graph, directed=False)
    nearest = loop[np.argmin(np.linalg.norm(points - point, axis=1))]
    across = np.linalg.svd(normal[None])[2][1:]
    return float(ConvexHull(points[loop == nearest] @ across.T).area)  # "area" of a 2-D hull is its perimeter


def head_measures(body: Body) -> Mapping[str, float]:
    """Head circumference, breadth and length, bizygomatic breadth, face length and pupil distance, mm."""
    at = body.landmarks
    eyes = (at["eye_left"] + at["eye_right"]) / 2
    middle = np.array([0.0, (at["glabella"][1] + at["opisthocranion"][1]) / 2, eyes[2]])
    above_ears = max(at["ear_tip_left"][2], at["ear_tip_right"][2]) + 8.0
    up = np.array([0.0, 0.0, 1.0])
    return {
        "head_circumference": max(girth_mm(body.mesh, middle + up * h, up) for h in range(30, 61, 5)),
        "head_breadth": float(np.ptp(body.mesh.vertices[body.mesh.vertices[:, 2] > above_ears, 0])),
        "head_length": float(np.linalg.norm(at["opisthocranion"] - at["glabella"])),
        "bizygomatic": float(at["zygion_left"][0] - at["zygion_right"][0]),
        "menton_sellion": float(np.linalg.norm(at["sellion"] - at["menton"])),
        "interpupillary": float(np.linalg.norm(at["eye_left"] - at["eye_right"])),
    }
