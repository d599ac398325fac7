"""The same steps on a graphics card and on the CPU beside it; skipped, and said so, where there is none."""

from dataclasses import replace
from time import perf_counter

import numba
import numpy as np
import pytest
import torch
from encoders import full_size
from measure import Row, compared, take_turns
from peers import torch_render
from scenes import around, torus_of
from test_render_speed import OUTPUTS, derivative
from test_step_speed import sheet_of, worn_mask

from fabcraft.body.human import human
from fabcraft.fit import lift
from fabcraft.fit.body_terms import contacts_between
from fabcraft.fit.deform import deform
from fabcraft.fit.presets import PRESETS, for_text
from fabcraft.fit.render import Topology, render
from fabcraft.fit.views import ViewBank
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.frame import Frame
from fabcraft.geometry.poisson import PoissonSystem
from fabcraft.guidance.picture import PictureGuidance, targets_of
from fabcraft.guidance.text import TextGuidance
from fabcraft.mesh import Mesh

PEER = "the same on this machine's CPU"
STEPS = 12


def on_a_card(rows, name, aim=""):
    """What is compared; without a card the row says so and the benchmark is skipped."""
    if not torch.cuda.is_available():
        rows.append(Row(name, None, aim, PEER, note="skipped: no CUDA device on this machine"))
        pytest.skip("no CUDA device on this machine")
    return f"{torch.cuda.get_device_name()}; {numba.get_num_threads()} threads on the CPU"


def waited(step):
    """The step, done when the card has done it."""

    def whole():
        step()
        torch.cuda.synchronize()

    return whole


@pytest.mark.parametrize("faces", [2000, 10000, 40000, 100000])
def test_a_render_step_on_a_card(rows, faces):
    name = f"render step on a graphics card, 8 views 224 px, {faces} faces"
    card = on_a_card(rows, name)
    points, triangles = torus_of(faces)
    topology, cameras = Topology.of(triangles), around()

    def step_of(device, draw):
        vertices = torch.tensor(points, dtype=torch.float32, device=device, requires_grad=True)
        with torch.no_grad():
            wanted = render(1.03 * vertices, topology, cameras, OUTPUTS)
        return lambda: derivative(*draw(vertices), wanted.mask, wanted.shaded, vertices)

    def ours(vertices):
        images = render(vertices, topology, cameras, OUTPUTS)
        return images.mask, images.shaded

    steps = {"card": step_of("cuda", ours), "cpu": step_of("cpu", ours)}
    found, expected = steps["card"]().cpu(), steps["cpu"]()
    assert (found - expected).norm() < 1e-3 * expected.norm()
    torch.cuda.reset_peak_memory_stats()
    times = take_turns({"card": waited(steps["card"]), "cpu": steps["cpu"]}, rounds=9, warm=3)
    note = f"{card}; {torch.cuda.max_memory_allocated() / 2**20:.0f} MiB"
    rows.append(compared(name, "", PEER, times["card"], times["cpu"], note))


def test_a_drawing_of_the_torch_renderer_is_repeatable_on_a_card(rows):
    name = "render step on a graphics card, distinct gradients of 20 runs"
    on_a_card(rows, name, "<= 1")
    points, triangles = torus_of(10000)
    vertices = torch.tensor(points, dtype=torch.float32, device="cuda", requires_grad=True)
    found = set()
    for _ in range(20):
        mask, shaded = torch_render(vertices, Topology.of(triangles), around())
        (slope,) = torch.autograd.grad(mask.square().sum() + shaded.square().sum(), vertices)
        found.add(slope.cpu().numpy().tobytes())
    rows.append(Row(name, float(len(found)), "<= 1"))


@pytest.mark.parametrize("vertices", [2000, 10000, 40000])
def test_a_solve_for_fields_on_a_card(rows, vertices):
    name = f"Poisson for a field on a graphics card, {vertices} vertices"
    card = on_a_card(rows, name)
    points, faces = torus_of(2 * vertices)
    system = PoissonSystem.of(points / 90.0, faces)

    def step_of(device):
        restricted = torch.from_numpy(system.frames.copy()).float().to(device).requires_grad_(True)
        return lambda: torch.autograd.grad(
            system.vertices_of_restricted(restricted).square().sum(), restricted
        )

    times = take_turns({"card": waited(step_of("cuda")), "cpu": step_of("cpu")}, rounds=9)
    rows.append(compared(name, "", PEER, times["card"], times["cpu"], f"{card}; solved on the CPU in both"))


def ring(faces):
    """A bumpy ring around the neck of a man, and his skin."""
    points, triangles = torus_of(faces)
    body = human("man").mesh
    high = body.vertices[:, 2].max() - 260.0
    near = body.vertices[np.abs(body.vertices[:, 2] - high) < 15.0]
    middle = 0.5 * (near.min(0) + near.max(0))
    return Mesh(points * 0.9 + middle, triangles, "ring"), SurfaceDistance(body)


def step_ms(run):
    """Median time of a step of what `run(watch)` does."""
    stamps = []

    def watch(step, values, mesh):
        stamps.append(perf_counter())

    run(watch)
    return 1e3 * float(np.median(np.diff(stamps)[2:]))


@pytest.mark.parametrize("faces", [2000, 10000, 40000])
def test_a_deformation_step_on_a_card(rows, faces):
    name = f"step of a deformation on a graphics card, 8 views 224 px, {faces} faces"
    card = on_a_card(rows, name)
    rest, body = ring(faces)
    settings = replace(
        PRESETS["standard"], steps=STEPS, views=8, bank=16, chunk=8, pixels=224, remesh_every=0, settle=False
    )
    bank, contacts = ViewBank.around(rest, settings), contacts_between(rest, body, 60.0)
    wanted = torch.from_numpy(Frame.of(rest).inside(rest.vertices) * [1.1, 1.0, 1.2]).float()
    ms = {}
    for device in ("cuda", "cpu"):
        shown = targets_of(
            bank.chunks(wanted.to(device), Topology.of(rest.faces), ("shaded", "mask")), images=OUTPUTS
        )
        guidance = [PictureGuidance(shown)]
        named = {"body": body, "contacts": contacts, "guidance": guidance}
        chosen = replace(settings, device=device)
        ms[device] = step_ms(
            lambda watch, chosen=chosen, named=named: deform(rest, settings=chosen, watch=watch, **named)
        )
    note = f"{card}; pictures, body, contacts and shape"
    rows.append(Row(name, ms["cpu"] / ms["cuda"], "", PEER, ms["cuda"], ms["cpu"], note))


def test_a_step_of_the_lifted_fit_on_a_card(rows):
    name = "step of the lifted mask fit on a graphics card, one view of 224 px, 10000 faces"
    card = on_a_card(rows, name)
    template, body, relief = worn_mask()
    sheet, loops = sheet_of(template, 10000)
    targets = lift.LiftTargets(relief, body, template)
    ms = {
        device: step_ms(
            lambda watch, device=device: lift.fit_lifted(
                sheet, loops, targets, 2 * STEPS, 224, None, watch, device
            )
        )
        for device in ("cuda", "cpu")
    }
    rows.append(Row(name, ms["cpu"] / ms["cuda"], "", PEER, ms["cuda"], ms["cpu"], card))


def test_a_step_with_words_on_a_card(rows):
    name = "step of a deformation by words on a graphics card, 8 views 224 px, 10000 faces"
    card = on_a_card(rows, name)
    rest, body = ring(10000)
    settings = replace(
        PRESETS["standard"], steps=STEPS, views=8, bank=8, chunk=8, pixels=224, remesh_every=0, settle=False
    )
    encoder = full_size("cuda")
    guidance = [TextGuidance(encoder, "a crown", "a ring", consistency=False)]
    chosen = replace(for_text(settings), steps=STEPS, device="cuda")
    ms = step_ms(lambda watch: deform(rest, body=body, guidance=guidance, settings=chosen, watch=watch))
    pixels = torch.rand(8, 3, 224, 224, device="cuda", requires_grad=True)

    def alone():
        torch.autograd.grad(encoder.network.encode_image(pixels).sum(), pixels)

    encoded = take_turns({"alone": waited(alone)}, rounds=9, warm=3)["alone"].ms
    note = f"{card}; ViT-B/32 with random weights, body"
    rows.append(Row(name, ms / encoded, "", "the encoder alone", ms, encoded, note))
