"""A step with CLIP's ViT-B/32 at its full size, random weights: what is not the encoder has to be small."""

import pytest
import torch
from encoders import full_size
from measure import Row, take_turns
from scenes import around, torus_of

from fabcraft.fit.descend import Descent, State, Variables, descend
from fabcraft.fit.losses import Term
from fabcraft.fit.render import Topology, render
from fabcraft.geometry.poisson import PoissonSystem

STEPS = 1


@pytest.fixture(scope="module")
def encoder():
    return full_size("cpu")


def test_a_guided_step_is_the_encoder_and_little_else(rows, encoder):
    points, faces = torus_of(10000)
    cameras, topology = around(), Topology.of(faces)
    system = PoissonSystem.of(points / 90.0, faces)
    goal = torch.nn.functional.normalize(torch.arange(512.0).cos(), dim=0)
    pixels = torch.rand(8, 3, 224, 224, generator=torch.Generator().manual_seed(0)).requires_grad_(True)

    def likeness(state: State) -> torch.Tensor:
        images = render(90.0 * state.positions, topology, cameras, ("mask", "shaded"))
        return 1.0 - (encoder.encode_images(images.shaded, images.mask) @ goal).mean()

    def step():
        terms = [Term("clip", 1.0, likeness)]
        descend(system, terms, Descent(STEPS, 1e-3, 1e-3), Variables.rest(len(faces), 3))

    def alone():
        for _ in range(STEPS):
            torch.autograd.grad((encoder.network.encode_image(pixels) @ goal).mean(), pixels)

    times = take_turns({"step": step, "alone": alone}, rounds=7, warm=1)
    share = times["step"].cpu / times["alone"].cpu - 1.0
    wall = times["step"].ms / times["alone"].ms - 1.0
    rows.append(
        Row(
            "guided step, what is not the encoder, share of the encoder",
            share,
            "<= 0.05",
            "ViT-B-32 alone, 8 views 224 px, frozen",
            times["step"].ms / STEPS,
            times["alone"].ms / STEPS,
            f"in CPU time; in wall time {wall:.3f}; 10000 faces",
        )
    )
