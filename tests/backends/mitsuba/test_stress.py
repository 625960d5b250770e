"""Many changing scenes: a few kernels serve them all, and memory does not grow."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
import torch
from svbrdfgan_mitsuba import MitsubaRenderer
from svbrdfgan_mitsuba.interop import dr

from svbrdfgan.testing import scenes
from svbrdfgan.types import Camera, Material, Materials, View

KERNELS = {1: 72, 3: 180}
"""Most kernels that any number of scenes may need, by bounces: with each map and without, some parts transparent or
none, one-texel maps and so on. With direct light 30 scenes need 39, 150 need 61."""


def scene(number: int) -> tuple[object, Materials, View, int]:
    """A scene with other geometry, parts, textures, lights, camera and film for every number."""
    random = torch.Generator().manual_seed(number)

    def between(low: int, high: int) -> int:
        return int(torch.randint(low, high + 1, (1,), generator=random))

    def material(part: int) -> Material:
        maps = {"base_color": torch.rand((between(1, 30), between(1, 30), 3), generator=random)}
        if number % 2:
            maps["roughness"] = torch.rand((between(1, 9), between(1, 9), 1), generator=random)
            if number % 4 == 1:
                maps["metallic"] = torch.rand((between(1, 9), between(1, 9), 1), generator=random)
        if number % 3 == 1:
            maps["normal"] = torch.rand((between(1, 9), between(1, 9), 3), generator=random) + torch.tensor(
                [-0.5, -0.5, 0]
            )
        return Material(maps) if part % 3 else Material.lambertian((0.2, 0.3, 0.4))

    parts = between(1, 6)
    surface = scenes.joined(*(scenes.sphere(1.0, between(3, 9), between(4, 12)) for _ in range(parts)))
    if number % 5 == 2:
        alphas = [1.0, *(float(torch.rand((), generator=random)) for _ in range(parts - 1))]
        made = zip(surface.parts, alphas, strict=True)
        surface = replace(surface, parts=tuple(replace(part, alpha=alpha) for part, alpha in made))
    light = scenes.random_light(between(1, 20), between(1, 30), seed=number, rotation=float(number))
    view = View(Camera((0.1 * between(-9, 9), 1.0, 4.0), vertical_fov=0.6), light, between(8, 20), between(8, 20))
    return surface, Materials(tuple(material(part) for part in range(parts))), view, between(2, 5)


def work(renderer: MitsubaRenderer, number: int) -> None:
    surface, materials, view, spp = scene(number)
    prepared = renderer.prepare(surface)
    image = renderer.render(prepared, materials, view, spp=spp, seed=number).image
    wrt = renderer.capabilities.differentiable
    gradients = renderer.render_vjp(prepared, materials, view, image, wrt=wrt, spp=spp + 1, seed=number + 1)
    assert torch.isfinite(image).all()
    assert all(torch.isfinite(value).all() for part in gradients.materials for value in part.values())
    assert torch.isfinite(gradients.environment).all()
    if renderer.capabilities.transport:
        assert all(
            torch.isfinite(samples.weight).all() for samples in renderer.transport(prepared, view, spp=2, seed=0)
        )


def resident_mebibytes() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 2**20


def stress(max_bounces: int, count: int, growth: float) -> None:
    """The number of kernels is bounded, and the second half of the scenes needs no more memory than the first.

    The largest step does not count: the allocator may take one great block (36 MB), but a leak has many steps.
    """
    renderer, kernels, memory = MitsubaRenderer("cpu", max_bounces), set(), []
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        for number in range(count):
            dr.kernel_history_clear()
            work(renderer, number)
            kernels |= {kernel["hash"] for kernel in dr.kernel_history([dr.KernelType.JIT])}
            memory.append(resident_mebibytes())
    assert 10 < len(kernels) <= KERNELS[max_bounces]
    steps = [after - before for before, after in pairwise(memory[count // 2 :])]
    assert sum(sorted(steps)[:-1]) < growth


@pytest.mark.parametrize("max_bounces", [1, pytest.param(3, marks=pytest.mark.full)])
def test_changing_scenes_need_no_new_kernels(max_bounces: int) -> None:
    stress(max_bounces, 30, growth=20.0)


@pytest.mark.slow
@pytest.mark.parametrize("max_bounces", [1, 3])
def test_three_hundred_changing_scenes(max_bounces: int) -> None:
    stress(max_bounces, 300, growth=20.0)


def test_a_great_film_needs_little_memory(renderer: MitsubaRenderer) -> None:
    """Its samples alone would take 1.6 GB at 24 bytes each."""
    view = View(Camera((0.0, 0.0, 3.0), vertical_fov=0.8), scenes.constant_light(), 512, 512)
    prepared, white = renderer.prepare(scenes.plane()), scenes.lambertian((1.0, 1.0, 1.0))
    renderer.render(prepared, white, view, spp=8, seed=0)
    before = peak_mebibytes()
    renderer.render(prepared, white, view, spp=64, seed=0)
    assert peak_mebibytes() - before < 150.0


def peak_mebibytes() -> float:
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024
