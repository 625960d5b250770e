"""A generator's file: what was written is read, and damage is one sentence."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from svbrdfgan.errors import AssetError
from svbrdfgan.networks.saved import GeneratorConfig, load_generator, make_generator, save_generator

MODEL = "model.safetensors"


@pytest.mark.parametrize("maps", [(), ("roughness",), ("normal",)])
def test_a_generator_returns_with_its_maps(maps: tuple[str, ...], tmp_path: Path) -> None:
    small = GeneratorConfig(width=4, blocks=0)
    generator = make_generator(small, maps).eval()
    save_generator(tmp_path / MODEL, generator, small, 0.5)
    geometry = torch.randn(1, 6, 16, 16)
    again, score = load_generator(tmp_path / MODEL)
    assert (again.maps, score) == (maps, 0.5)
    with torch.no_grad():
        assert torch.equal(again(geometry), generator(geometry))


def test_half_precision_takes_half_the_space_and_is_read_as_float32(tmp_path: Path) -> None:
    small = GeneratorConfig(width=16, blocks=1, random_fields=2)
    generator = make_generator(small, ("roughness",), labels=1)
    for name, half in (("whole", False), ("half", True)):
        save_generator(tmp_path / name, generator, small, None, half=half)
    sizes = [(tmp_path / name).stat().st_size for name in ("half", "whole")]
    assert 0.5 < sizes[0] / sizes[1] < 0.55
    read = load_generator(tmp_path / "half")[0].state_dict()
    for name, weights in generator.state_dict().items():
        assert read[name].dtype == weights.dtype
        torch.testing.assert_close(read[name], weights, rtol=2**-11, atol=2**-25)


@pytest.mark.parametrize("content", [b"", b"x" * 1000])
def test_a_damaged_model_is_one_sentence(content: bytes, tmp_path: Path) -> None:
    (tmp_path / MODEL).write_bytes(content)
    with pytest.raises(AssetError, match=r"model\.safetensors cannot be read") as caught:
        load_generator(tmp_path / MODEL)
    assert len(str(caught.value).splitlines()) == 1
