"""Deferred rendering: pictures of layers of whole materials from light that is stored once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import load_file
from torch import Tensor

pytest.importorskip("warp", reason="only the warp renderer stores light")

from svbrdfgan.config.models import validate
from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.data.generate import generate
from svbrdfgan.errors import ConfigError
from svbrdfgan.plugins.registry import load_renderer
from svbrdfgan.rendering.compositing import composite_maps, composite_values
from svbrdfgan.training.batches import BatchSource, make_batch_source, own_buffers
from svbrdfgan.training.config import DiscriminatorConfig, ScenesConfig, train_config
from svbrdfgan.training.deferred_rendering import DeferredRendering, _stacked
from svbrdfgan.training.resolve import resolve_run
from svbrdfgan.training.state import checkpoints
from svbrdfgan.training.trainer import train
from svbrdfgan.types import Layer, Material

CPU = torch.device("cpu")
CHANNELS = 9
"""Of a layer that paints all maps."""
MAPS = {"roughness": 0.4, "metallic": 0.2, "normal": 0.0}
WARP = {"name": "warp", "device": "cpu"}

Data = Callable[..., dict[str, Any]]


@pytest.fixture(scope="session")
def glossy_dataset(built_once: Any, dataset_data: Data) -> Path:
    """The tiny data set with layers of all maps, of little noise. Not to be changed."""

    def fill(folder: Path) -> None:
        data = dataset_data(maps=MAPS, renderer=WARP, spp=256)
        generate(validate(DatasetConfig, data, "glossy"), folder / "dataset", base=Path())

    return Path(built_once("tiny, of all maps", fill)) / "dataset"


@pytest.fixture(scope="session")
def glossy_training(training_data: Data, glossy_dataset: Path) -> Data:
    options = {"dataset": str(glossy_dataset), "renderer": WARP, "hits": 4, "spp": 16}
    return lambda **changes: training_data(**options, **changes)


@pytest.fixture(scope="module")
def source(glossy_training: Data) -> BatchSource:
    """Matched scenes, in which the discriminator is shown all buffers."""
    data = glossy_training(discriminator={"gbuffer": True, "light_buffer": True, "clean_picture": True})
    return make_batch_source(
        resolve_run(train_config(data, "here")), "train", load_renderer("warp", {"device": "cpu"}), CPU
    )


@pytest.fixture
def rendering(source: BatchSource) -> DeferredRendering:
    """Its scenes, with nothing stored yet."""
    assert isinstance(source.fake_scenes, DeferredRendering)
    return replace(source.fake_scenes)


def layers(count: int) -> Tensor:
    return torch.rand((count, 32, 32, CHANNELS), generator=torch.Generator().manual_seed(5)) + torch.eye(CHANNELS)[8]


def buffers(rendering: DeferredRendering, index: int) -> tuple[Tensor, Tensor | None, Tensor | None]:
    """G-buffer, light buffer and clean picture of the first stored scene of an exemplar."""
    scenes = rendering.first_scenes([index])
    assert scenes.gbuffer is not None
    light, clean = (None if shown is None else shown[0] for shown in (scenes.light_buffer, scenes.clean))
    return scenes.gbuffer[0], light, clean


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_pictures_of_the_true_layers_are_the_exemplars(source: BatchSource, rendering: DeferredRendering) -> None:
    """On average over visits, in every picture."""
    indices = list(range(len(source)))
    true = torch.stack([layer.values for layer in source.exemplars.layers if layer is not None])
    pictures = [rendering.scenes(indices, rng(visit), visit).render(true) for visit in range(0, 64, 4)]
    mean, wanted = torch.stack([image for image, _ in pictures]).mean(dim=0), source.exemplars.images.float()
    off = (mean - wanted).sum(dim=(1, 2)).abs() / wanted.sum(dim=(1, 2))
    assert float(off.max()) < 0.04, off
    rough = torch.nn.functional.avg_pool2d
    apart = rough((mean - wanted).permute(0, 3, 1, 2), 4).abs().mean() / wanted.mean()
    assert float(apart) < 0.08
    assert float((pictures[0][1] - source.exemplars.coverage.float()).abs().mean()) < 0.03


def test_pictures_are_differentiable_in_the_layers(rendering: DeferredRendering) -> None:
    """In the colour pictures are linear, so that a step moves them exactly as the gradient says."""
    batch, layer = rendering.scenes([0, 4], rng()), layers(2).requires_grad_()
    images, _ = batch.render(layer)
    grad = torch.randn(images.shape, generator=torch.Generator().manual_seed(1))
    (images * grad).sum().backward()
    assert layer.grad is not None
    step = torch.zeros_like(layer)
    step[..., :3] = torch.randn((2, 32, 32, 3), generator=torch.Generator().manual_seed(2))
    moved, _ = batch.render((layer + step).detach())
    wanted = float(((moved - images.detach()) * grad).double().sum())
    assert float((layer.grad * step).double().sum()) == pytest.approx(wanted, rel=1e-3)
    assert all(layer.grad[..., channel].any() for channel in range(CHANNELS))


def test_noise_that_clean_pictures_share_is_divided_out(rendering: DeferredRendering) -> None:
    """As with many more samples of their own, on average over visits, and with gradients of the same picture."""
    few = replace(rendering, spp=8, hits=8)
    rust = torch.tensor([0.3, 0.1, 0.03, 0.0, 0.9, 0.0, 0.0, 0.0, 1.0])
    painted, many = rust.repeat(1, 32, 32, 1), replace(rendering, spp=1024, hits=1024)
    painted[..., 3] = torch.linspace(0.0, 1.0, 32)
    wanted = many.scenes([0], rng()).render(painted)[0]
    quiet = replace(few, clean_spp=1024)
    errors = {}
    for name, each in {"noisy": few, "quiet": quiet}.items():
        found = torch.cat([each.scenes([0], rng(visit), visit).render(painted)[0] for visit in range(0, 160, 10)])
        errors[name] = float((found - wanted).square().mean().sqrt())
        assert float(found.mean()) == pytest.approx(float(wanted.mean()), rel=0.05), name
    assert errors["quiet"] < 0.55 * errors["noisy"], errors
    layer = painted.requires_grad_()
    batch, grad = quiet.scenes([0], rng()), torch.randn(wanted.shape, generator=torch.Generator().manual_seed(1))
    images, _ = batch.render(layer)
    (images * grad).sum().backward()
    step = torch.zeros_like(layer)
    step[..., :3] = 1.0
    moved = float(((batch.render((layer + step).detach())[0] - images.detach()) * grad).double().sum())
    assert layer.grad is not None
    assert float((layer.grad * step).double().sum()) == pytest.approx(moved, rel=1e-3)


def test_what_is_shown_beside_quiet_fakes_has_noise_of_its_own(rendering: DeferredRendering) -> None:
    """As beside an exemplar of as many samples; else fakes would be known by how near they are to the clean picture."""
    quiet = replace(rendering, clean_spp=16)
    clear = torch.eye(CHANNELS)[8].repeat(1, 32, 32, 1)
    fake, shown = quiet.scenes([0], rng()).render(clear)[0][0], buffers(quiet, 0)[2]
    many = buffers(replace(rendering, clean_spp=16384), 0)[2]
    assert shown is not None
    assert many is not None
    noise = float((shown - many).square().mean().sqrt())
    assert float((fake - many).square().mean().sqrt()) == pytest.approx(noise, rel=0.3)
    assert float((fake - shown).square().mean().sqrt()) == pytest.approx(2**0.5 * noise, rel=0.3)


@pytest.mark.parametrize("changes", [{"rendering": "online"}, {}])
def test_clean_samples_for_other_fakes_are_told(
    changes: dict[str, Any], training_data: Data, glossy_training: Data
) -> None:
    make = glossy_training if changes else training_data
    config = train_config(make(clean_spp=4, **changes), "here")
    with pytest.raises(ConfigError, match=r"clean_spp is for rendering: stored of whole materials"):
        resolve_run(config)


@pytest.mark.parametrize("pool", [0, 1, 2])
def test_a_pool_holds_so_many_scenes_of_each_exemplar(pool: int, rendering: DeferredRendering) -> None:
    pooled = replace(rendering, pool=pool)
    seeds = {pooled.scenes([1], rng(n)).scenes[0].light.value.seed for n in range(12)}  # type: ignore[attr-defined]
    assert len(seeds) == (pool or 12)
    assert len(pooled._cache) == pool


def test_what_does_not_fit_is_traced_again_with_equal_results(
    rendering: DeferredRendering, monkeypatch: pytest.MonkeyPatch
) -> None:
    traced: list[int] = []
    trace = DeferredRendering._trace
    monkeypatch.setattr(
        DeferredRendering, "_trace", lambda self, index, scene: traced.append(index) or trace(self, index, scene)
    )
    tight = replace(rendering, cache_bytes=0)
    batches = [[0, 1], [2, 3], [0, 1]]
    wide, narrow = (
        [r.scenes(batch, rng(n), n).render(layers(2))[0] for n, batch in enumerate(batches)] for r in (rendering, tight)
    )
    assert all(torch.equal(one, other) for one, other in zip(wide, narrow, strict=True))
    assert (len(rendering._cache), len(tight._cache)) == (4, 1)
    assert len(traced) == 4 + 6
    assert rendering._cache.nbytes == sum(scene.nbytes for scene in rendering._cache.values())


def test_buffers_are_of_the_first_stored_scene(source: BatchSource, rendering: DeferredRendering) -> None:
    gbuffer, light, clean = buffers(rendering, 2)
    assert light is not None
    assert clean is not None
    assert (gbuffer.shape, light.shape, clean.shape) == ((32, 32, 6), (32, 32, 9), (32, 32, 3))
    matched = rendering.scenes([2], rng())
    assert (matched.gbuffer, matched.light_buffer, matched.clean) == (None, None, None)
    shown = gbuffer[..., 3:].norm(dim=-1)
    assert float(shown.max()) == pytest.approx(1.0, abs=0.02)
    assert source.real.gbuffer is not None
    assert torch.equal(source.real.gbuffer[2].float(), gbuffer)
    assert source.real.clean is not None
    assert torch.equal(source.real.clean[2].float(), clean)
    unseen = replace(rendering, shows_gbuffer=False, shows_light=False, shows_clean=False).first_scenes([2])
    assert (unseen.gbuffer, unseen.light_buffer, unseen.clean) == (None, None, None)


def test_scenes_that_do_not_match_carry_their_own_buffers(rendering: DeferredRendering) -> None:
    config = ScenesConfig(camera_noise_degrees=20.0, environment="redrawn")
    perturbation = replace(rendering.perturbation, config=config)
    moved = replace(rendering, perturbation=perturbation)
    batch = moved.scenes([0, 3], rng())
    for mine, its in zip((batch.gbuffer, batch.light_buffer, batch.clean), buffers(moved, 0), strict=True):
        assert mine is not None
        assert its is not None
        assert torch.equal(mine[0], its)
    matched, own = buffers(rendering, 0)[0], moved.own_scenes(16, keep=False)
    own.build(range(6))
    assert own._cache == {}  # each is looked at once
    assert float((buffers(moved, 0)[0] - matched).abs().mean()) > 0.01
    assert float((buffers(own, 0)[0] - matched).abs().mean()) < 0.03
    image, coverage = batch.render(layers(2))
    assert bool(torch.isfinite(image).all())
    assert not image[coverage == 0].any()


def test_buffers_of_scenes_that_are_not_kept_take_one_trace(
    rendering: DeferredRendering, monkeypatch: pytest.MonkeyPatch
) -> None:
    own, traced = rendering.own_scenes(16, keep=False), []
    trace = own._trace
    monkeypatch.setattr(own, "_trace", lambda index, scene: traced.append(index) or trace(index, scene))
    shown = DiscriminatorConfig(gbuffer=True, light_buffer=True, clean_picture=True)
    made = own_buffers(shown, own, [0, 1], rendering.exemplars.loader.cache)
    found = [buffer for buffer in made if buffer is not None]
    assert traced == [0, 1]
    assert [len(buffer) for buffer in found] == [2, 2, 2]


def test_seen_texels_lie_on_learnable_parts(source: BatchSource, rendering: DeferredRendering) -> None:
    seen = rendering.seen(0)
    texels = source.exemplars.subject(0).learnable_texels
    assert seen.shape == texels.shape
    assert bool((seen[texels] > 0).any())
    assert not seen[~texels].any()


def test_constants_stand_beside_textures() -> None:
    """What a part's file gives as a texture, and what is a number."""
    texture, number = torch.rand(3, 4, 3), torch.tensor([0.5])
    mixed = Material({"base_color": texture, "roughness": number})
    other = Material({"base_color": torch.rand(3), "roughness": torch.rand(3, 4, 1)})
    parts = _stacked([mixed, other], ("base_color", "roughness"))
    assert parts.shape == (2, 3, 4, 4)
    layer = Layer(torch.rand(3, 4, 5), ("roughness",))
    for part, material in zip(parts, (mixed, other), strict=True):
        wanted = torch.cat([*composite_maps(material.maps, layer).values()], dim=-1)
        torch.testing.assert_close(composite_values(part, layer), wanted)


def test_a_renderer_that_stores_no_light_is_told(rendering: DeferredRendering) -> None:
    with pytest.raises(ConfigError, match=r"needs a renderer that stores light; numpy does not: set rendering"):
        replace(rendering, renderer=load_renderer("numpy"))


@pytest.mark.full
def test_training_of_all_maps_resumes_to_the_bit(glossy_training: Data, tmp_path: Path) -> None:
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    changes: dict[str, Any] = {
        "save_every": 1,
        "score_every": 2,
        "discriminator": {"gbuffer": True, "light_buffer": True},
    }
    config = train_config(glossy_training(steps=2, **changes), "here")
    train(config, whole)
    train(config.model_copy(update={"steps": 1}), parts)
    train(config, parts, resume=True)
    mine, its = (load_file(checkpoints(run)[-1] / "state.safetensors") for run in (whole, parts))
    assert mine.keys() == its.keys()
    assert [name for name, tensor in mine.items() if not torch.equal(tensor, its[name])] == []
