"""A hole in a skin is closed by a patch that goes on as the skin around it does.

The patch is a disc of even triangles sewn to the rim.  It and a band of the skin around it take the shape of a thin
plate, min |L x|²_(M⁻¹) + sum_band m (x - x0)² / l⁴ with the cotangent Laplacian L and the lumped mass M
(biharmonic fairing; Botsch and Kobbelt 2004), where the second term lets the plate run smoothly through the noise
of the skin: waves shorter than about l are ironed out before they decide its slope.  Only the patch keeps the new
shape, and the rim moves along its normals.
"""

import igl
import numpy as np
from jaxtyping import Float64, Int64
from scipy.sparse import diags
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from fabcraft.body.body import rim_loops
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.edges import graph_laplacian, halved
from fabcraft.geometry.triangulate import triangulate
from fabcraft.mesh import Mesh

_MAX_POINTS = 3000
"""A patch has about this many points at most; one with a longer rim gets larger triangles in its middle."""
_BAND_EDGES = 6.0
_NOISE_EDGES, _FIRM_EDGES = 1.5, 0.3
"""How wide the band is, and l the first and the second time, in edges of the rim."""
_DRAWN, _FOLLOW = (_FIRM_EDGES,) * 5, 0.08
"""Further rounds with a surface to be drawn to, and l there as a share of the rim's extent."""


def patched(
    mesh: Mesh, loop: Int64[np.ndarray, " N"], *, taut: bool = False, along: SurfaceDistance | None = None
) -> Mesh:
    """`mesh` with the boundary `loop` closed; its vertices keep their indices and the patch's own follow.

    taut : stretch a membrane across instead, as over a drum.  along : a surface that the patch is drawn to.
    """
    rim = mesh.vertices[loop]
    faces, count = _disc(rim)
    index = np.concatenate([loop, len(mesh.vertices) + np.arange(count - len(loop))])
    vertices = np.concatenate([mesh.vertices, _membrane(faces, rim, count)])
    whole = Mesh(vertices, np.concatenate([mesh.faces, index[faces[:, ::-1]].astype(np.int32)]), mesh.name)
    return whole if taut or count == len(loop) else _plate(whole, len(mesh.faces), loop, along)


def _disc(rim: Float64[np.ndarray, "N 3"]) -> tuple[Int64[np.ndarray, "F 3"], int]:
    """(faces, number of points) of an ellipse as long and as wide as the rim; its first points are the rim's.

    No edge joins two points of the rim that are not neighbours: the skin may have that edge already.
    """
    count = len(rim)
    steps = np.linalg.norm(np.roll(rim, -1, 0) - rim, axis=1)
    spread = np.linalg.svd(rim - rim.mean(0), compute_uv=False)
    flat = float(np.clip(spread[1] / max(spread[0], 1e-12), 0.25, 1.0))
    turn = np.linspace(0.0, 2 * np.pi, 4097)
    ellipse = np.column_stack([np.cos(turn), flat * np.sin(turn)])
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ellipse, axis=0), axis=1))])
    # no step may vanish, or two points of the border would be one
    steps = np.maximum(steps, 1e-3 * steps.mean())
    at = np.concatenate([[0.0], np.cumsum(steps)[:-1]]) / steps.sum() * lengths[-1]
    angle = np.interp(at, lengths, turn)
    border = np.column_stack([np.cos(angle), flat * np.sin(angle)])
    edge = max(float(np.median(steps)) / steps.sum() * lengths[-1], np.sqrt(np.pi * flat / _MAX_POINTS))
    disc = triangulate([border], edge, rounds=4, resampled=True)
    if len(disc.loops[0]) != count:  # a border too uneven for it: a fan
        index = np.arange(count)
        return np.stack([index, np.roll(index, -1), np.full(count, count)], 1), count + 1
    lifted = Mesh(np.column_stack([disc.points, np.zeros(len(disc.points))]), disc.faces)
    ends = np.stack([lifted.faces, np.roll(lifted.faces, -1, axis=1)], 2)
    apart = np.abs(ends[..., 0] - ends[..., 1])
    split = halved(lifted, (ends < count).all(2) & (apart != 1) & (apart != count - 1))
    return split.faces.astype(np.int64), len(split.vertices)


def _membrane(
    faces: Int64[np.ndarray, "F 3"], rim: Float64[np.ndarray, "N 3"], count: int
) -> Float64[np.ndarray, "M 3"]:
    """Where the points after the rim's lie when each is in the middle of its neighbours."""
    inner = count - len(rim)
    if not inner:
        return np.zeros((0, 3))
    laplacian = graph_laplacian(faces, count)
    return splu(laplacian[len(rim) :, len(rim) :].tocsc()).solve(-laplacian[len(rim) :, : len(rim)] @ rim)


def _plate(whole: Mesh, old_faces: int, loop: Int64[np.ndarray, " N"], along: SurfaceDistance | None) -> Mesh:
    """`whole` with its faces from `old_faces` on, and their rim, in the shape of a thin plate, drawn to `along`."""
    rim = whole.vertices[loop]
    edge = float(np.median(np.linalg.norm(np.roll(rim, -1, 0) - rim, axis=1)))
    used = np.unique(whole.faces[:old_faces])
    away = cKDTree(rim).query(whole.vertices, distance_upper_bound=_BAND_EDGES * edge)[0]
    band = np.zeros(len(whole.vertices), dtype=bool)
    band[used] = np.isfinite(away[used])
    chosen = np.concatenate(
        [band[whole.faces[:old_faces]].all(1), np.ones(len(whole.faces) - old_faces, bool)]
    )
    rows, compact = np.unique(whole.faces[chosen], return_inverse=True)
    faces = compact.reshape(-1, 3)
    bound = band[rows].astype(np.float64)  # the patch's own points are free
    # at the border of the band the Laplacian sees half a neighbourhood: no bending is asked there
    bending = np.ones(len(rows))
    bending[np.concatenate(rim_loops(faces.astype(np.int32)))] = 0.0
    start = whole.vertices[rows]
    normals = Mesh(start, faces.astype(np.int32)).vertex_normals
    points, goal = start, start
    span = float(np.ptp(rim, axis=0).max())
    # from the second time on with the angles of the plate before, and the band ironed but not slid
    for step, smooth_edges in enumerate((_NOISE_EDGES, _FIRM_EDGES, *_DRAWN * (along is not None))):
        stiffness = igl.cotmatrix(points, faces)
        mass = np.maximum(igl.massmatrix(points, faces, igl.MASSMATRIX_TYPE_VORONOI).diagonal(), 1e-9)
        held = bound * mass / (smooth_edges * edge) ** 4
        if along is not None and step > 1:  # the patch's own points are held by what is nearest
            held = np.where(bound > 0, held, mass / (_FOLLOW * span) ** 4)
            goal = np.where(bound[:, None] > 0, goal, along.closest(points).points)
        system = stiffness.T @ diags(bending / mass) @ stiffness + diags(held)
        points = splu(system.tocsc()).solve(held[:, None] * goal)
        ironed = start + normals * np.einsum("ij,ij->i", normals, points - start)[:, None]
        goal = np.where(bound[:, None] > 0, ironed, points)
    vertices = whole.vertices.copy()
    free, on_rim = bound == 0, np.isin(rows, loop)
    vertices[rows[free]], vertices[rows[on_rim]] = points[free], goal[on_rim]
    return whole.with_vertices(vertices)
