"""The base class of all tests of a renderer."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any

from svbrdfgan.plugins.registry import RENDERERS, load_renderer
from svbrdfgan.protocols import Renderer, RendererCapabilities
from svbrdfgan.rendering.checked_renderer import CheckedRenderer, checked
from svbrdfgan.testing.contract import PluginKit
from svbrdfgan.testing.renderer.fixtures import ExampleScene
from svbrdfgan.types import Materials, Rendering, Surface, View


class RendererKit(PluginKit):
    """A renderer under test: the plugin of the entry point `name`, unless `make_renderer` is overridden."""

    group = RENDERERS

    def make_renderer(self) -> Renderer[Any]:
        """A new renderer, for each test; override to test one that is not installed."""
        return load_renderer(self.name, self.options)

    def make_plugin(self) -> Renderer[Any]:
        return checked(self.make_renderer()).plugin

    @property
    def installed(self) -> bool:
        return bool(self.name) and type(self).make_renderer is RendererKit.make_renderer

    def results(self, plugin: Renderer[Any]) -> dict[str, Any]:
        """A picture; gradients are left out, as some devices do not reproduce them bit for bit."""
        rendering = ExampleScene().render(checked(plugin))
        return {"image": rendering.image, "coverage": rendering.coverage}

    def uses(self, plugin: Renderer[Any]) -> Iterator[object]:
        """Picture, gradients and transport."""
        return ExampleScene().uses(checked(plugin))

    @cached_property
    def renderer(self) -> CheckedRenderer:
        """The renderer as the core calls it, behind its checks."""
        return checked(self.make_renderer())

    @property
    def capabilities(self) -> RendererCapabilities:
        return self.renderer.capabilities

    def render(self, surface: Surface, materials: Materials, view: View, *, spp: int = 16, seed: int = 0) -> Rendering:
        """Prepares and renders the surface."""
        return self.renderer.render(self.renderer.prepare(surface), materials, view, spp=spp, seed=seed)
