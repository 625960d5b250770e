"""Seconds and memory are those of the work."""

import dataclasses
import time
from typing import Any

import pytest
import torch

from svbrdfgan.bench import BenchError, time_renderer
from svbrdfgan.bench.backend import figures
from svbrdfgan.bench.bench_scene import BenchScene
from svbrdfgan.bench.meter import Meter, median_seconds
from svbrdfgan.bench.programs import STEPS
from svbrdfgan.bench.standard_scenes import glossy_scene
from svbrdfgan.bench.time_renderer import measure
from svbrdfgan.plugins.registry import load_renderer

CPU = torch.device("cpu")
MIB = 2**20


def test_every_step_is_measured(tiny: BenchScene) -> None:
    line = figures("numpy", tiny, spp=1, batch=2, repeats=1)
    assert {f"{step}_s" for step in STEPS} <= set(line)
    assert (line["peer"], line["spp"], line["batch"], line["device"]) == ("numpy", 1, 2, "cpu")
    assert all(isinstance(value, float) and value > 0 for name, value in line.items() if name.endswith("_s"))


def test_a_renderer_without_transport_has_fresh_steps_alone(tiny: BenchScene) -> None:
    renderer = load_renderer("numpy", {"max_bounces": 2})
    assert list(measure(renderer, tiny, 1, 1, 1).seconds) == ["prepare", "forward", "forward_backward"]


def test_a_whole_material_has_fresh_steps_alone_and_gradients_of_every_map(tiny: BenchScene) -> None:
    scene = glossy_scene(tiny)
    assert list(measure(load_renderer("numpy"), scene, 1, 1, 1).seconds) == ["prepare", "forward", "forward_backward"]
    maps = scene.textures(CPU)
    assert list(maps) == ["base_color", "roughness", "metallic", "normal"]
    assert torch.allclose(maps["normal"].norm(dim=-1), torch.ones(16, 16), atol=1e-5)
    assert torch.equal(scene.materials(maps)[0].maps["metallic"], torch.from_numpy(scene.gloss[..., 1:2]))


def test_a_whole_material_is_shaded_from_stored_light(tiny: BenchScene) -> None:
    scene = glossy_scene(tiny)
    seconds = measure(load_renderer("warp", {"device": "cpu"}), scene, spp=64, batch=2, repeats=1).seconds
    assert list(seconds) == list(STEPS)
    assert all(value > 0 for value in seconds.values())


def test_wrong_stored_light_is_found(tiny: BenchScene, monkeypatch: pytest.MonkeyPatch) -> None:
    right = time_renderer.shade
    monkeypatch.setattr(time_renderer, "shade", lambda *given, **named: 1.1 * right(*given, **named))
    with pytest.raises(BenchError, match="mean of the picture from stored light differs"):
        measure(load_renderer("warp", {"device": "cpu"}), glossy_scene(tiny), 64, 1, 1)


def test_a_wrong_transport_is_found(tiny: BenchScene, monkeypatch: pytest.MonkeyPatch) -> None:
    right = time_renderer.build_transport

    def brighter(*arguments: Any, **options: Any) -> Any:
        made = right(*arguments, **options)
        return dataclasses.replace(made, background=made.background + 0.01)

    monkeypatch.setattr(time_renderer, "build_transport", brighter)
    with pytest.raises(BenchError, match="differs from the renderer's by"):
        measure(load_renderer("numpy"), tiny, 1, 1, 1)


@pytest.mark.parametrize(("seconds", "repeats", "calls"), [(0.05, 3, 3), (0.0021, 2, 1 + 2 * 9)])
def test_seconds_are_those_of_one_call(
    monkeypatch: pytest.MonkeyPatch, seconds: float, repeats: int, calls: int
) -> None:
    """Long work is called once for each sample; short work as often as fills a sample."""
    now, made = 0.0, 0

    def work() -> None:
        nonlocal now, made
        made += 1
        now += 30 * seconds if made == 2 else seconds  # a hiccup, which a median passes over

    monkeypatch.setattr("svbrdfgan.bench.meter.time.perf_counter", lambda: now)
    median = median_seconds(work, CPU, repeats)
    assert made == calls
    assert median == pytest.approx(seconds if repeats == 3 else (seconds + (9 + 29) * seconds / 9) / 2)


def test_no_sample_is_begun_after_three_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter(range(0, 1000, 4))
    monkeypatch.setattr("svbrdfgan.bench.meter.time.perf_counter", lambda: next(clock))
    made: list[int] = []
    assert median_seconds(lambda: made.append(1), CPU, 100) == 4.0
    assert len(made) == 1


@pytest.mark.full
def test_peak_memory_is_what_was_held_for_a_moment() -> None:
    meter = Meter(CPU, repeats=1)

    def work() -> None:
        held = torch.ones(64 * MIB // 4)
        time.sleep(0.01)
        del held

    meter.step("work", work)
    if not meter.peak_bytes:
        pytest.skip("this system does not say how much memory a process holds")
    assert 60 * MIB < meter.peak_bytes["work"] < 80 * MIB
    meter.start(kept=5 * MIB)
    meter.step("nothing", lambda: None)
    assert 5 * MIB <= meter.peak_bytes["nothing"] < 8 * MIB
