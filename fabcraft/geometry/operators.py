"""Discrete operators of a triangle mesh: face frames, gradient, Laplacian, edge adjacency.

Conventions: a scalar u per vertex, linear in each face; its gradient is constant per face. With the unit normal n,
area A and the edge e_i opposite corner i,  grad u = Σ_i u_i (n × e_i) / 2A.  The Laplacian is the positive
semi-definite cotangent matrix  L = Gᵀ M G  with M = diag(A).  A tangent frame W (3 x 2, orthonormal columns) spans
each face; gradients expressed in it lose nothing, since a face gradient has no normal part.
"""

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float64, Int

from fabcraft.errors import InputError


def face_frames(
    vertices: Float64[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]
) -> tuple[Float64[np.ndarray, "F 3 2"], Float64[np.ndarray, " F"]]:
    """Orthonormal tangent frame W and area A (squared unit of the vertices) of every face.

    Raises `InputError` naming the first face without area, on which no gradient exists.
    """
    a, b, c = vertices[faces].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    twice_area = np.linalg.norm(normals, axis=1)
    longest = np.max(
        [np.linalg.norm(b - a, axis=1), np.linalg.norm(c - b, axis=1), np.linalg.norm(a - c, axis=1)], 0
    )
    flat = twice_area <= 1e-12 * longest**2
    if flat.any():
        index = int(np.flatnonzero(flat)[0])
        raise InputError(
            f"face {index} (and {int(flat.sum()) - 1} more) has no area: its corners lie on one line or coincide",
            "Remesh the surface, or drop its degenerate faces first.",
        )
    first = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
    second = np.cross(normals / twice_area[:, None], first)
    return np.stack([first, second], axis=2), 0.5 * twice_area


def gradient(
    vertices: Float64[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]
) -> tuple[sparse.csr_matrix, Float64[np.ndarray, "F 3 2"], Float64[np.ndarray, " F"]]:
    """The gradient in face frames: G (2F, V) with rows 2f and 2f + 1 for the two frame directions of face f.

    Returns G, the frames W (F, 3, 2) and the areas A (F,).  Wᶠ (G u)ᶠ is the gradient in space.
    """
    frames, areas = face_frames(vertices, faces)
    corners = vertices[faces]
    normals = np.cross(frames[:, :, 0], frames[:, :, 1])
    opposite = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)  # edge opposite corner i
    in_space = np.cross(normals[:, None, :], opposite) / (2.0 * areas)[:, None, None]
    values = np.einsum("fid,fdk->fki", in_space, frames)
    count = len(faces)
    rows = np.repeat(np.arange(2 * count).reshape(count, 2, 1), 3, axis=2)
    columns = np.repeat(faces[:, None, :], 2, axis=1)
    matrix = sparse.csr_matrix(
        (values.ravel(), (rows.ravel(), columns.ravel())), shape=(2 * count, len(vertices))
    )
    return matrix, frames, areas


def laplacian(vertices: Float64[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> sparse.csr_matrix:
    """The positive semi-definite cotangent Laplacian L = Gᵀ M G, (V, V)."""
    matrix, _, areas = gradient(vertices, faces)
    return (matrix.T @ sparse.diags(np.repeat(areas, 2)) @ matrix).tocsr()


def edge_faces(
    faces: Int[np.ndarray, "F 3"],
) -> tuple[Int[np.ndarray, "E 2"], Int[np.ndarray, "E 2"]]:
    """Every edge once, as (lower, higher) vertex, with its two faces; the second is -1 on a boundary.

    Raises `InputError` when more than two faces meet at an edge.
    """
    half_edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1).astype(np.int64)
    codes = half_edges @ np.array([2**32, 1])  # one number sorts many times faster than two
    order = np.argsort(codes, kind="stable")
    starts = np.flatnonzero(np.append(True, codes[order[1:]] != codes[order[:-1]])) if len(codes) else order
    counts = np.diff(np.append(starts, len(codes)))
    edges = half_edges[order[starts]]
    if len(counts) and counts.max() > 2:
        raise InputError(
            f"{int((counts > 2).sum())} edges have more than two faces: the surface is not a manifold",
            "Repair the mesh first, e.g. with `fabcraft solid`.",
        )
    owner = order // 3
    pairs = np.full((len(edges), 2), -1, dtype=np.int64)
    pairs[:, 0] = owner[starts]
    double = counts == 2
    pairs[double, 1] = owner[starts[double] + 1]
    return edges, pairs


def boundary_loops(faces: Int[np.ndarray, "F 3"]) -> list[Int[np.ndarray, " N"]]:
    """The boundary of an open surface as closed loops of vertices, longest first, in the direction of the faces.

    A counter-clockwise sheet has its outer loop counter-clockwise and its holes clockwise.
    """
    half_edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    known = {(int(a), int(b)) for a, b in half_edges}
    following: dict[int, list[int]] = {}
    for a, b in half_edges.tolist():
        if (b, a) not in known:
            following.setdefault(a, []).append(b)
    loops = []
    while following:
        start = min(following)
        loop, current = [], start
        while current in following:
            loop.append(current)
            targets = following[current]
            nxt = targets.pop()
            if not targets:
                del following[current]
            current = nxt
        loops.append(np.array(loop))
    return sorted(loops, key=len, reverse=True)
