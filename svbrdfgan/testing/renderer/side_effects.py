"""Rendering has no side effects on the process, its settings and the inputs."""

from __future__ import annotations

import os
import sys
import unittest
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch

from svbrdfgan.testing import scenes
from svbrdfgan.testing.kit import check, declared
from svbrdfgan.testing.renderer import cases
from svbrdfgan.testing.renderer.base import RendererKit
from svbrdfgan.testing.renderer.cases import RenderedCase, flat
from svbrdfgan.testing.renderer.fixtures import ExampleScene
from svbrdfgan.testing.renderer.statistical_assertions import exactly


class SideEffectTests(RendererKit):
    """Nothing global is changed or read, no input is written to, and results carry no autograd graph."""

    def test_the_process_is_left_alone(self) -> None:
        """Working directory, environment variables and module path stay."""
        self.renderer.prepare(scenes.plane())  # what comes with the first import is not rendering
        self.require_unchanged(
            {
                "the working directory": os.getcwd,
                "the environment variables": lambda: dict(os.environ),
                "sys.path": lambda: list(sys.path),
            }
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
            self.require_unchanged({"Mitsuba's variant": lambda: sys.modules["mitsuba"].variant()})
        finally:
            if before is not None:
                mitsuba.set_variant(before)

    def test_inputs_are_only_read(self) -> None:
        """Surface, textures, environment and grad_image are only read."""
        scene = ExampleScene()
        held = scene.held()
        before = {name: values.clone() for name, values in held.items()}
        for _ in scene.uses(self.renderer):
            pass
        for name, values in held.items():
            check(torch.equal(values, before[name]), f"{name} was changed.")

    def test_results_do_not_share_memory_with_inputs(self) -> None:
        """Writing into a result changes no input, and no later result."""
        scene = ExampleScene()
        prepared = self.renderer.prepare(scene.surface)
        first = self.renderer.render(prepared, scene.materials, scene.view, spp=2, seed=1)
        kept = first.image.clone(), first.coverage.clone(), scene.texture.clone()
        first.image.fill_(-1.0)
        first.coverage.fill_(-1.0)
        again = self.renderer.render(prepared, scene.materials, scene.view, spp=2, seed=1)
        same = torch.equal(again.image, kept[0]) and torch.equal(again.coverage, kept[1])
        check(same and torch.equal(scene.texture, kept[2]), "a result that was written into shows up again.")

    def test_a_pullback_keeps_what_it_was_given(self) -> None:
        """Textures and light may be written into between a picture and its pullback."""
        declared(self.capabilities.pullback, "pullback")
        wrt, gloss = cases.differentiable(self.capabilities), "roughness" in self.capabilities.maps
        case = cases.glossy(torch.full((2, 3, 1), 0.4)) if gloss else cases.sheet()
        rendered, grad = RenderedCase(self.renderer, case), case.random()
        wanted = flat(rendered.gradients(grad, *wrt))
        scene = rendered.prepared, case.materials, case.view
        _, pullback = self.renderer.render_pullback(*scene, wrt=frozenset(wrt), spp=4, seed=3)
        for values in (*case.materials[0].maps.values(), case.view.environment.radiance):
            values.fill_(0.9)
        for place, found in flat(pullback(torch.from_numpy(grad).float())).items():
            exactly(f"the gradient for {place}, after inputs were written into,", found, wanted[place])

    def test_results_carry_no_autograd_graph(self) -> None:
        """Inputs may require gradients; results are plain tensors."""
        scene = ExampleScene()
        scene.texture.requires_grad_(True)
        scene.view.environment.radiance.requires_grad_(True)
        for result in scene.uses(self.renderer):
            check(not result.requires_grad, "a result requires grad: detach what is computed.")
        check(scene.texture.grad is None, "the texture's .grad was filled in.")

    def test_settings_of_the_caller_do_not_matter(self) -> None:
        """Pictures are the same under no_grad and a float64 default dtype."""
        plain = ExampleScene().render(self.renderer).image
        contexts: dict[str, Any] = {"no_grad": torch.no_grad(), "a float64 default dtype": _float64_default()}
        scene = ExampleScene()
        for name, context in contexts.items():
            with context:
                image = scene.render(self.renderer).image
            check(image.dtype == torch.float32, f"under {name} the picture is {image.dtype}.")
            check(torch.equal(image, plain), f"under {name} the same picture differs.")


@contextmanager
def _float64_default() -> Iterator[None]:
    before = torch.get_default_dtype()
    torch.set_default_dtype(torch.float64)
    try:
        yield
    finally:
        torch.set_default_dtype(before)
