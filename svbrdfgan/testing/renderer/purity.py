"""Rendering is a function of its arguments: it leaves the process, its settings and its inputs as they were."""

from __future__ import annotations

import os
import random
import sys
import unittest
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor

from svbrdfgan.testing import scenes
from svbrdfgan.testing.kit import check
from svbrdfgan.testing.renderer.base import RendererKit
from svbrdfgan.types import Rendering, Surface


class PurityTests(RendererKit):
    """Nothing global is changed or read, no input is written to, and results are plain numbers."""

    def test_random_generators_are_left_alone(self) -> None:
        """torch's, NumPy's and Python's own random numbers are left alone."""
        _check_unchanged(
            self,
            {
                "torch's random state": torch.random.get_rng_state,
                "NumPy's random state": lambda: np.random.get_state(legacy=False),
                "Python's random state": random.getstate,
            },
        )

    def test_settings_of_torch_and_numpy_are_left_alone(self) -> None:
        """Default dtype and device, grad mode, threads and error handling stay."""
        _check_unchanged(
            self,
            {
                "torch's default dtype": torch.get_default_dtype,
                "torch's default device": torch.get_default_device,
                "torch's grad mode": torch.is_grad_enabled,
                "torch's number of threads": torch.get_num_threads,
                "torch's deterministic algorithms": torch.are_deterministic_algorithms_enabled,
                "torch's matmul precision": torch.get_float32_matmul_precision,
                "NumPy's error handling": np.geterr,
            },
        )

    def test_the_process_is_left_alone(self) -> None:
        """Working directory, environment variables and module path stay."""
        self.renderer.prepare(scenes.plane())  # what comes with the first import is not rendering
        _check_unchanged(
            self,
            {
                "the working directory": os.getcwd,
                "the environment variables": lambda: dict(os.environ),
                "sys.path": lambda: list(sys.path),
            },
        )

    def test_mitsubas_variant_is_left_alone(self) -> None:
        """Where Mitsuba is loaded, the caller's variant is the same afterwards."""
        self.renderer.prepare(scenes.plane())
        mitsuba: Any = sys.modules.get("mitsuba")
        if mitsuba is None:
            raise unittest.SkipTest("Mitsuba is not loaded")
        before = mitsuba.variant()
        mitsuba.set_variant("scalar_rgb")  # so that a renderer that sets its own, once, shows
        try:
            _check_unchanged(self, {"Mitsuba's variant": lambda: sys.modules["mitsuba"].variant()})
        finally:
            if before is not None:
                mitsuba.set_variant(before)

    def test_inputs_are_only_read(self) -> None:
        """Surface, textures, environment and grad_image are only read."""
        scene = Scene()
        held = scene.held()
        before = {name: values.clone() for name, values in held.items()}
        for _ in scene.uses(self.renderer):
            pass
        for name, values in held.items():
            check(torch.equal(values, before[name]), f"{name} was changed.")

    def test_results_do_not_share_memory_with_inputs(self) -> None:
        """Writing into a result changes no input, and no later result."""
        scene = Scene()
        prepared = self.renderer.prepare(scene.surface)
        first = self.renderer.render(prepared, scene.materials, scene.view, spp=2, seed=1)
        kept = first.image.clone(), first.coverage.clone(), scene.texture.clone()
        first.image.fill_(-1.0)
        first.coverage.fill_(-1.0)
        again = self.renderer.render(prepared, scene.materials, scene.view, spp=2, seed=1)
        same = torch.equal(again.image, kept[0]) and torch.equal(again.coverage, kept[1])
        check(same and torch.equal(scene.texture, kept[2]), "a result that was written into shows up again.")

    def test_results_carry_no_autograd_graph(self) -> None:
        """Inputs may require gradients; results are plain tensors."""
        scene = Scene()
        scene.texture.requires_grad_(True)
        scene.view.environment.radiance.requires_grad_(True)
        for result in scene.uses(self.renderer):
            check(not result.requires_grad, "a result requires grad: detach what is computed.")
        check(scene.texture.grad is None, "the texture's .grad was filled in.")

    def test_settings_of_the_caller_do_not_matter(self) -> None:
        """Pictures are the same under no_grad and a float64 default dtype."""
        scene = Scene()
        plain = _image(self, scene)
        settings: dict[str, Any] = {"no_grad": torch.no_grad(), "a float64 default dtype": _float64_default()}
        for name, setting in settings.items():
            with setting:
                image = _image(self, scene)
            check(image.dtype == torch.float32, f"under {name} the picture is {image.dtype}.")
            check(torch.equal(image, plain), f"under {name} the same picture differs.")

    def test_random_seeds_of_the_caller_do_not_matter(self) -> None:
        """Chance enters as `seed` alone: global generators change nothing."""
        scene, images = Scene(), []
        state = torch.random.get_rng_state(), np.random.get_state(), random.getstate()
        try:
            for seed in (1, 2):
                for generator in (torch.manual_seed, np.random.seed, random.seed):
                    generator(seed)
                images.append(_image(self, scene))
        finally:
            torch.random.set_rng_state(state[0])
            np.random.set_state(state[1])
            random.setstate(state[2])
        check(torch.equal(*images), "the same picture differs when torch, NumPy and random were seeded otherwise.")


def _image(kit: RendererKit, scene: Scene) -> Tensor:
    return kit.render(scene.surface, scene.materials, scene.view, spp=2, seed=1).image


def _check_unchanged(kit: RendererKit, states: dict[str, Callable[[], object]]) -> None:
    before = {name: state() for name, state in states.items()}
    for _ in Scene().uses(kit.make_renderer()):
        for name, state in states.items():
            check(
                _same(before[name], state()), f"{name} was changed, from {_short(before[name])} to {_short(state())}."
            )


class Scene:
    """A small scene, and all that can be done with it."""

    def __init__(self) -> None:
        self.texture = scenes.random_texture(5, 4)
        self.materials = scenes.lambertian(self.texture, torch.tensor(scenes.RED))
        self.view = scenes.front_view(scenes.random_light(), width=8, height=5)
        self.surface: Surface = scenes.two_parts()
        self.grad_image = torch.randn(5, 8, 3, generator=torch.Generator().manual_seed(0))

    def held(self) -> dict[str, Tensor]:
        """Everything in it that could be written to, the arrays as tensors on the same memory."""
        arrays = {name: getattr(self.surface, name) for name in ("positions", "normals", "uv", "faces", "face_part")}
        tensors = {
            "texture": self.texture,
            "environment": self.view.environment.radiance,
            "grad_image": self.grad_image,
        }
        return tensors | {f"surface.{name}": torch.from_numpy(array) for name, array in arrays.items()}

    def uses(self, renderer: Any) -> Iterator[Tensor]:
        """Picture, gradient and transport, one after the other: a tensor of each."""
        prepared = renderer.prepare(self.surface)
        rendering: Rendering = renderer.render(prepared, self.materials, self.view, spp=2, seed=1)
        yield rendering.image
        yield rendering.coverage
        wrt = renderer.capabilities.differentiable
        vjp = partial(renderer.render_vjp, prepared, self.materials, self.view, self.grad_image)
        gradients = vjp(wrt=wrt, spp=2, seed=1)
        yield from (gradient for part in gradients.materials for gradient in part.values())
        yield from () if gradients.environment is None else (gradients.environment,)
        if renderer.capabilities.pullback:
            _, pullback = renderer.render_pullback(prepared, self.materials, self.view, wrt=wrt, spp=2, seed=1)
            yield from (gradient for part in pullback(self.grad_image).materials for gradient in part.values())
        if renderer.capabilities.transport:
            yield from (samples.weight for samples in renderer.transport(prepared, self.view, spp=2, seed=1))


@contextmanager
def _float64_default() -> Iterator[None]:
    before = torch.get_default_dtype()
    torch.set_default_dtype(torch.float64)
    try:
        yield
    finally:
        torch.set_default_dtype(before)


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, Tensor):
        return bool(torch.equal(a, b))
    if isinstance(a, np.ndarray):
        return bool(np.array_equal(a, b))
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_same(a[key], b[key]) for key in a)
    return bool(a == b)


def _short(value: object) -> str:
    text = " ".join(str(value).split())
    return text if len(text) <= 40 else f"{text[:37]}..."
