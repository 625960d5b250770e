"""A generator's file: what was written is read, and damage is one sentence."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
import torch

from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.io.tensors import save_tensors
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
        torch.testing.assert_close(again(geometry), generator(geometry))  # but for rounding: other memory format


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


def doctored(path: Path, weights: dict[str, torch.Tensor] | None = None, **words: object) -> None:
    """A generator's file that says something else of itself, or has other weights."""
    small = GeneratorConfig(width=4, blocks=0)
    generator = make_generator(small)
    about = {"generator": small.model_dump(), "maps": [], "labels": 0, "score": None} | words
    told = {name: json.dumps(value) for name, value in about.items()}
    save_tensors(path, "svbrdfgan generator 5", generator.state_dict() | (weights or {}), told)


@pytest.mark.parametrize(
    "words",
    [
        {"generator": None},
        {"generator": {"width": 3000}},
        {"generator": {"blocks": 10**7}},
        {"generator": {"width": 1024, "blocks": 64, "downsamplings": 6}},
        {"generator": {"width": 8, "blocks": 0}},
        {"maps": "roughness"},
        {"maps": ["height"]},
        {"labels": -1},
        {"labels": 10**9},
        {"labels": None},
        {"score": "best"},
        {"score": []},
    ],
)
def test_a_file_that_says_what_cannot_be_takes_no_memory(words: dict[str, object], tmp_path: Path) -> None:
    doctored(tmp_path / MODEL)
    load_generator(tmp_path / MODEL)
    doctored(tmp_path / MODEL, **words)
    with pytest.raises((AssetError, ConfigError), match=r"model\.safetensors"):
        load_generator(tmp_path / MODEL)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_weights_that_are_not_finite_are_refused(value: float, tmp_path: Path) -> None:
    weight = make_generator(GeneratorConfig(width=4, blocks=0)).state_dict()["first.weight"]
    weight[0, 0, 0, 0] = value
    doctored(tmp_path / MODEL, {"first.weight": weight})
    with pytest.raises(AssetError, match="weights that are not finite"):
        load_generator(tmp_path / MODEL)
