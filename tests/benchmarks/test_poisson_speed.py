"""A Poisson solve, forward and backward, against SciPy's sparse LU of the same matrix."""

import numpy as np
import pytest
import scipy.sparse as sparse
import torch
from measure import compared, take_turns
from scenes import torus_of
from scipy.sparse.linalg import splu

from fabcraft.geometry.operators import gradient
from fabcraft.geometry.poisson import PoissonSystem


class _Solve(torch.autograd.Function):
    """x = L⁻¹ b by a factorisation that is at hand; L is symmetric."""

    @staticmethod
    def forward(ctx, right, factor):
        ctx.factor = factor
        return torch.from_numpy(factor.solve(right.numpy()))

    @staticmethod
    def backward(ctx, grad):
        return torch.from_numpy(ctx.factor.solve(np.ascontiguousarray(grad.numpy()))), None


@pytest.mark.parametrize("vertices", [2000, 10000, 40000])
def test_a_solve_beside_scipy(rows, vertices):
    points, faces = torus_of(2 * vertices)
    points = points / 90.0
    system = PoissonSystem.of(points, faces)
    matrix, _, areas = gradient(points, faces)
    weighted = (matrix.T @ sparse.diags(np.repeat(areas, 2))).tocsr()
    laplacian = (weighted @ matrix)[1:, 1:].tocsc()
    factor = splu(laplacian)
    restricted = torch.from_numpy(np.ascontiguousarray(system.frames)).float() * 1.1
    restricted.requires_grad_(True)
    pull = torch.from_numpy(np.random.default_rng(0).normal(size=points.shape)).float()
    right = torch.from_numpy((weighted @ (1.1 * matrix @ points))[1:]).requires_grad_(True)
    weight = pull[1:].double()

    def whole():
        torch.autograd.grad((system.vertices_of_restricted(restricted) * pull).sum(), restricted)

    def bare():
        columns = np.ascontiguousarray(right.detach().numpy())
        for _ in range(2):  # the pinned system forward, and again backward
            system._solver.solve(columns, solution)

    def scipy():
        torch.autograd.grad((_Solve.apply(right, factor) * weight).sum(), right)

    solution = np.zeros((len(points) - 1, 3))
    with torch.no_grad():
        moved = system.vertices_of_restricted(restricted).numpy()
    theirs = factor.solve(right.detach().numpy())
    assert np.ptp((moved[1:] - theirs) - (moved[1] - theirs[0]), axis=0).max() < 1e-4
    times = take_turns({"whole": whole, "bare": bare, "scipy": scipy}, rounds=9)
    name = f"Poisson, forward and backward, {len(points)} vertices"
    rows.append(compared(name, ">= 8", "SciPy splu", times["bare"], times["scipy"], "the two solves alone"))
    note = "gradients to positions in float32, ours with gradient, centroids and conversions, SciPy the solves alone"
    rows.append(compared(f"{name}, in the loop", "", "SciPy splu", times["whole"], times["scipy"], note))
