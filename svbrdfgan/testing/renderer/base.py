"""What every test of a renderer starts from."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any

from svbrdfgan.plugins import RENDERERS, load_renderer
from svbrdfgan.protocols import Renderer, RendererCapabilities
from svbrdfgan.testing.contract import PluginKit
from svbrdfgan.testing.renderer.fixtures import ExampleScene
from svbrdfgan.types import Materials, Rendering, Surface, View


class RendererKit(PluginKit):
    """A renderer under test: that of the entry point `name`, unless `make_renderer` says otherwise."""

    group = RENDERERS

    def make_renderer(self) -> Renderer[Any]:
        """A renderer of its own for each test; override to test one that is not installed."""
        return load_renderer(self.name, self.options)

    def make_plugin(self) -> Renderer[Any]:
        return self.make_renderer()

    @property
    def installed(self) -> bool:
        return bool(self.name) and type(self).make_renderer is RendererKit.make_renderer

    def results(self, plugin: Renderer[Any]) -> dict[str, Any]:
        """A picture: gradients need not be the same bit for bit on every device."""
        rendering = ExampleScene().render(plugin)
        return {"image": rendering.image, "coverage": rendering.coverage}

    def uses(self, plugin: Renderer[Any]) -> Iterator[object]:
        """Picture, gradients and transport."""
        return ExampleScene().uses(plugin)

    @cached_property
    def renderer(self) -> Renderer[Any]:
        return self.make_renderer()

    @property
    def capabilities(self) -> RendererCapabilities:
        return self.renderer.capabilities

    def render(self, surface: Surface, materials: Materials, view: View, *, spp: int = 16, seed: int = 0) -> Rendering:
        """The surface, prepared and rendered."""
        return self.renderer.render(self.renderer.prepare(surface), materials, view, spp=spp, seed=seed)
