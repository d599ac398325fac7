"""`PoissonSystem`: vertices ⇄ per-face Jacobians of a rest mesh.

Solves   Φ* = argmin Σ_f A_f ‖∇_f Φ − J_f‖²   (CRAFT, section "deformation"; Neural Jacobian Fields, eq. 5).
Convention: J[f, i, d] = ∂φ_i / ∂x_d, so J = I (or any field whose restriction to the faces is the identity) returns
the rest mesh. The normal part of J never moves a vertex; everything is computed from the restriction R = J W (F, D, 2)
to the faces' tangent frames W. One vertex of every connected component is pinned for the factorisation, and every
component is then shifted so that its centroid (rest-area weights) is the rest centroid: where an object sits is not the
business of its Jacobians, a translation is added by the caller. The matrix is factorised once, in float64, on the CPU.
Fields on another device are brought there and back: a triangular solve for three columns is one long chain of small steps.

Parts that should stay assembled (lenses in their frame, plates of a helmet) can be tied by *links*: soft springs that ask
two vertices for their offset at rest. They add  w Σ_(i,j) ‖(φ_i − φ_j) − (x_i − x_j)‖²  to the sum above, where w = 1 is
as strong as an edge between two equilateral triangles, about; linked components share one centroid.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sparse
import torch
from cholespy import CholeskySolverD, MatrixType
from jaxtyping import Float, Float64, Int
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fabcraft.errors import InputError
from fabcraft.geometry.operators import gradient


class _Linear(torch.autograd.Function):
    """y = S x for a symmetric-or-not linear map given by two NumPy functions, S and its transpose."""

    @staticmethod
    def forward(ctx, value, apply, transpose):
        ctx.transpose = transpose
        return torch.from_numpy(apply(value.detach().double().cpu().numpy())).to(value)

    @staticmethod
    def backward(ctx, grad):
        return torch.from_numpy(ctx.transpose(grad.double().cpu().numpy())).to(grad), None, None


@dataclass(frozen=True, eq=False)
class PoissonSystem:
    """The factorised system of one rest mesh; build it with `PoissonSystem.of(vertices, faces)`."""

    rest: Float64[np.ndarray, "V 3"]
    """Rest positions, any unit."""
    faces: Int[np.ndarray, "F 3"]
    """Connectivity."""
    frames: Float64[np.ndarray, "F 3 2"]
    """Orthonormal tangent frame W of every rest face."""
    areas: Float64[np.ndarray, " F"]
    """Rest area of every face."""
    gradient: sparse.csr_matrix
    """G (2F, V) in the face frames."""
    components: Int[np.ndarray, " V"]
    """Connected component of every vertex; linked ones count as one."""
    _centroid: sparse.csr_matrix
    _free: Int[np.ndarray, " N"]
    _solver: CholeskySolverD
    _linked: Float64[np.ndarray, "V 3"] | None = None
    """Where the links alone would put the vertices; added to every solution."""

    @staticmethod
    def of(
        vertices: Float64[np.ndarray, "V 3"],
        faces: Int[np.ndarray, "F 3"],
        links: Int[np.ndarray, "L 2"] | None = None,
        link_weight: float = 1.0,
    ) -> "PoissonSystem":
        """Assemble and factorise.

        links : pairs of vertices that keep their offset, softly; see `nearest_links`.
        Raises `InputError` for a face without area or a vertex that no face uses: neither has a position to solve for.
        """
        matrix, frames, areas = gradient(vertices, faces)
        unused = np.setdiff1d(np.arange(len(vertices)), faces)
        if len(unused):
            raise InputError(
                f"vertex {unused[0]} (and {len(unused) - 1} more) belongs to no face",
                "Drop unused vertices before the fit.",
            )
        normal_matrix = (matrix.T @ sparse.diags(np.repeat(areas, 2)) @ matrix).tocsc()
        linked = None
        if links is not None and len(links):
            springs = _spring_matrix(links, len(vertices), link_weight)
            normal_matrix, linked = (normal_matrix + springs).tocsc(), springs @ vertices
        count, components = connected_components(normal_matrix, directed=False)
        pinned = np.array([np.flatnonzero(components == index)[0] for index in range(count)])
        free = np.setdiff1d(np.arange(len(vertices)), pinned)
        reduced = normal_matrix[free][:, free].tocoo()
        solver = CholeskySolverD(
            len(free),
            reduced.row.astype(np.int32),
            reduced.col.astype(np.int32),
            reduced.data,
            MatrixType.COO,
        )
        centroid = _centroid_matrix(faces, areas, components)
        system = PoissonSystem(vertices, faces, frames, areas, matrix, components, centroid, free, solver)
        if linked is None:
            return system
        pulled = system._solve_pinned(linked)
        return replace(system, _linked=pulled - (centroid @ pulled)[components])

    def restricted(self, positions: Float64[np.ndarray, "V D"]) -> Float64[np.ndarray, "F D 2"]:
        """R = J W of a map of the rest mesh, given by where it takes the vertices."""
        return (self.gradient @ positions).reshape(len(self.faces), 2, -1).transpose(0, 2, 1)

    def jacobians(self, positions: Float64[np.ndarray, "V D"]) -> Float64[np.ndarray, "F D 3"]:
        """J = R Wᵀ of a map of the rest mesh; zero along the face normal."""
        return np.einsum("fdk,fek->fde", self.restricted(positions), self.frames)

    def vertices(self, jacobians: Float[torch.Tensor, "F 3 3"]) -> Float[torch.Tensor, "V 3"]:
        """Positions whose gradient is nearest the Jacobians, differentiable; component centroids stay at rest."""
        frames = torch.from_numpy(self.frames).to(jacobians)
        return self.vertices_of_restricted(torch.einsum("fde,fek->fdk", jacobians, frames))

    def vertices_of_restricted(self, restricted: Float[torch.Tensor, "F D 2"]) -> Float[torch.Tensor, "V D"]:
        """As `vertices`, from R = J W in the faces' frames; D is 3, or 2 for a map into the plane."""
        dimension = restricted.shape[1]
        columns = restricted.permute(0, 2, 1).reshape(-1, dimension)
        solved = _Linear.apply(columns, self._solve, self._solve_transposed)
        anchor = (self._centroid @ self.rest[:, :dimension])[self.components]
        if self._linked is not None:
            anchor = anchor + self._linked[:, :dimension]
        return solved + torch.from_numpy(anchor).to(restricted)

    def _solve(self, columns: np.ndarray) -> np.ndarray:
        """(2F, D) frame gradients to (V, D) positions with every component's centroid at the origin."""
        right = self.gradient.T @ (np.repeat(self.areas, 2)[:, None] * columns)
        positions = self._solve_pinned(right)
        return positions - (self._centroid @ positions)[self.components]

    def _solve_transposed(self, gradient: np.ndarray) -> np.ndarray:
        summed = np.stack(
            [
                np.bincount(self.components, column, minlength=self._centroid.shape[0])
                for column in gradient.T
            ],
            1,
        )
        solved = self._solve_pinned(gradient - self._centroid.T @ summed)
        return np.repeat(self.areas, 2)[:, None] * (self.gradient @ solved)

    def _solve_pinned(self, right: np.ndarray) -> np.ndarray:
        solution = np.zeros((len(self._free), right.shape[1]))
        self._solver.solve(np.ascontiguousarray(right[self._free]), solution)
        positions = np.zeros_like(right)
        positions[self._free] = solution
        return positions


def nearest_links(
    vertices: Float64[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"], count: int = 6
) -> Int[np.ndarray, "L 2"]:
    """Pairs of vertices that tie every component of a mesh to its neighbours until all hang together.

    Each cluster is tied to the rest by the `count` nearest pairs, over different vertices of its own; then the clusters
    that came about are tied, and so on. No pairs for a mesh of one piece.
    """
    pairs: list[np.ndarray] = []
    while True:
        known = np.concatenate([faces[:, [0, 1, 1, 2]].reshape(-1, 2), *pairs])
        size = (len(vertices), len(vertices))
        graph = sparse.coo_matrix((np.ones(len(known)), (known[:, 0], known[:, 1])), shape=size)
        clusters, labels = connected_components(graph, directed=False)
        if clusters == 1:
            return np.unique(np.concatenate(pairs), axis=0) if pairs else np.zeros((0, 2), np.int64)
        for cluster in range(clusters):
            own, others = np.flatnonzero(labels == cluster), np.flatnonzero(labels != cluster)
            distances, nearest = cKDTree(vertices[others]).query(vertices[own])
            chosen = np.argsort(distances, kind="stable")[:count]
            pairs.append(np.sort(np.column_stack([own[chosen], others[nearest[chosen]]]), axis=1))


def _centroid_matrix(faces: np.ndarray, areas: np.ndarray, components: np.ndarray) -> sparse.csr_matrix:
    """(C, V): the area-weighted mean of each component's vertices; a vertex owns a third of its faces."""
    size = (int(components.max()) + 1, len(components))
    weight = np.bincount(faces.ravel(), np.repeat(areas / 3.0, 3), minlength=size[1])
    total = np.bincount(components, weight, minlength=size[0])
    return sparse.csr_matrix((weight / total[components], (components, np.arange(size[1]))), shape=size)


def _spring_matrix(links: np.ndarray, count: int, weight: float) -> sparse.csr_matrix:
    """w Bᵀ B, with a row of B for every link: +1 at one end, −1 at the other."""
    rows = np.repeat(np.arange(len(links)), 2)
    ends = sparse.csr_matrix(
        (np.tile([1.0, -1.0], len(links)), (rows, links.ravel())), shape=(len(links), count)
    )
    return (weight * (ends.T @ ends)).tocsr()
