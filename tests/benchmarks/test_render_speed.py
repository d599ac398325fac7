"""The renderer's step, forward and backward, against DEODR, against plain torch, by views and by faces."""

import numpy as np
import pytest
import torch
from measure import Row, compared, take_turns
from peers import deodr_renderer, torch_render
from scenes import SIZES, around, torus, torus_of

from fabcraft.fit.render import Topology, render

OUTPUTS = ("mask", "shaded")


def our_step(points, faces, cameras):
    """A step of an L1 fit of mask and shade, and the two pictures of the shape it is to become."""
    vertices = torch.tensor(points, dtype=torch.float32, requires_grad=True)
    topology = Topology.of(faces)
    with torch.no_grad():
        wanted = render(1.03 * vertices, topology, cameras, OUTPUTS)

    def step():
        images = render(vertices, topology, cameras, OUTPUTS)
        return derivative(images.mask, images.shaded, wanted.mask, wanted.shaded, vertices)

    return step, wanted


def derivative(mask, shaded, wanted_mask, wanted_shaded, vertices):
    loss = (mask - wanted_mask).abs().mean() + (shaded - wanted_shaded).abs().mean()
    return torch.autograd.grad(loss, vertices)[0]


def peer_step(draw, points, wanted):
    """The same step in the precision that the peer computes in."""
    vertices = torch.tensor(points, requires_grad=True)
    mask, shaded = wanted.mask.double(), wanted.shaded.double()
    return lambda: derivative(*draw(vertices), mask, shaded, vertices)


@pytest.mark.filterwarnings("ignore")  # DEODR's own
@pytest.mark.parametrize(("faces", "aim"), [(2016, 2), (9964, 5), (40068, 8)])
def test_a_step_beside_deodr(rows, faces, aim):
    name = f"render step beside DEODR, 8 views 224 px, {faces} faces"
    try:
        import deodr
    except ImportError:
        rows.append(Row(name, None, f">= {aim}", "DEODR", note="skipped: DEODR is not installed"))
        pytest.skip("DEODR is not installed")
    points, triangles = torus(*SIZES[faces])
    cameras = around()
    step, wanted = our_step(points, triangles, cameras)
    draw = deodr_renderer(triangles, points, cameras)
    with torch.no_grad():
        mask, shaded = draw(torch.tensor(1.03 * points))
    assert (mask - wanted.mask).abs().mean() < 0.01 and (shaded - wanted.shaded).abs().mean() < 0.01
    times = take_turns({"ours": step, "deodr": peer_step(draw, points, wanted)}, rounds=11)
    peer = f"DEODR {deodr.__version__}" if hasattr(deodr, "__version__") else "DEODR"
    note = "it keeps to 1 thread, culls faces from behind, shades a vertex"
    rows.append(compared(name, f">= {aim}", peer, times["ours"], times["deodr"], note))


@pytest.mark.parametrize("faces", SIZES)
def test_a_step_beside_the_same_maths_in_plain_torch(rows, faces):
    points, triangles = torus(*SIZES[faces])
    cameras, topology = around(), Topology.of(triangles)
    step, wanted = our_step(points, triangles, cameras)

    def draw(vertices):
        return torch_render(vertices, topology, cameras)

    vertices = torch.tensor(points, requires_grad=True)
    images = render(vertices, topology, cameras, OUTPUTS)
    ours = derivative(images.mask, images.shaded, wanted.mask.double(), wanted.shaded.double(), vertices)
    theirs = peer_step(draw, points, wanted)()
    # an absolute difference has either slope where rounding alone tells two pictures apart
    assert (ours - theirs).norm() < 2e-4 * ours.norm()
    times = take_turns({"ours": step, "torch": peer_step(draw, points, wanted)}, rounds=7)
    rows.append(
        compared(
            f"render step beside torch, 8 views 224 px, {faces} faces",
            ">= 6",
            "plain torch",
            times["ours"],
            times["torch"],
            "what a graphics card is given, on the CPU; the same pictures and gradient",
        )
    )


def exponent(sizes, times):
    """Of the power law through the CPU times."""
    return float(np.polyfit(np.log(sizes), np.log([times[size].cpu for size in sizes]), 1)[0])


def test_a_step_grows_no_faster_than_its_views(rows):
    points, triangles = torus_of(10000)
    views = (1, 2, 4, 8, 16, 32)
    times = take_turns({k: our_step(points, triangles, around(k))[0] for k in views}, rounds=7)
    told = ", ".join(f"{k}: {times[k].ms:.1f}" for k in views)
    rows.append(
        Row(
            "exponent of the views, 1 to 32",
            exponent(views, times),
            "<= 1.05",
            note=f"10000 faces; ms {told}",
        )
    )


def test_a_step_grows_no_faster_than_its_faces(rows):
    sizes = (2000, 5000, 10000, 20000, 50000, 100000)
    steps, counts = {}, []
    for size in sizes:
        points, triangles = torus_of(size)
        counts.append(len(triangles))
        steps[counts[-1]] = our_step(points, triangles, around())[0]
    times = take_turns(steps, rounds=7)
    told = ", ".join(f"{count}: {times[count].ms:.1f}" for count in counts)
    rows.append(
        Row("exponent of the faces, 2k to 100k", exponent(counts, times), "<= 1.05", note=f"ms {told}")
    )
