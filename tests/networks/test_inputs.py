"""Windows are cut from whole maps, and batches of them share these."""

from __future__ import annotations

import torch

from svbrdfgan.networks.inputs import Inputs, Wholes, window_of


def ramp(rows: int, cols: int) -> torch.Tensor:
    """Each texel's own place, over the sides of the map."""
    v, u = ((torch.arange(side) + 0.5) / side for side in (rows, cols))
    return torch.stack(torch.meshgrid(v, u, indexing="ij"), dim=-1).unsqueeze(0)


def test_windows_have_the_values_of_their_places() -> None:
    place = torch.tensor([[0.25, 0.5, 0.25, 0.125], [0.5, 0.25, 0.25, 0.5]])
    found = window_of(ramp(32, 64).expand(2, -1, -1, -1), place, 48, 24)
    for (row, col, rows, cols), values in zip(place.tolist(), found, strict=True):
        own = torch.tensor([row, col]) + ramp(48, 24)[0] * torch.tensor([rows, cols])
        texel = torch.tensor([1 / 32, 1 / 64])
        torch.testing.assert_close(values / texel, own / texel, atol=0.05, rtol=0.0)  # torch's cubics bend slopes
    whole = torch.rand(1, 8, 8, 3, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(window_of(whole, torch.tensor([[0.0, 0.0, 1.0, 1.0]]), 8, 8), whole)


def one(value: float, whole: torch.Tensor) -> Inputs:
    wholes = Wholes(whole, torch.tensor([0]), torch.tensor([[value, 0.0, 0.5, 0.5]]))
    return Inputs(torch.full((1, 2, 4, 4), value), wholes)


def test_batches_hold_each_whole_map_once() -> None:
    first, second = torch.zeros(1, 2, 4, 4), torch.ones(1, 2, 4, 4)
    wholes = [first, second, first, second, second]
    joined = Inputs.joined([one(n / 8, whole) for n, whole in enumerate(wholes)]).to(torch.device("cpu"))
    assert joined.wholes is not None
    assert joined.wholes.geometry.shape == (2, 2, 4, 4)
    assert joined.wholes.of.tolist() == [0, 1, 0, 1, 1]
    picked = joined.pick(torch.tensor([3, 2]))
    assert picked.wholes is not None
    assert picked.wholes.of.tolist() == [1, 0]
    assert picked.wholes.place[:, 0].tolist() == picked.geometry[:, 0, 0, 0].tolist() == [0.375, 0.25]
    again = Inputs.joined([joined, joined.pick(slice(1, 2))])
    assert again.wholes is not None
    assert again.wholes.geometry[again.wholes.of].mean(dim=(1, 2, 3)).tolist() == [0.0, 1.0, 0.0, 1.0, 1.0, 1.0]
    assert Inputs.joined([Inputs(first), Inputs(second)]).wholes is None
