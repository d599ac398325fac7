"""The renderer against areas that are known, and against a supersampled picture made in another way."""

from dataclasses import replace

import numba
import numpy as np
import pytest
import torch
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from fabcraft.errors import InputError
from fabcraft.fit.camera import bank, front, orbit, stack
from fabcraft.fit.render import LIGHT, OUTPUTS, Topology, render
from fabcraft.geometry.plane import Plane
from fabcraft.geometry.raster import rasterize


def grid_faces(rows, columns, wrap):
    i, j = np.meshgrid(np.arange(rows), np.arange(columns - (not wrap)), indexing="ij")
    i, j = (i if wrap else i[:-1]), (j if wrap else j[:-1])

    def at(a, b):
        return (a % rows) * columns + b % columns

    first = np.stack([at(i, j), at(i + 1, j), at(i + 1, j + 1)], -1).reshape(-1, 3)
    second = np.stack([at(i, j), at(i + 1, j + 1), at(i, j + 1)], -1).reshape(-1, 3)
    return np.concatenate([first, second]).astype(np.int32)


def sphere(faces, radius):
    """A globe of about `faces` triangles with its poles on the x axis."""
    meridians = round(np.sqrt(faces))
    parallels = faces // (2 * meridians)
    polar = np.pi * np.arange(1, parallels + 1) / (parallels + 1)
    around = 2 * np.pi * (np.arange(meridians) + 0.37) / meridians
    ring = np.stack(
        [
            np.cos(polar)[:, None] * np.ones(meridians),
            np.sin(polar)[:, None] * np.sin(around),
            np.sin(polar)[:, None] * np.cos(around),
        ],
        -1,
    ).reshape(-1, 3)
    quads = grid_faces(parallels, meridians, wrap=True)
    low, high = quads.min(1), quads.max(1)
    quads = quads[~((low < meridians) & (high >= (parallels - 1) * meridians))] if parallels > 2 else quads
    after = np.roll(np.arange(meridians), -1)
    last, pole = (parallels - 1) * meridians, parallels * meridians
    caps = [np.stack([np.arange(meridians), after, np.full(meridians, pole)], 1)[:, ::-1]]
    caps += [np.stack([last + np.arange(meridians), last + after, np.full(meridians, pole + 1)], 1)]
    vertices = radius * np.vstack([ring, [1.0, 0, 0], [-1.0, 0, 0]])
    triangles = np.vstack([quads, *caps]).astype(np.int32)
    corners = vertices[triangles]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return vertices, np.where(volume[:, None] < 0, triangles[:, ::-1], triangles)


def torus(rows=42, columns=24):
    u, v = np.meshgrid(
        2 * np.pi * np.arange(rows) / rows, 2 * np.pi * np.arange(columns) / columns, indexing="ij"
    )
    large, small = 60 + 8 * np.sin(3 * u) * np.cos(2 * v), 25 + 4 * np.sin(5 * v + 2 * u)
    x, y = (large + small * np.cos(v)) * np.cos(u), (large + small * np.cos(v)) * np.sin(u)
    upright = np.stack([x, y, small * np.sin(v)], -1).reshape(-1, 3)
    # Tilted, since the near and the far rim of an upright one would hide behind each other exactly.
    turn = Rotation.from_euler("xyz", [50.0, 17.0, 31.0], degrees=True).as_matrix()
    return upright @ turn.T, grid_faces(rows, columns, wrap=True)


def holed_sheet(rings=12, sides=48):
    """A square plate, 80 mm wide, bent back at its sides, and the indices of the rim of its hole."""
    angle = 2 * np.pi * (np.arange(sides) + 0.21) / sides
    circle = np.stack([np.cos(angle), np.sin(angle)], 1)
    outer = 40 * circle / np.abs(circle).max(1, keepdims=True)
    share = np.linspace(0, 1, rings)[:, None, None]
    flat = ((1 - share) * 20 * circle + share * outer).reshape(-1, 2)
    vertices = np.stack([flat[:, 0], 0.004 * (flat**2).sum(1), flat[:, 1]], 1)
    i, j = np.meshgrid(np.arange(rings - 1), np.arange(sides), indexing="ij")
    a, b = i * sides + j, i * sides + (j + 1) % sides
    faces = np.concatenate([np.stack([a, a + sides, b + sides], -1), np.stack([a, b + sides, b], -1)])
    return vertices, faces.reshape(-1, 3).astype(np.int32), np.arange(sides)


def polygon_area(points):
    x, z = points.T
    return 0.5 * abs((x * np.roll(z, -1) - z * np.roll(x, -1)).sum())


def outline_area(vertices):
    """Area of the front view of a convex body."""
    return ConvexHull(vertices[:, [0, 2]]).volume


def plane_camera(pixel_mm=1.0, half_mm=50.0):
    pixels = round(2 * half_mm / pixel_mm)
    return front(Plane(-half_mm - 0.13, half_mm + 0.29, pixel_mm, pixels + 1, pixels + 1))


def supersampled(vertices, faces, camera, fine):
    """Box-filtered pictures without antialiasing, fine² points a pixel, from the z-buffer and numpy alone."""
    large = replace(camera, width=camera.width * fine, height=camera.height * fine)
    screen = large.project(torch.tensor(vertices)).numpy()
    key = screen.copy()
    if not camera.orthographic:
        key[:, 2] = -1 / screen[:, 2]
    seen = rasterize(key, faces, large.width, large.height)
    hit = seen.face_id >= 0
    shown = faces[seen.face_id[hit]]
    weights = seen.barycentric[hit].astype(float)
    if not camera.orthographic:
        weights = weights / screen[shown, 2]
    weights = weights / weights.sum(1, keepdims=True)
    across = np.cross(
        vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]]
    )
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], across)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    eye = -camera.view[:3, :3].T @ camera.view[:3, 3]
    towards = -camera.view[2, :3] if camera.orthographic else eye - vertices[faces[:, 0]]
    sign = np.sign((across * towards).sum(1))[seen.face_id[hit]]
    normal = sign[:, None] * np.einsum("nc,nci->ni", weights, normals[shown])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    light = np.array(LIGHT) / np.linalg.norm(LIGHT) @ camera.view[:3, :3]
    pictures = {
        "mask": np.ones(len(shown)),
        "depth": (weights * screen[shown, 2]).sum(1),
        "normal": normal,
        "shaded": 0.25 + 0.75 * np.maximum(0, normal @ light),
    }

    def pool(values):
        whole = np.zeros((*hit.shape, *values.shape[1:]))
        whole[hit] = values
        return whole.reshape(camera.height, fine, camera.width, fine, *values.shape[1:]).mean((1, 3))

    return {name: pool(values) for name, values in pictures.items()}


@pytest.mark.parametrize("faces", [200, 2000, 10000])
def test_the_silhouette_of_a_sphere_has_its_area(faces):
    vertices, triangles = sphere(faces, 40.0)
    area = render(torch.tensor(vertices), triangles, plane_camera(), ("mask",)).mask.sum().item()
    assert area == pytest.approx(outline_area(vertices), rel=0.005)
    if faces == 10000:
        assert area == pytest.approx(np.pi * 40**2, rel=0.01)


@pytest.mark.parametrize("faces", [200, 2000, 10000])
def test_the_area_of_a_sphere_grows_with_its_scale_as_it_should(faces):
    vertices, triangles = sphere(faces, 40.0)
    scale = torch.tensor(1.0, dtype=torch.float64, requires_grad=True)
    render(scale * torch.tensor(vertices), triangles, plane_camera(), ("mask",)).mask.sum().backward()
    assert scale.grad.item() == pytest.approx(2 * outline_area(vertices), rel=0.02)


def test_the_perspective_silhouette_of_a_sphere_has_its_area():
    vertices, triangles = sphere(10000, 40.0)
    camera = orbit((0.0, 0.0, 0.0), 160.0, 25.0, 10.0, 45.0, 160)
    area = render(torch.tensor(vertices), triangles, camera, ("mask",)).mask.sum().item()
    radius = camera.focal * 80 * 40 / np.sqrt(160**2 - 40**2)
    assert area == pytest.approx(np.pi * radius**2, rel=0.01)


def test_depth_and_normal_of_a_sphere_are_those_of_the_sphere():
    vertices, triangles = sphere(10000, 40.0)
    plane = Plane(-50.0, 50.0, 1.0, 100, 100)
    images = render(torch.tensor(vertices), triangles, front(plane))
    x, z = plane.centres()
    inside = x**2 + z**2 < 35**2
    y = -np.sqrt(40**2 - x[inside] ** 2 - z[inside] ** 2)
    assert np.abs(images.depth[0].numpy()[inside] - y).max() < 0.15
    normal = np.stack([x[inside], y, z[inside]], 1) / 40
    assert np.abs(images.normal[0].numpy()[inside] - normal).max() < 0.02


CAMERAS = [
    orbit((0.0, 0.0, 0.0), 260.0, 20.0, 25.0, 45.0, 112),
    orbit((0.0, 0.0, 0.0), 260.0, 140.0, 60.0, 45.0, 112),
    front(Plane(-100.0, 95.0, 1.8, 112, 106)),
]


@pytest.mark.parametrize("camera", CAMERAS)
def test_pictures_agree_with_a_supersampled_render(camera):
    vertices, faces = torus()
    images, expected = render(torch.tensor(vertices), faces, camera), supersampled(vertices, faces, camera, 8)
    covered = expected["mask"].sum()
    for name, limit in {"mask": 0.005, "depth": 1.0, "normal": 0.02, "shaded": 0.01}.items():
        error = np.abs(getattr(images, name)[0].numpy() - expected[name]).sum() / covered
        assert error < limit, (name, error)


def test_directional_derivatives_agree_with_a_supersampled_render():
    vertices, faces = torus()
    topology, random, step = Topology.of(faces), np.random.default_rng(0), 0.5
    found, expected = {name: [] for name in OUTPUTS}, {name: [] for name in OUTPUTS}
    for camera in CAMERAS:
        ramp_x, ramp_y = np.meshgrid(np.linspace(0, 3, camera.width), np.linspace(0, 3, camera.height))
        for _ in range(4):
            weight = 1 + 0.5 * np.sin(
                ramp_x * random.normal() + ramp_y * random.normal() + random.uniform(0, 6)
            )
            tint = random.normal(size=3)
            way = np.sin(vertices @ random.normal(size=(3, 3)) / 40 + random.uniform(0, 6, 3))
            way = way @ random.normal(size=(3, 3))
            points = torch.tensor(vertices, requires_grad=True)
            images = render(points, topology, camera)
            ahead = supersampled(vertices + step * way, faces, camera, 6)
            behind = supersampled(vertices - step * way, faces, camera, 6)
            for name in OUTPUTS:
                factor = weight[..., None] * tint if name == "normal" else weight
                total = (getattr(images, name)[0] * torch.tensor(factor)).sum()
                (slope,) = torch.autograd.grad(total, points, retain_graph=True)
                found[name].append((slope.numpy() * way).sum())
                expected[name].append(((ahead[name] - behind[name]) * factor).sum() / (2 * step))
    for name in OUTPUTS:
        ours, theirs = np.array(found[name]), np.array(expected[name])
        slope = ours @ theirs / (theirs @ theirs)
        error = np.linalg.norm(ours - theirs) / np.linalg.norm(theirs)
        assert abs(slope - 1) < 0.05 and error < 0.15, (name, slope, error)


def test_an_open_sheet_with_a_hole_has_its_area():
    vertices, faces, rim = holed_sheet()
    expected = polygon_area(vertices[-len(rim) :, [0, 2]]) - polygon_area(vertices[rim][:, [0, 2]])
    for winding in (faces, faces[:, ::-1]):
        mask = render(torch.tensor(vertices), winding, plane_camera(), ("mask",)).mask
        assert mask.sum().item() == pytest.approx(expected, rel=0.002)


def test_widening_the_hole_takes_its_area_away():
    vertices, faces, rim = holed_sheet()
    scale = torch.tensor(1.0, dtype=torch.float64, requires_grad=True)
    points = torch.tensor(vertices)
    grown = points[rim] * torch.stack([scale, scale**0, scale])
    moved = points.index_put((torch.as_tensor(rim),), grown)
    render(moved, faces, plane_camera(), ("mask",)).mask.sum().backward()
    assert scale.grad.item() == pytest.approx(-2 * polygon_area(vertices[rim][:, [0, 2]]), rel=0.02)


def test_shifting_the_hole_moves_the_mask_and_not_its_area():
    vertices, faces, rim = holed_sheet()
    camera = plane_camera()
    shift = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    points = torch.tensor(vertices)
    moved = points.index_put((torch.as_tensor(rim),), points[rim] + shift)
    mask = render(moved, faces, camera, ("mask",)).mask[0]
    hole = polygon_area(vertices[rim][:, [0, 2]])
    column = torch.arange(camera.width, dtype=torch.float64) + 0.5
    (area_slope,) = torch.autograd.grad(mask.sum(), shift, retain_graph=True)
    (moment_slope,) = torch.autograd.grad((mask * column).sum(), shift)
    assert abs(area_slope[0].item()) < 0.01 * hole / 20
    # d/dshift of -(integral of the column over the hole) = -(area of the hole)
    assert moment_slope[0].item() == pytest.approx(-hole, rel=0.02)


def test_both_sides_of_a_sheet_are_lit_alike():
    vertices, faces, _ = holed_sheet()
    outside = render(torch.tensor(vertices), faces, plane_camera())
    inside = render(torch.tensor(vertices), np.ascontiguousarray(faces[:, ::-1]), plane_camera())
    assert torch.allclose(outside.normal, inside.normal, atol=1e-5)
    assert torch.allclose(outside.shaded, inside.shaded, atol=1e-5)
    assert (outside.normal[..., 1] <= 1e-6).all()  # towards the viewer, who looks along +y


def test_a_box_seen_exactly_from_the_front_has_a_silhouette():
    corners = np.array([[x, y, z] for x in (-20.3, 19.9) for y in (-5, 5) for z in (-10.6, 15.2)], float)
    faces = [[0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 1, 3], [0, 3, 2]]
    faces += [[4, 6, 7], [4, 7, 5], [1, 5, 7], [1, 7, 3], [0, 2, 6], [0, 6, 4]]
    scale = torch.tensor(1.0, dtype=torch.float64, requires_grad=True)
    area = render(scale * torch.tensor(corners), np.array(faces), plane_camera(), ("mask",)).mask.sum()
    area.backward()
    assert area.item() == pytest.approx(40.2 * 25.8, rel=1e-3)
    assert scale.grad.item() == pytest.approx(2 * 40.2 * 25.8, rel=0.02)


def test_a_rim_in_front_of_another_surface_is_a_rim():
    vertices, faces = sphere(2000, 20.0)
    wall = np.array([[-90.0, 60, -90], [90, 60, -90], [90, 60, 90], [-90, 60, 90]])
    both = np.vstack([vertices, wall])
    all_faces = np.vstack([faces, np.array([[0, 1, 2], [0, 2, 3]]) + len(vertices)]).astype(np.int32)
    scale = torch.tensor(1.0, dtype=torch.float64, requires_grad=True)
    points = torch.cat([scale * torch.tensor(vertices), torch.tensor(wall)])
    images = render(points, all_faces, plane_camera(), ("mask", "depth"))
    assert torch.allclose(images.mask, torch.ones_like(images.mask), atol=1e-6)
    images.depth.sum().backward()
    step = 0.05
    ahead, behind = (
        supersampled(
            both * np.r_[np.full(len(vertices), k), np.ones(4)][:, None], all_faces, plane_camera(), 6
        )
        for k in (1 + step, 1 - step)
    )
    slope = (ahead["depth"] - behind["depth"]).sum() / (2 * step)
    assert scale.grad.item() == pytest.approx(slope, rel=0.03)


@pytest.mark.parametrize("views", [1, 8])
def test_two_runs_give_identical_bytes(views):
    vertices, faces = torus()
    cameras = stack(bank(views, (0.0, 0.0, 0.0), 95.0, resolution=96))
    runs = []
    for _ in range(2):
        points = torch.tensor(vertices, dtype=torch.float32, requires_grad=True)
        images = render(points, faces, cameras)
        sum((getattr(images, name) ** 2).sum() for name in OUTPUTS).backward()
        runs.append([points.grad, images.face_id, *(getattr(images, name).detach() for name in OUTPUTS)])
    for first, second in zip(*runs, strict=True):
        assert first.numpy().tobytes() == second.numpy().tobytes()


def test_the_number_of_threads_changes_no_byte():
    vertices, faces = torus()
    grads = []
    before = numba.get_num_threads()
    for threads in (1, before):
        numba.set_num_threads(threads)
        points = torch.tensor(vertices, requires_grad=True)
        images = render(points, faces, CAMERAS[0])
        sum((getattr(images, name) ** 2).sum() for name in OUTPUTS).backward()
        grads.append(points.grad.numpy().tobytes())
    numba.set_num_threads(before)
    assert grads[0] == grads[1]


def test_stacked_views_are_the_views_one_by_one():
    vertices, faces = torus()
    cameras = bank(8, (0.0, 0.0, 0.0), 95.0, resolution=64)
    together = render(torch.tensor(vertices), faces, cameras)
    for k, camera in enumerate(cameras):
        alone = render(torch.tensor(vertices), faces, camera)
        assert torch.equal(together.face_id[k], alone.face_id[0])
        for name in OUTPUTS:
            assert torch.equal(getattr(together, name)[k], getattr(alone, name)[0])


def test_an_empty_view_is_black_and_pulls_at_nothing():
    vertices, faces = torus()
    points = torch.tensor(vertices + np.array([0.0, 0.0, 5000.0]), requires_grad=True)
    images = render(points, faces, [CAMERAS[0], CAMERAS[1]])
    sum(getattr(images, name).sum() for name in OUTPUTS).backward()
    assert (images.face_id == -1).all() and images.mask.sum() == 0
    assert (points.grad == 0).all()


def test_a_mesh_without_faces_is_an_empty_view():
    points = torch.zeros(3, 3, requires_grad=True)
    images = render(points, np.zeros((0, 3), np.int32), CAMERAS[0])
    images.shaded.sum().backward()
    assert images.mask.sum() == 0 and (points.grad == 0).all()


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_gradients_are_finite_for_degenerate_faces_and_points_behind_the_camera(dtype):
    vertices, faces = torus()
    vertices = np.round(vertices / 8) * 8  # many faces without area
    vertices[:40, 1] -= 400.0  # some of it behind the camera
    points = torch.tensor(vertices, dtype=dtype, requires_grad=True)
    images = render(points, faces, orbit((0.0, 0.0, 0.0), 260.0, 0.0, 0.0, 45.0, 112))
    sum(getattr(images, name).sum() for name in OUTPUTS).backward()
    assert images.depth.dtype == dtype and images.mask.sum() > 100
    assert all(torch.isfinite(getattr(images, name)).all() for name in OUTPUTS)
    assert torch.isfinite(points.grad).all() and points.grad.abs().sum() > 0


def test_only_what_is_asked_for_is_made_and_it_stays_the_same():
    vertices, faces = torus()
    every = render(torch.tensor(vertices), faces, CAMERAS[0])
    some = render(torch.tensor(vertices), faces, CAMERAS[0], ("depth",))
    assert some.mask is None and some.normal is None and some.shaded is None
    assert torch.equal(some.depth, every.depth)
    with pytest.raises(InputError):
        render(torch.tensor(vertices), faces, CAMERAS[0], ("colour",))


def test_descending_the_mask_finds_the_shift_of_a_sphere():
    vertices, faces = sphere(2000, 25.0)
    topology, camera = Topology.of(faces), plane_camera()
    target = render(torch.tensor(vertices + np.array([6.0, 0.0, -4.0])), topology, camera, ("mask",)).mask
    shift = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    optimiser = torch.optim.Adam([shift], lr=0.4)
    for _ in range(60):
        optimiser.zero_grad()
        mask = render(torch.tensor(vertices) + shift, topology, camera, ("mask",)).mask
        (mask - target).square().mean().backward()
        optimiser.step()
    assert torch.allclose(shift.detach(), torch.tensor([6.0, 0.0, -4.0], dtype=torch.float64), atol=0.1)


def test_the_topology_of_a_sheet_knows_its_border():
    topology = Topology.of(np.array([[0, 1, 2], [2, 1, 3]]))
    assert len(topology.edges) == 5
    inner = topology.edges[(topology.edges[:, 3] >= 0)]
    assert inner.tolist() == [[1, 2, 3, 0]]
    with pytest.raises(ValueError):
        topology.faces[0, 0] = 1
