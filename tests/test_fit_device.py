"""The parts of a fit on a graphics card, where there is one, against the same on the CPU; and what a word chooses."""

from dataclasses import replace

import numpy as np
import pytest
import tiny_clip
import torch
from devices import CUDA, DEVICES
from test_fit_optimize import placed
from test_fit_render_torch import drawn
from worn import ball, band, limb, lumpy, torus

from fabcraft.body.human import human
from fabcraft.errors import InputError, MissingError
from fabcraft.fit import views
from fabcraft.fit.body_field import BodyField
from fabcraft.fit.body_terms import MovingDistance, contact_term, penetration_term
from fabcraft.fit.deform import deform
from fabcraft.fit.descend import State
from fabcraft.fit.mirror import Mirror
from fabcraft.fit.optimize import FitSettings, fit
from fabcraft.fit.presets import PRESETS, DeformWeights, for_text
from fabcraft.fit.refit import refitted
from fabcraft.fit.render import Images
from fabcraft.fit.shape_terms import shape_terms
from fabcraft.fit.topology import Topology
from fabcraft.fit.views import ViewBank
from fabcraft.geometry.device import device_of
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.frame import Frame
from fabcraft.geometry.poisson import PoissonSystem, nearest_links
from fabcraft.guidance.clip import load_clip
from fabcraft.guidance.inflate import inflate
from fabcraft.guidance.picture import PictureGuidance, targets_of
from fabcraft.guidance.target_points import TargetPoints
from fabcraft.guidance.text import TextGuidance
from fabcraft.mesh import concatenate
from fabcraft.template.mask import mask

FINGER = SurfaceDistance(limb(9.0, 9.0))
SUNK = torus(7.5, 1.5)  # its inner side is 3 mm inside the finger
FRAME = Frame.of(SUNK)
SHORT = replace(PRESETS["draft"], steps=60, views=3, bank=6, chunk=2, pixels=64)


def inside(mesh, frame=FRAME):
    return torch.from_numpy(frame.inside(mesh.vertices)).float()


def shaken(mesh, share=0.02):
    random = np.random.default_rng(0)
    return mesh.with_vertices(
        mesh.vertices + random.normal(0.0, share * mesh.size_mm.max(), mesh.vertices.shape)
    )


def test_a_word_chooses_a_device_that_is_there():
    there = torch.cuda.is_available()
    assert device_of("cpu").type == "cpu" and device_of("auto").type == ("cuda" if there else "cpu")
    if there:
        assert device_of("cuda").type == "cuda"
    else:
        with pytest.raises(MissingError, match="finds none"):
            device_of("cuda")
        with pytest.raises(MissingError):
            deform(SUNK, settings=replace(SHORT, device="cuda"))


def test_another_word_is_refused():
    with pytest.raises(InputError, match="device 'gpu'"):
        device_of("gpu")


@pytest.mark.parametrize("device", DEVICES)
def test_a_solve_and_its_gradient_stay_where_they_belong(device):
    parts = concatenate([SUNK, SUNK.with_vertices(SUNK.vertices + [0.0, 0.0, 5.0])])
    points = FRAME.inside(parts.vertices)
    system = PoissonSystem.of(points, parts.faces, nearest_links(points, parts.faces))
    generator = torch.Generator().manual_seed(0)
    field = torch.randn(len(parts.faces), 3, 2, generator=generator)
    pull = torch.randn(len(points), 3, generator=generator)
    found = []
    for place in ("cpu", device):
        restricted = field.to(place).requires_grad_(True)
        vertices = system.vertices_of_restricted(restricted)
        (slope,) = torch.autograd.grad((vertices * pull.to(place)).sum(), restricted)
        assert vertices.device.type == slope.device.type == place
        found.append((vertices.detach().cpu(), slope.cpu()))
    for theirs, ours in zip(*found, strict=True):
        torch.testing.assert_close(ours, theirs)


@pytest.mark.parametrize("device", DEVICES)
def test_distances_to_a_body_are_those_of_the_cpu(device):
    points = torch.tensor(shaken(SUNK).vertices).float()
    lower, upper = points.amin(0).double().numpy() - 3.0, points.amax(0).double().numpy() + 3.0
    found = []
    for place in ("cpu", device):
        here = points.to(place).requires_grad_(True)
        field = BodyField.around(FINGER, lower, upper, 1.0, place)(here)
        moving = MovingDistance(FINGER, FRAME)(here * FRAME.scale, np.zeros(len(points)))
        (slope,) = torch.autograd.grad(field.sum() + moving.square().sum(), here)
        assert field.device.type == moving.device.type == place
        found.append([value.detach().cpu() for value in (field, moving, slope)])
    for theirs, ours in zip(*found, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("device", DEVICES)
def test_every_term_and_its_gradient_are_those_of_the_cpu(device):
    system = PoissonSystem.of(FRAME.inside(SUNK.vertices), SUNK.faces)
    lock = np.linspace(0.0, 1.0, len(SUNK.faces))
    everything = DeformWeights(**dict.fromkeys(DeformWeights.__dataclass_fields__, 1.0))
    moved = inside(shaken(SUNK))
    restricted = torch.from_numpy(system.restricted(moved.double().numpy())).float()
    found = []
    for place in ("cpu", device):
        positions = moved.to(place).requires_grad_(True)
        state = State(system, positions, restricted.to(place).requires_grad_(True), 0)
        terms = shape_terms(system, everything, lock, FRAME.inside(SUNK.vertices), place)
        clearance = np.full(len(SUNK.vertices), 0.3)
        functions = {term.name: term.function for term in terms}
        functions["penetration"] = penetration_term(FINGER, SUNK, clearance, FRAME, place)
        functions["contact"] = contact_term(band(9.0), SUNK.faces, FRAME, place)
        told = {}
        for name, function in functions.items():
            value = function(state)
            slopes = torch.autograd.grad(value, (positions, state.restricted), allow_unused=True)
            assert value.device.type == place
            told[name] = [value.detach().cpu(), *(slope.cpu() for slope in slopes if slope is not None)]
        found.append(told)
    assert len(found[0]) == 8
    for name, theirs in found[0].items():
        for ours, expected in zip(found[1][name], theirs, strict=True):
            assert (ours - expected).norm() <= 1e-4 * expected.norm() and expected.norm() > 0.0, name


@pytest.mark.parametrize("device", DEVICES)
def test_the_bank_sees_what_it_sees_on_the_cpu(device):
    bank, outputs = ViewBank.around(SUNK, SHORT), ("mask", "depth", "normal", "shaded")
    for seen, expected in zip(
        *(bank.chunks(inside(SUNK).to(place), Topology.of(SUNK.faces), outputs) for place in (device, "cpu")),
        strict=True,
    ):
        assert (seen.visible.cpu() == expected.visible).float().mean() > 0.999
        torch.testing.assert_close(seen.pixels.cpu(), expected.pixels, rtol=1e-4, atol=1e-4)
        assert torch.equal(seen.faces.cpu(), expected.faces)
        for name in outputs:
            picture, wanted = getattr(seen, name), getattr(expected, name)
            assert picture.device.type == device and (picture.cpu() - wanted).abs().mean() < 1e-4


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    return tiny_clip.save(tmp_path_factory.mktemp("tiny"))


@pytest.mark.parametrize("device", DEVICES)
def test_an_encoder_reads_what_it_reads_on_the_cpu(checkpoint, device):
    pictures = torch.rand(3, 48, 48, generator=torch.Generator().manual_seed(0))
    found = []
    for place in ("cpu", device):
        model = load_clip(checkpoint, place)
        pixels = pictures.to(place).requires_grad_(True)
        vectors, patches = model.encode_images(pixels), model.patch_features(pixels)
        (slope,) = torch.autograd.grad(vectors[:, 0].sum() + patches.square().mean(), pixels)
        assert slope.device.type == place
        found.append(
            [value.detach().cpu() for value in (vectors, patches, slope, model.encode_text(["a cat"]))]
        )
    for theirs, ours in zip(*found, strict=True):
        assert (ours - theirs).norm() <= 0.01 * theirs.norm()


@pytest.mark.parametrize("device", [CUDA])
def test_a_ring_leaves_the_finger_on_every_device_the_same_way_every_time(device):
    target = lumpy(torus(10.9, 1.5))
    bank = ViewBank.around(SUNK, SHORT)
    shown = targets_of(
        bank.chunks(inside(target).to(device), Topology.of(target.faces), ("shaded", "mask")),
        images=("mask",),
    )
    guidance = [TargetPoints.of(refitted(target, None, FINGER, 0.2, 0.0), SUNK), PictureGuidance(shown)]

    def run(place):
        settings = replace(SHORT, device=place)
        return deform(SUNK, body=FINGER, contacts=band(9.0), guidance=guidance, settings=settings)

    first, second, other = run(device), run(device), run("cpu")
    assert first.pen_max_mm <= 0.05 and first.contact_rms_mm < 0.3
    assert first.mesh.vertices.tobytes() == second.mesh.vertices.tobytes()
    assert first.history == second.history
    ends = [found.history["total"][-1] for found in (first, other)]
    assert ends[0] == pytest.approx(ends[1], rel=0.1)


def test_a_fit_ends_at_the_same_place_whichever_renderer_draws_it(monkeypatch):
    rest, egg = ball(20.0, 2), ball(20.0, 3)
    egg = egg.with_vertices(egg.vertices * [0.8, 0.9, 1.3])
    settings = replace(SHORT, steps=30, remesh_every=0, settle=False, device="cpu")
    frame, bank = Frame.of(rest), ViewBank.around(rest, settings)
    shown = targets_of(bank.chunks(inside(egg, frame), Topology.of(egg.faces), ("shaded", "mask", "normal")))
    plane = Mirror(np.zeros(3), np.array([1.0, 0.0, 0.0]))

    def run():
        return deform(rest, guidance=[PictureGuidance(shown)], settings=settings, mirror=plane).mesh.vertices

    expected, asked = run(), []

    def by_torch(vertices, topology, cameras, outputs):
        asked.append(len(cameras.views))
        face_id, pictures = drawn(vertices, topology, cameras, outputs)
        return Images(face_id, **pictures)

    monkeypatch.setattr(views, "render", by_torch)
    np.testing.assert_allclose(run(), expected, atol=0.02)
    assert sum(asked) == 30 * settings.views
    assert np.abs(expected - rest.vertices).max() > 2.0


@pytest.mark.parametrize("device", DEVICES)
def test_words_guide_on_every_device(checkpoint, device):
    model = load_clip(checkpoint, device)
    rest = ball(20.0, 2)
    settings = replace(
        for_text(replace(SHORT, steps=12, views=4)), device=device, settle=False, remesh_every=0
    )
    guidance = TextGuidance(model, "a cat", "a ball")
    found = deform(rest, guidance=[guidance], settings=settings)
    likeness = np.array(found.history["clip"]) + np.array(found.history["direction"])
    assert np.isfinite(found.history["total"]).all() and likeness[8:].mean() < likeness[:4].mean()


@pytest.mark.parametrize("device", [CUDA])
def test_a_mask_is_fitted_on_a_graphics_card(device):
    template = mask(human("woman"))
    relief, body = inflate(placed(template), template), SurfaceDistance(template.body.mesh)
    settings = FitSettings(flat_steps=60, lifted_steps=40, pixels=160, device=device)
    runs = [fit(template, relief, settings, body) for _ in range(2)]
    assert runs[0].mesh.vertices.tobytes() == runs[1].mesh.vertices.tobytes()
    expected = fit(template, relief, replace(settings, device="cpu"), body)
    missed = SurfaceDistance(expected.mesh).closest(runs[0].mesh.vertices).distances
    assert np.quantile(missed, 0.95) < 0.5
