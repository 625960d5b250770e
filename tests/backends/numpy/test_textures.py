"""Bilinear lookups against torch's, and their transpose."""

import numpy as np
import pytest
import torch
from svbrdfgan_numpy.textures import bilinear_taps

RNG = np.random.default_rng(0)
UV = RNG.uniform(0.0, 1.0, (500, 2))
TEXELS = RNG.uniform(0.0, 1.0, (5, 7, 3))


def test_lookup_equals_torchs() -> None:
    image = torch.from_numpy(TEXELS).permute(2, 0, 1)[None]
    grid = torch.from_numpy(2.0 * UV - 1.0)[None, None]
    truth = torch.nn.functional.grid_sample(image, grid, padding_mode="border", align_corners=False)[0, :, 0].T
    assert np.allclose(bilinear_taps(UV, 5, 7, (False, False)).apply(TEXELS.reshape(-1, 3)), truth.numpy())


@pytest.mark.parametrize("repeat", [(True, False), (False, True), (True, True)])
def test_repeating_is_looking_up_in_a_tiled_texture(repeat: tuple[bool, bool]) -> None:
    across, up = (3 if axis else 1 for axis in repeat)
    tiled = np.tile(TEXELS, (up, across, 1)).reshape(-1, 3)
    inside = (UV + np.array(repeat)) / [across, up]
    truth = bilinear_taps(inside, 5 * up, 7 * across, (False, False)).apply(tiled)
    for shift in (0, -1):
        uv = UV + shift * np.array(repeat)
        assert np.allclose(bilinear_taps(uv, 5, 7, repeat).apply(TEXELS.reshape(-1, 3)), truth)


def test_transpose_is_the_transpose() -> None:
    taps = bilinear_taps(UV, 5, 7, (True, False)).scaled(RNG.uniform(size=500))
    values, texels = RNG.normal(size=(500, 3)), RNG.normal(size=(35, 3))
    assert np.isclose((taps.apply(texels) * values).sum(), (texels * taps.transpose(values, 35)).sum())
