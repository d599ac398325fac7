"""The variation of a field over neighbouring faces, and its derivative."""

import numpy as np
import pytest
import torch
import trimesh

from fabcraft.fit.neighbours import Neighbours
from fabcraft.geometry.operators import edge_faces


def test_variation_is_the_mean_squared_difference_of_every_pair():
    faces = trimesh.creation.icosphere(2).faces[:-40].astype(np.int32)  # some edges have one face only
    neighbours = Neighbours.of(faces)
    _, pairs = edge_faces(faces)
    inner = pairs[pairs[:, 1] >= 0]
    field = torch.from_numpy(np.random.default_rng(3).normal(size=(len(faces), 4)))
    expected = ((field[inner[:, 0]] - field[inner[:, 1]]) ** 2).sum(1).mean()
    assert neighbours.pairs == len(inner)
    assert float(neighbours.variation(field)) == pytest.approx(float(expected), rel=1e-12)
    assert torch.autograd.gradcheck(neighbours.variation, (field[:, :2].clone().requires_grad_(True),))


def test_a_face_without_neighbours_varies_from_nothing():
    alone = Neighbours.of(np.array([[0, 1, 2]], dtype=np.int32))
    assert alone.pairs == 0
    assert float(alone.variation(torch.ones(1, 3))) == 0.0
