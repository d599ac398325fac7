"""A guidance mask's openings brought before the template's: a fit moves and bends openings, but makes none.

Two masks of the same outline have their eyes at different heights when they were made for different people. A template's
opening that finds none near by closes, as the guidance has material there, and the guidance's own stays shut.
"""

from dataclasses import replace
from itertools import permutations

import numpy as np
from jaxtyping import Float64
from scipy import ndimage

from fabcraft.geometry.align import Similarity
from fabcraft.geometry.heights import front_heights
from fabcraft.geometry.plane import Plane
from fabcraft.guidance.alignment import Aligned
from fabcraft.mesh import Mesh

_PIXELS = 240
"""Along the longer side of the picture that openings are looked for in."""
_LEAST_SHARE = 0.002
"""Of the picture: a smaller opening is a flaw, or a place for a string."""
_MOST = 8
"""More openings than that are a grille: they say nothing of the eyes."""
_FARTHEST, _UNEVEN = 0.3, 0.1
"""Of the template's size: the farthest that openings move the guidance, and how far they may then be from each other."""


def openings(mesh: Mesh, plane: Plane) -> Float64[np.ndarray, "K 2"]:
    """(x, z) of the middle of every opening that is seen from the front, mm."""
    free = ~np.isfinite(front_heights(mesh, plane))
    labels, count = ndimage.label(free)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    kept = [
        one for one in range(1, count + 1) if one != labels[0, 0] and sizes[one] >= _LEAST_SHARE * free.size
    ]
    middles = np.array(ndimage.center_of_mass(free, labels, kept)).reshape(-1, 2)
    return plane.to_mm(middles[:, ::-1] + 0.5)


def opened(found: Aligned, onto: Mesh) -> Aligned:
    """The guidance moved so that its openings lie over those of `onto`, and as far from the face as before.

    It stays where its user has put it, where it has fewer openings, and where they are elsewhere altogether.
    """
    both = np.concatenate([found.mesh.vertices, onto.vertices])[:, [0, 2]]
    size = float(onto.size_mm.max())
    pixel = float(np.ptp(both, axis=0).max()) / _PIXELS
    plane = Plane.around(both, pixel, 4.0 * pixel)
    wanted, there = openings(onto, plane), openings(found.mesh, plane)
    if found.given or not len(wanted) or not len(wanted) <= len(there) <= _MOST:
        return found
    orders = [list(order) for order in permutations(range(len(there)), len(wanted))]
    misses = [wanted - there[order] for order in orders]
    uneven = [float(np.linalg.norm(miss - miss.mean(0), axis=1).max()) for miss in misses]
    best = int(np.argmin(uneven))
    across, up = misses[best].mean(0)
    if uneven[best] > _UNEVEN * size or np.hypot(across, up) > _FARTHEST * size:
        return found
    moved = found.mesh.with_vertices(found.mesh.vertices + [across, 0.0, up])
    here, below = front_heights(moved, plane), front_heights(onto, plane)
    shared = np.isfinite(here) & np.isfinite(below)
    deeper = float(np.median(here[shared] - below[shared]))
    more = Similarity(1.0, np.eye(3), np.array([across, deeper, up]))
    return replace(
        found,
        mesh=found.mesh.with_vertices(more.points(found.mesh.vertices)),
        placed=more.after(found.placed),
    )
