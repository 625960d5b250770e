"""A generator's file: what was written is read, and damage is one sentence."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from svbrdfgan.errors import AssetError
from svbrdfgan.networks.generator import Generator
from svbrdfgan.networks.saved import GeneratorConfig, load_generator, make_generator, save_generator

MODEL = "model.safetensors"


@pytest.mark.parametrize("channels", [4, 5])
def test_a_generator_returns_with_its_channels(channels: int, tmp_path: Path) -> None:
    small = GeneratorConfig(width=4, blocks=0)
    generator = make_generator(small, channels).eval()
    save_generator(tmp_path / MODEL, generator, small, 0.5)
    geometry = torch.randn(1, 6, 16, 16)
    with torch.no_grad():
        assert torch.equal(load_generator(tmp_path / MODEL)[0](geometry), generator(geometry))


def test_a_generator_that_says_no_channels_paints_rgba(tmp_path: Path) -> None:
    """As they were written before there were further maps."""
    generator = Generator(width=4, blocks=0)
    written = json.dumps({"width": 4, "blocks": 0, "norm": "instance", "upsampling": "nearest"})
    meta = {"format": "svbrdfgan generator 2", "generator": written, "score": "0.5"}
    save_file(generator.state_dict(), tmp_path / MODEL, meta)
    again, score = load_generator(tmp_path / MODEL)
    assert (again.channels, score) == (4, 0.5)
    assert again.state_dict().keys() == generator.state_dict().keys()


@pytest.mark.parametrize("content", [b"", b"x" * 1000])
def test_a_damaged_model_is_one_sentence(content: bytes, tmp_path: Path) -> None:
    (tmp_path / MODEL).write_bytes(content)
    with pytest.raises(AssetError, match=r"model\.safetensors cannot be read") as caught:
        load_generator(tmp_path / MODEL)
    assert len(str(caught.value).splitlines()) == 1
