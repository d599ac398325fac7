"""What fills a picture of something worn: the head, or what is around the object."""

import numpy as np

from fabcraft.body.body import Body
from fabcraft.mesh import Mesh

BELOW_CHIN_MM = 40.0
"""How much neck is in a picture of the head."""


AROUND = 0.6
"""How much of the body is in a picture of an object that is not on a head, over the object's size."""


def head_frame(body: Body, object: Mesh | None = None) -> Mesh:
    """Points that fill a picture: everything above the upper neck, or else what is around the object; and the object."""
    if "menton" not in body.landmarks:
        if object is None:
            return body.mesh
        near = AROUND * float(object.size_mm.max())
        lower, upper = object.bounds + np.array([[-near], [near]])
        points = body.mesh.vertices
        points = points[((points > lower) & (points < upper)).all(1)]
        return Mesh(np.concatenate([points, object.vertices]), np.zeros((0, 3), dtype=np.int32))
    points = body.mesh.vertices[
        body.mesh.vertices[:, 2] > body.landmarks["menton"][2] - BELOW_CHIN_MM * body.scale
    ]
    if object is not None:
        points = np.concatenate([points, object.vertices])
    return Mesh(points, np.zeros((0, 3), dtype=np.int32))
