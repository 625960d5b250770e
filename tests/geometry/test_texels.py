"""The texture filter."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from svbrdfgan.geometry.texels import bilinear_taps, sample_texture

ROWS, COLS = 5, 7


def a_texture(rows: int = ROWS, cols: int = COLS) -> torch.Tensor:
    return torch.rand(rows, cols, 3, generator=torch.Generator().manual_seed(1))


def points(count: int = 500, low: float = 0.0, high: float = 1.0) -> torch.Tensor:
    return low + (high - low) * torch.rand(count, 2, generator=torch.Generator().manual_seed(2))


def centres(rows: int, cols: int) -> torch.Tensor:
    row, col = torch.meshgrid(torch.arange(rows), torch.arange(cols), indexing="ij")
    return torch.stack([(col + 0.5) / cols, (row + 0.5) / rows], dim=-1).reshape(-1, 2)


@pytest.mark.parametrize("repeat", [(False, False), (True, False), (True, True)])
def test_centres_return_texels(repeat: tuple[bool, bool]) -> None:
    texture = a_texture(4, 8)  # powers of two: the centres are exact in binary
    assert torch.equal(sample_texture(texture, centres(4, 8), repeat), texture.reshape(-1, 3))


@pytest.mark.parametrize("repeat", [(False, False), (True, True)])
def test_weights_are_shares_of_one(repeat: tuple[bool, bool]) -> None:
    index, weight = bilinear_taps(points(), ROWS, COLS, repeat)
    torch.testing.assert_close(weight.sum(dim=1), torch.ones(500))
    assert (weight >= 0).all()
    assert index.min() >= 0
    assert index.max() < ROWS * COLS


def test_a_ramp_is_reproduced_between_the_outer_centres() -> None:
    ramp = ((torch.arange(COLS) + 0.5) / COLS).expand(ROWS, COLS).unsqueeze(-1)
    uv = points(low=0.5 / ROWS, high=1 - 0.5 / ROWS)
    torch.testing.assert_close(sample_texture(ramp, uv)[:, 0], uv[:, 0], atol=1e-6, rtol=0)


def test_clamped_beyond_the_outer_centres() -> None:
    texture = a_texture()
    corners = torch.tensor([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [-3.0, 9.0]])
    expected = torch.stack([texture[0, 0], texture[0, -1], texture[-1, 0], texture[-1, -1], texture[-1, 0]])
    assert torch.equal(sample_texture(texture, corners), expected)


def test_repeats_along_the_named_axis_alone() -> None:
    texture = a_texture()
    seam = sample_texture(texture, torch.tensor([[0.0, 0.5], [1.0, 0.5]]), (True, False))
    row = texture[ROWS // 2]
    torch.testing.assert_close(seam, ((row[0] + row[-1]) / 2).expand(2, 3))
    uv = points()
    shifted = uv + torch.tensor([2.0, 0.0])
    torch.testing.assert_close(
        sample_texture(texture, uv, (True, False)), sample_texture(texture, shifted, (True, False)), atol=1e-5, rtol=0
    )
    top = sample_texture(texture, torch.tensor([[0.5, 1.0]]), (True, False))
    assert torch.equal(top[0], texture[-1, COLS // 2])


@pytest.mark.parametrize("repeat", [(False, False), (True, False), (False, True), (True, True)])
@pytest.mark.parametrize("size", [(ROWS, COLS), (1, 1), (1, 4)])
def test_agrees_with_the_reference_renderer(size: tuple[int, int], repeat: tuple[bool, bool]) -> None:
    textures = pytest.importorskip("svbrdfgan_numpy.textures")
    texture, uv = a_texture(*size), points(low=-1.5, high=2.5)
    theirs = textures.bilinear_taps(uv.double().numpy(), *size, repeat).apply(texture.reshape(-1, 3).double().numpy())
    np.testing.assert_allclose(sample_texture(texture, uv, repeat).numpy(), theirs, atol=1e-5)


def test_the_lookup_is_differentiable_in_the_texture() -> None:
    texture = a_texture().double().requires_grad_(True)
    assert torch.autograd.gradcheck(lambda t: sample_texture(t, points(20).double()), texture)
