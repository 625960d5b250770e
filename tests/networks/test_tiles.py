"""Tiles join to the layer that a generator paints at once."""

from __future__ import annotations

from typing import Any

import pytest
import torch
import torch.nn.functional as F

from svbrdfgan.networks.draw import Draw
from svbrdfgan.networks.generator import Generator
from svbrdfgan.networks.layers import initialise
from svbrdfgan.networks.tiles import Windows, paint_in_tiles


def make_generator(**settings: Any) -> Generator:
    maps = ("roughness", "metallic", "normal")
    shape = {"width": 4, "blocks": 1, "downsamplings": 2, "kernel": 3, "skips": True, "random_fields": 3}
    generator = Generator(maps=maps, **({"norm": "none"} | shape | settings))
    initialise(generator, torch.Generator().manual_seed(0), "he")
    return generator.eval()


def geometry_of(rows: int, cols: int) -> torch.Tensor:
    """A bent sheet."""
    y, x = torch.meshgrid(torch.linspace(-1, 1, rows), torch.linspace(-1, 1, cols), indexing="ij")
    position = torch.stack([x, y, 0.3 * torch.sin(3.0 * x + y)])
    normal = F.normalize(
        torch.stack([-torch.cos(3.0 * x + y), -0.3 * torch.cos(3.0 * x + y), torch.ones_like(x)]), dim=0
    )
    return torch.cat([position, normal]).unsqueeze(0)


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"blocks": 2, "skips": False},
        {"downsamplings": 1, "kernel": 7},
        {"upsampling": "strided"},
        {"norm": "pixel"},
    ],
)
@pytest.mark.parametrize("factor", [1, 2])
def test_tiles_join_to_the_whole(settings: dict[str, Any], factor: int) -> None:
    generator, geometry = make_generator(**settings), geometry_of(96, 128)
    seeds, windows = torch.tensor([5]), Windows(64)
    with torch.no_grad():
        whole = generator(geometry, seeds, None, factor, 64)
        tiled = paint_in_tiles(generator, windows, geometry, seeds, None, factor, tile=40)
    assert whole[..., :8].std(dim=(0, 1, 2)).min() > 1e-3, "there is something to paint"
    end = -factor  # the last texels have no next one, and their normals go by the first of what is painted at once
    torch.testing.assert_close(tiled[:, :end, :end], whole[:, :end, :end], rtol=0.0, atol=1e-4)
    torch.testing.assert_close(tiled[..., :6], whole[..., :6], rtol=0.0, atol=1e-4)


def test_the_reach_is_enough_and_not_far_too_much() -> None:
    """The input beyond it has no gradient, and that at two thirds of it has one."""
    generator = make_generator(random_fields=0)
    geometry = geometry_of(128, 128).requires_grad_()
    generator(geometry)[0, 64, 64].sum().backward()
    assert geometry.grad is not None
    reached = (geometry.grad[0].abs().sum(dim=0) > 0.0).nonzero() - 64
    assert generator.reach * 2 / 3 < int(reached.abs().max()) <= generator.reach


def test_finer_texels_show_the_interpolated_geometry() -> None:
    generator, coarse, fine = make_generator(), geometry_of(32, 32), geometry_of(128, 128)
    with torch.no_grad():
        interpolated = Draw(generator, 7, windows=Windows(64, finer=4))(coarse, 4)
        exact = Draw(generator, 7, windows=Windows(64))(fine, 1)
        finest = Draw(generator, 7, windows=Windows(64, finer=4))(coarse, 8)
    assert interpolated.shape == exact.shape == (1, 128, 128, 9)
    inner = slice(8, -8)
    off = (interpolated - exact)[:, inner, inner].abs()
    assert float(off.mean()) < 0.2 * float((exact - exact.mean(dim=(1, 2), keepdim=True)).abs().mean())
    assert finest.shape == (1, 256, 256, 9)
    halved = F.avg_pool2d(finest.permute(0, 3, 1, 2), 2).permute(0, 2, 3, 1)
    assert float((halved - interpolated)[..., :4].abs().mean()) < 0.02


@pytest.mark.parametrize("finer", [2, 3])
def test_what_is_not_wanted_is_not_painted(finer: int) -> None:
    generator, geometry = make_generator(), geometry_of(64, 64)
    wanted = torch.zeros(64, 64, dtype=torch.bool)
    wanted[3:20, 5:9], wanted[50, 60] = True, True
    with torch.no_grad():
        whole, part = (
            paint_in_tiles(generator, Windows(64, finer), geometry, torch.tensor([1]), None, 1, mask, tile=40)
            for mask in (None, wanted)
        )
    assert whole.shape == part.shape == (1, 64 * finer, 64 * finer, 9)
    there = wanted.repeat_interleave(finer, 0).repeat_interleave(finer, 1)
    torch.testing.assert_close(part[0, there], whole[0, there], rtol=0.0, atol=1e-4)
    assert 0.0 < float((part[0].abs().sum(dim=-1) > 0.0).float().mean()) < 0.2


def test_normals_of_a_tile_go_by_the_window() -> None:
    """Texels shorter than half of a window's have no steeper slopes, however large the tile is."""
    generator, geometry = make_generator(), geometry_of(64, 64)
    squeezed = torch.cat([geometry[:, :3] * 1e-3, geometry[:, 3:]], dim=1)
    with torch.no_grad():
        few, many = (
            paint_in_tiles(generator, Windows(size), squeezed, torch.tensor([0]))[..., 6:] for size in (16, 1024)
        )
    assert few[..., 2].min() > many[..., 2].min()
