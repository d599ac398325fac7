import numpy as np
import pytest
import torch
from devices import DEVICES

from fabcraft.fit.gather import BLOCK, Places, take, total


def some(rows, places, seed=0):
    random = np.random.default_rng(seed)
    return torch.from_numpy(random.integers(0, places, rows)), torch.from_numpy(random.normal(size=(rows, 3)))


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize(("rows", "places"), [(0, 5), (40, 7), (4 * BLOCK + 3, 2), (3000, 3000)])
def test_the_total_of_a_place_is_the_sum_of_its_rows(rows, places, device):
    index, values = some(rows, places)
    expected = torch.zeros(places, 3, dtype=torch.float64).index_add(0, index, values)
    found = total(values.to(device), Places.of(index.to(device), places))
    torch.testing.assert_close(found.cpu(), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("device", DEVICES)
def test_runs_are_places_of_rows_in_order(device):
    lengths = torch.tensor([3, 0, 2 * BLOCK + 1, 1], device=device)
    runs = Places.runs(lengths)
    assert runs.index.bincount(minlength=4).tolist() == lengths.tolist()
    values = torch.arange(float(lengths.sum()), device=device).double()[:, None]
    sorted_by_hand = Places.of(runs.index, 4)
    torch.testing.assert_close(total(values, runs), total(values, sorted_by_hand))


@pytest.mark.parametrize("device", DEVICES)
def test_taking_and_adding_are_each_others_derivative(device):
    index, values = some(700, 5)
    places = Places.of(index.to(device), 5)
    table = torch.randn(5, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0)).to(device)
    table.requires_grad_(True)
    rows = values.to(device).requires_grad_(True)
    taken = take(table, places)
    assert torch.equal(taken, table[places.index])
    (by_table,) = torch.autograd.grad((taken * rows.detach()).sum(), table)
    torch.testing.assert_close(by_table, total(rows.detach(), places))
    (by_rows,) = torch.autograd.grad((total(rows, places) * table.detach()).sum(), rows)
    assert torch.equal(by_rows, table.detach()[places.index])


@pytest.mark.parametrize("device", DEVICES)
def test_sums_come_out_the_same_every_time(device):
    index, values = some(200_000, 300)
    places = Places.of(index.to(device), 300)
    sums = {total(values.to(device), places).cpu().numpy().tobytes() for _ in range(5)}
    assert len(sums) == 1
