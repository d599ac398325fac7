"""What fills a picture of a head."""

import numpy as np

from fabcraft.body.body import Body
from fabcraft.mesh import Mesh

BELOW_CHIN_MM = 40.0
"""How much neck is in a picture of the head."""


def head_frame(body: Body, object: Mesh | None = None) -> Mesh:
    """Points that fill a picture of the head: everything above the upper neck, and the object."""
    points = body.mesh.vertices[body.mesh.vertices[:, 2] > body.landmarks["menton"][2] - BELOW_CHIN_MM * body.scale]
    if object is not None:
        points = np.concatenate([points, object.vertices])
    return Mesh(points, np.zeros((0, 3), dtype=np.int32))
