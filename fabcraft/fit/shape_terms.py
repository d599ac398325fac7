"""The terms that speak of the deformation itself: near to nothing, locked faces, no collapse, smooth normals, even edges."""

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64, Int
from torch import Tensor

from fabcraft.fit.descend import State, rest_restriction
from fabcraft.fit.losses import Term, collapse_loss, jacobian_loss, normal_consistency_loss, smoothness_loss
from fabcraft.fit.neighbours import Neighbours
from fabcraft.fit.presets import DeformWeights
from fabcraft.geometry.along import face_distances
from fabcraft.geometry.operators import edge_faces
from fabcraft.geometry.poisson import PoissonSystem
from fabcraft.mesh import Mesh


def shape_terms(
    system: PoissonSystem,
    weights: DeformWeights,
    lock: Float64[np.ndarray, " F"],
    origin: Float64[np.ndarray, "V 3"],
    device: torch.device | str = "cpu",
) -> list[Term]:
    """Terms on a rest mesh in the optimiser's frame.

    lock : how much every face is to stay as it is, 0..1.
    origin : where the vertices were before anything was deformed; the locked faces go back to that shape.
    """
    base = rest_restriction(system, 3, device)
    areas = torch.from_numpy(system.areas).float().to(device)
    index = torch.from_numpy(system.faces.astype(np.int64)).to(device)
    edges, _ = edge_faces(system.faces)
    neighbours = Neighbours.of(system.faces, device)
    terms = [
        Term("jacobian", weights.jacobian, lambda state: jacobian_loss(state.restricted, base, areas)),
        Term("collapse", weights.collapse, lambda state: collapse_loss(state.restricted, areas)),
        Term("edge", weights.edge, _edge_term(system, edges, device)),
    ]
    if neighbours.pairs:
        terms.append(
            Term(
                "normal",
                weights.normal,
                lambda state: normal_consistency_loss(state.positions, index, neighbours),
            )
        )
        frames = torch.from_numpy(system.frames).float().to(device)
        terms.append(
            Term(
                "smoothness",
                weights.smoothness,
                lambda state: smoothness_loss(state.restricted, frames, neighbours),
            )
        )
    if lock.any():
        terms.append(Term("locked", weights.locked, _lock_term(system, lock, origin, device)))
    return [term for term in terms if term.weight > 0.0]


def edge_loss(lengths: Float[Tensor, " E"], rest: Float[Tensor, " E"]) -> Tensor:
    """Mean squared departure of the edges' stretch from its mean: growing costs nothing, growing unevenly does."""
    ratio = lengths / rest
    return ((ratio - ratio.mean()) ** 2).mean()


def lock_weights(mesh: Mesh, locked: Bool[np.ndarray, " F"], falloff_mm: float) -> Float64[np.ndarray, " F"]:
    """1 on locked faces, falling smoothly to 0 over `falloff_mm` from them along the surface.

    Not through the wall: what looks at the skin is locked, and on the other side of a thin wall is what is to be shaped.
    """
    if not locked.any():
        return np.zeros(len(locked))
    distances = face_distances(mesh, locked, falloff_mm)
    share = np.clip(1.0 - distances / max(falloff_mm, 1e-9), 0.0, 1.0)
    return np.where(locked, 1.0, share * share * (3.0 - 2.0 * share))


def _lock_term(
    system: PoissonSystem,
    lock: Float64[np.ndarray, " F"],
    origin: Float64[np.ndarray, "V 3"],
    device: torch.device | str,
) -> Callable[[State], Tensor]:
    """Area mean of ((c - c0) n0)² over the locked faces, c their middles, c0 and n0 where they were and looked to.

    They stay on the surface that was built for the skin, and may spread along it: a bore becomes longer, not narrower.
    """
    held = np.flatnonzero(lock > 0.0)
    faces = system.faces[held]
    before = Mesh(origin, faces)
    middles = torch.from_numpy(before.corners.mean(1)).float().to(device)
    normals = torch.from_numpy(before.face_normals).float().to(device)
    weights = torch.from_numpy(lock[held] * system.areas[held]).float().to(device)
    weights = weights / weights.sum()
    index = torch.from_numpy(faces.astype(np.int64)).to(device)

    def locked(state: State) -> Tensor:
        off = ((state.positions[index].mean(1) - middles) * normals).sum(1)
        return (weights * off**2).sum()

    return locked


def _edge_term(
    system: PoissonSystem, edges: Int[np.ndarray, "E 2"], device: torch.device | str
) -> Callable[[State], Tensor]:
    rest = np.linalg.norm(system.rest[edges[:, 0]] - system.rest[edges[:, 1]], axis=1)
    ends = torch.from_numpy(edges.astype(np.int64)).to(device)
    lengths = torch.from_numpy(rest).float().to(device)

    def edge(state: State) -> Tensor:
        spans = state.positions[ends[:, 0]] - state.positions[ends[:, 1]]
        return edge_loss(torch.sqrt((spans**2).sum(1) + 1e-16), lengths)

    return edge
