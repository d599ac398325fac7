"""The honest baseline: triangulate the wanted outline and lift it to the relief, with no deformation at all.

No template is involved beyond its height field; what the fit must add is measured against it.
"""

import numpy as np
from jaxtyping import Float64

from fabcraft.geometry.triangulate import triangulate
from fabcraft.guidance.inflate import Relief
from fabcraft.mesh import Mesh


def direct(rims: list[Float64[np.ndarray, "_ 2"]], relief: Relief, edge_mm: float) -> Mesh:
    """The relief's sheet inside `rims` ((x, z) mm: outline, then openings)."""
    flat = triangulate(rims, edge_mm)
    return Mesh(
        np.column_stack([flat.points[:, 0], -relief.height_at(flat.points), flat.points[:, 1]]),
        flat.faces,
        "direct",
    )
