"""Our step of Adam is torch's."""

import torch

from fabcraft.fit.adam import adam_step


def test_many_steps_are_those_of_torch():
    torch.manual_seed(4)
    theirs = torch.randn(50, 3, 2).requires_grad_(True)
    mine, first, second = theirs.detach().clone(), torch.zeros(50, 3, 2), torch.zeros(50, 3, 2)
    optimiser = torch.optim.Adam([theirs], lr=1e-2, betas=(0.85, 0.98))
    for step in range(1, 30):
        rate, gradient = 1e-2 / step, torch.randn(50, 3, 2) * 10.0 ** torch.randn(50, 1, 1)
        optimiser.param_groups[0]["lr"], theirs.grad = rate, gradient
        optimiser.step()
        adam_step(mine, gradient, first, second, step, rate, (0.85, 0.98))
    torch.testing.assert_close(mine, theirs.detach(), rtol=1e-6, atol=1e-8)


def test_a_run_does_not_load_the_compiler_of_torch():
    import subprocess
    import sys

    code = (
        "import sys, numpy as np, torch\n"
        "from fabcraft.fit.descend import Descent, Variables, descend\n"
        "from fabcraft.fit.losses import Term\n"
        "from fabcraft.geometry.poisson import PoissonSystem\n"
        "points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])\n"
        "system = PoissonSystem.of(points, np.array([[0, 1, 2]], dtype=np.int32))\n"
        "term = Term('move', 1.0, lambda state: (state.positions - 1.0).square().sum())\n"
        "descend(system, [term], Descent(3, 1e-2, 1e-2), Variables.rest(1, 3))\n"
        "print('torch._dynamo' in sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
