"""The renderer in torch operations against the one on the CPU, on the CPU and, where there is one, on a graphics card."""

import numpy as np
import pytest
import torch
from devices import CUDA, DEVICES
from test_fit_render import CAMERAS, holed_sheet, plane_camera, sphere, torus

from fabcraft.fit.camera import Cameras, bank, front, orbit, stack
from fabcraft.fit.raster_torch import zbuffer
from fabcraft.fit.render import LIGHT, OUTPUTS, Topology, render
from fabcraft.fit.render_torch import Look, draw
from fabcraft.geometry.plane import Plane
from fabcraft.geometry.raster import rasterize

CORNERS = np.array([[x, y, z] for x in (-20.3, 19.9) for y in (-5, 5) for z in (-10.6, 15.2)], float)
BOX = [[0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 1, 3], [0, 3, 2]]
BOX += [[4, 6, 7], [4, 7, 5], [1, 5, 7], [1, 7, 3], [0, 2, 6], [0, 6, 4]]


def pieces():
    """A ball that cuts through a torus before a wall, and a sheet close to the wall."""
    ball, ball_faces = sphere(600, 30.0)
    ring, ring_faces = torus()
    wall = np.array([[-90.0, 70, -90], [90, 70, -90], [90, 70, 90], [-90, 70, 90]])
    squares = np.array([[0, 1, 2], [0, 2, 3]])
    parts = [
        (ball + [40.0, -20.0, 10.0], ball_faces),
        (ring, ring_faces),
        (wall, squares),
        (wall * [0.5, 0.99, 0.7], squares),
    ]
    starts = np.cumsum([0, *(len(points) for points, _ in parts)])
    faces = [indices + start for (_, indices), start in zip(parts, starts, strict=False)]
    return np.concatenate([points for points, _ in parts]), np.concatenate(faces).astype(np.int32)


def crumpled():
    """Faces without area, and faces with corners behind the camera."""
    vertices, faces = torus()
    vertices[faces[::7, 0]] = vertices[faces[::7, 1]]
    vertices[:40, 1] -= 400.0
    return vertices, faces


FAR = orbit((0.0, 0.0, 0.0), 260.0, 0.0, 0.0, 45.0, 112)
SCENES = {
    "closed, perspective": (torus(), CAMERAS[0]),
    "closed, orthographic": (torus(), CAMERAS[2]),
    "five views": (torus(), bank(5, (0.0, 0.0, 0.0), 95.0, resolution=96)),
    "a sheet with a hole, orthographic": (holed_sheet()[:2], plane_camera()),
    "a sheet with a hole, all around": (holed_sheet()[:2], bank(6, (0.0, 0.0, 0.0), 60.0, resolution=80)),
    "pieces behind and through each other": (
        pieces(),
        [FAR, orbit((0.0, 0.0, 0.0), 260.0, 25.0, 20.0, 45.0, 112)],
    ),
    "a few large faces": (
        (CORNERS, np.array(BOX, np.int32)),
        orbit((0.0, 0.0, 0.0), 60.0, 20.0, 30.0, 60.0, 200),
    ),
    "faces exactly edge-on": ((CORNERS, np.array(BOX, np.int32)), plane_camera()),
    "many faces a pixel": (sphere(12000, 40.0), front(Plane(-45.1, 46.3, 4.0, 23, 21))),
    "degenerate, and behind the camera": (crumpled(), FAR),
    "larger than the picture": (sphere(500, 200.0), orbit((0.0, 0.0, 0.0), 230.0, 10.0, 5.0, 60.0, 64)),
    "out of sight": ((torus()[0] + [0.0, 0.0, 5000.0], torus()[1]), FAR),
    "no faces": ((np.zeros((3, 3)), np.zeros((0, 3), np.int32)), FAR),
}


def together(cameras):
    return stack(cameras if isinstance(cameras, list | tuple) else [cameras])


def drawn(vertices, faces, cameras: Cameras, outputs=OUTPUTS, **named):
    towards = np.array(LIGHT) / np.linalg.norm(LIGHT) @ cameras.views[:, :3, :3]
    look = Look(torch.from_numpy(towards).to(vertices.device), 0.25, cameras.orthographic, tuple(outputs))
    topology = faces if isinstance(faces, Topology) else Topology.of(faces)
    return draw(vertices, topology, cameras, look, **named)


def weights(picture, seed=0):
    random = np.random.default_rng(seed)
    return torch.from_numpy(random.normal(size=picture.shape)).to(picture)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("scene", SCENES)
def test_pictures_and_gradients_are_those_of_the_other_renderer(scene, device):
    (points, faces), cameras = SCENES[scene]
    cameras = together(cameras)
    ours = torch.tensor(points, device=device, requires_grad=True)
    theirs = torch.tensor(points, requires_grad=True)
    face_id, pictures = drawn(ours, faces, cameras)
    expected = render(theirs, faces, cameras)
    assert torch.equal(face_id.cpu(), expected.face_id)
    for name in OUTPUTS:
        picture, wanted = pictures[name], expected.of(name)
        assert picture.shape == wanted.shape and picture.dtype == wanted.dtype
        # theirs are rounded to float32
        torch.testing.assert_close(picture.detach().cpu(), wanted.detach(), rtol=1e-6, atol=1e-5)
        (found,) = torch.autograd.grad((picture * weights(picture)).sum(), ours, retain_graph=True)
        (slope,) = torch.autograd.grad((wanted * weights(wanted)).sum(), theirs, retain_graph=True)
        assert torch.isfinite(found).all()
        assert (found.cpu() - slope).norm() <= 1e-6 * slope.norm(), name


@pytest.mark.parametrize("device", DEVICES)
def test_gradients_are_those_of_central_differences(device):
    vertices, faces, _ = holed_sheet(5, 16)
    vertices = vertices + np.random.default_rng(1).normal(0.0, 0.7, vertices.shape)
    cameras = together(bank(2, (0.0, 0.0, 0.0), 60.0, resolution=40))
    way = torch.from_numpy(np.random.default_rng(0).normal(size=vertices.shape)).to(device)
    points = torch.tensor(vertices, device=device, requires_grad=True)

    def energy(points):
        face_id, pictures = drawn(points, faces, cameras)
        return face_id, sum((pictures[name] * weights(pictures[name])).sum() for name in OUTPUTS)

    seen, value = energy(points)
    (slope,) = torch.autograd.grad(value, points)
    step = 1e-6
    with torch.no_grad():
        (ahead, more), (behind, less) = energy(points + step * way), energy(points - step * way)
    assert torch.equal(seen, ahead) and torch.equal(seen, behind)  # no pixel changes its face on the way
    assert float((slope * way).sum()) == pytest.approx(float(more - less) / (2 * step), rel=1e-5)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("scene", ["five views", "a few large faces", "pieces behind and through each other"])
def test_neither_another_run_nor_smaller_chunks_change_a_byte(scene, device):
    (points, faces), cameras = SCENES[scene]
    runs = []
    for most in (1 << 20, 1 << 20, 700):
        vertices = torch.tensor(points, dtype=torch.float32, device=device, requires_grad=True)
        face_id, pictures = drawn(vertices, faces, together(cameras), most=most)
        sum((picture**2).sum() for picture in pictures.values()).backward()
        made = [vertices.grad, face_id, *(pictures[name].detach() for name in OUTPUTS)]
        assert all(
            value.dtype == torch.float32
            for name, value in zip(("g", *OUTPUTS), made[:1] + made[2:], strict=True)
        )
        runs.append([value.cpu().numpy().tobytes() for value in made])
    assert runs[0] == runs[1] == runs[2]


@pytest.mark.parametrize("device", DEVICES)
def test_what_is_not_asked_for_is_not_made_and_the_rest_stays_the_same(device):
    (points, faces), cameras = SCENES["closed, perspective"]
    vertices = torch.tensor(points, device=device)
    _, every = drawn(vertices, faces, together(cameras))
    for outputs in (("mask",), ("depth",), ("shaded", "mask"), ("normal", "depth")):
        _, some = drawn(vertices, faces, together(cameras), outputs)
        assert list(some) == list(outputs)
        for name in outputs:
            torch.testing.assert_close(some[name], every[name], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("device", DEVICES)
def test_the_z_buffer_is_the_other_one_to_the_bit(device):
    random = np.random.default_rng(0)
    # on a half-pixel lattice: centres on edges and corners, equal depths, faces without area
    points = np.round(random.uniform(-4.0, 24.0, (300, 3)) * 2.0) / 2.0
    faces = random.integers(0, 300, (400, 3)).astype(np.int32)
    expected = rasterize(points, faces, 19, 21)
    screen = torch.from_numpy(points)[None].to(device)
    face_id, nearest = zbuffer(
        screen, screen[..., 2].clone(), torch.from_numpy(faces).long().to(device), 21, 19
    )
    assert np.array_equal(face_id[0].cpu().numpy(), expected.face_id)
    assert np.array_equal(nearest[0].cpu().numpy().astype(np.float32), expected.depth)


@pytest.mark.parametrize("device", [CUDA])
def test_vertices_on_a_graphics_card_are_drawn_there(device):
    (points, faces), cameras = SCENES["five views"]
    vertices = torch.tensor(points, dtype=torch.float32, device=device, requires_grad=True)
    images = render(vertices, faces, cameras)
    assert images.face_id.is_cuda and images.of("shaded").is_cuda
    expected = render(vertices.detach().cpu(), faces, cameras)
    assert (images.face_id.cpu() != expected.face_id).float().mean() < 1e-4
    assert (images.of("shaded").cpu() - expected.of("shaded")).abs().mean() < 1e-5
