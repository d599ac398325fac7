"""Signed distance to a body in the loop: the sampled field against the exact one."""

import numpy as np
import torch
from measure import Row, compared, take_turns

from fabcraft.body.human import human
from fabcraft.fit.body_field import BodyField
from fabcraft.geometry.distance import SurfaceDistance


def test_the_field_beside_the_exact_distance(rows):
    mesh = human("man").mesh
    distance = SurfaceDistance(mesh)
    random = np.random.default_rng(0)
    head = mesh.vertices[:, 2] > mesh.vertices[:, 2].max() - 250.0
    chosen = random.choice(np.flatnonzero(head[mesh.faces].all(1)), 5000)
    points = mesh.vertices[mesh.faces[chosen]].mean(1)
    points = points + random.uniform(-5.0, 40.0, (5000, 1)) * mesh.face_normals[chosen]
    field = BodyField.around(distance, points.min(0) - 6.0, points.max(0) + 6.0, cell_mm=4.0)
    asked = torch.from_numpy(points).float().requires_grad_(True)

    def sampled():
        torch.autograd.grad(torch.relu(2.0 - field(asked)).square().mean(), asked)

    def exact():
        signed, away = distance.signed_with_gradient(points)
        return (np.maximum(2.0 - signed, 0.0) * -2.0 / len(signed))[:, None] * away

    times = take_turns({"field": sampled, "exact": exact}, rounds=9)
    with torch.no_grad():
        error = np.abs(field(asked).numpy() - distance.signed(points))
    note = (
        f"4 mm cells: off by {error.mean():.2f} mm on average, {np.quantile(error, 0.99):.2f} at most in 99 %"
    )
    rows.append(
        compared(
            "distance to the body, 5000 points, with gradient",
            ">= 4",
            "exact distance",
            times["field"],
            times["exact"],
            note,
        )
    )
    rows.append(Row("error of the sampled distance, mm", float(error.mean()), "<= 0.2", "exact distance"))
