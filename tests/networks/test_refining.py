"""Generators that refine the layers of another."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch
import torch.nn.functional as F

from svbrdfgan.config.models import validate
from svbrdfgan.errors import ConfigError
from svbrdfgan.networks.draw import Draw
from svbrdfgan.networks.generator import Generator
from svbrdfgan.networks.inputs import Inputs, Wholes, window_of
from svbrdfgan.networks.layers import initialise
from svbrdfgan.networks.saved import GeneratorConfig, load_generator, make_generator, save_generator
from svbrdfgan.networks.tiles import Windows, paint_in_tiles

MAPS = ("roughness", "metallic", "normal")
SMALL: dict[str, Any] = {"width": 4, "blocks": 1, "downsamplings": 2, "kernel": 3, "skips": True, "random_fields": 3}
REFINED = GeneratorConfig(**SMALL)
CONFIG = GeneratorConfig(**SMALL, norm="pixel", refined=REFINED)


def geometry_of(rows: int, cols: int) -> torch.Tensor:
    """A bent sheet."""
    y, x = torch.meshgrid(*((torch.arange(side) + 0.5) / side * 2 - 1 for side in (rows, cols)), indexing="ij")
    position = torch.stack([x, y, 0.3 * torch.sin(3.0 * x + y)])
    slopes = torch.stack([-0.9 * torch.cos(3.0 * x + y), -0.3 * torch.cos(3.0 * x + y), torch.ones_like(x)])
    return torch.cat([position, F.normalize(slopes, dim=0)]).unsqueeze(0)


@pytest.fixture
def generator() -> Generator:
    made = make_generator(CONFIG, MAPS).eval()
    initialise(made, torch.Generator().manual_seed(0), "he")
    return made


def inputs(places: list[list[float]], size: int) -> Inputs:
    whole = geometry_of(64, 64)
    place = torch.tensor(places)
    fine = geometry_of(256, 256).permute(0, 2, 3, 1)
    windows = window_of(fine.expand(len(place), -1, -1, -1), place, size, size).permute(0, 3, 1, 2)
    return Inputs(windows, Wholes(whole, torch.zeros(len(place), dtype=torch.int64), place))


PLACES = [[0.25, 0.5, 0.25, 0.25], [0.0, 0.125, 0.25, 0.25]]


def test_before_training_the_layer_is_the_refined_one(generator: Generator) -> None:
    generator.start_refining()
    asked, seeds = inputs(PLACES, 64), torch.tensor([5, 6])
    assert generator.refined is not None
    with torch.no_grad():
        whole = generator.refined(geometry_of(64, 64).expand(2, -1, -1, -1), seeds)
        painted = generator.paint(asked, seeds)
    beneath = window_of(whole, torch.tensor(PLACES), 64, 64)
    assert beneath[..., :6].std(dim=(0, 1, 2)).min() > 1e-3, "there is something to refine"
    torch.testing.assert_close(painted[..., :6], beneath[..., :6].clamp(1e-3, 1 - 1e-3), atol=1e-5, rtol=0.0)
    cosine = F.cosine_similarity(painted[..., 6:], beneath[..., 6:], dim=-1)
    assert cosine.min() > 0.99


def test_only_the_refinement_learns(generator: Generator) -> None:
    painted = generator.paint(inputs(PLACES, 64), torch.tensor([5, 6]))
    painted.square().sum().backward()
    assert generator.refined is not None
    assert all(each.grad is None for each in generator.refined.parameters())
    still = ("refined.", "modulation.mapping")  # what modulates starts at none
    own = [each for name, each in generator.named_parameters() if not name.startswith(still)]
    assert all(each.grad is not None and each.grad.abs().sum() > 0 for each in own)


@pytest.mark.parametrize("factor", [1, 2])
def test_tiles_and_windows_are_parts_of_one_layer(generator: Generator, factor: int) -> None:
    generator.last.convolve.weight.data[-1] *= 1000.0  # steep relief
    seeds, windows, whole = torch.tensor([5]), Windows(64, finer=4), geometry_of(64, 64)
    with torch.no_grad():
        at_once = paint_in_tiles(generator, windows, whole, seeds, None, factor, tile=256)
        tiled = paint_in_tiles(generator, windows, whole, seeds, None, factor, tile=64)
        assert torch.equal(Draw(generator, 5, windows=windows)(whole, 4 * factor), at_once)
    torch.testing.assert_close(tiled[..., :6], at_once[..., :6], atol=1e-4, rtol=0.0)
    inner = slice(-factor - 1)  # relief at the map's last texels goes by the first that are painted with them
    torch.testing.assert_close(tiled[:, inner, inner, 6:], at_once[:, inner, inner, 6:], atol=4e-4, rtol=0.0)
    if factor > 1:
        return
    with torch.no_grad():
        window = Draw(generator, 5).on(inputs(PLACES[:1], 64))[0]
    middle = slice(24, 40)
    part = at_once[0, 64:128, 128:192]
    assert (window - part)[middle, middle, :6].abs().mean() < 0.1 * part[middle, middle, :6].std()


def test_broad_relief_stays_as_it_is(generator: Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    """Slopes of waves of one height go by 1 / length; those of long ones are a fraction of that."""
    asked, seeds, middle = inputs(PLACES, 64), torch.tensor([5, 6]), slice(16, 48)

    def added_slopes(wave: int) -> float:
        heights = torch.zeros(2, 7, 64, 64)
        heights[:, -1] = torch.sin(2.0 * torch.pi * torch.arange(64) / wave)
        with monkeypatch.context() as patch:
            patch.setattr(generator.last, "forward", lambda *_: heights)
            waves = generator.paint(asked, seeds)[:, middle, middle, 6:]
            patch.setattr(generator.last, "forward", lambda *_: torch.zeros(2, 7, 64, 64))
            flat = generator.paint(asked, seeds)[:, middle, middle, 6:]
        return float((waves[..., 0] / waves[..., 2] - flat[..., 0] / flat[..., 2]).std())

    assert added_slopes(8) > 25.0 * added_slopes(64)


def test_a_file_holds_both(generator: Generator, tmp_path: Path) -> None:
    save_generator(tmp_path / "model.safetensors", generator, CONFIG, 0.5)
    loaded, score = load_generator(tmp_path / "model.safetensors")
    assert score == 0.5
    asked, seeds = inputs(PLACES, 64), torch.tensor([5, 6])
    with torch.no_grad():
        torch.testing.assert_close(loaded.paint(asked, seeds), generator.paint(asked, seeds))


def test_nothing_is_refined_twice() -> None:
    data = CONFIG.model_dump() | {"refined": CONFIG.model_dump()}
    with pytest.raises(ConfigError, match="refines layers cannot be refined again"):
        validate(GeneratorConfig, data, "here")
    assert CONFIG.without_random_fields.refined is None
