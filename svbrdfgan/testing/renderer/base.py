"""What every test of a renderer starts from."""

from __future__ import annotations

from functools import cached_property
from typing import Any

from svbrdfgan.plugins import load_renderer
from svbrdfgan.protocols import Renderer, RendererCapabilities
from svbrdfgan.testing.kit import Kit
from svbrdfgan.types import Materials, Rendering, Surface, View


class RendererKit(Kit):
    """A renderer under test: that of the entry point `name`, unless `make_renderer` says otherwise."""

    def make_renderer(self) -> Renderer[Any]:
        """A renderer of its own for each test; override to test one that is not installed."""
        return load_renderer(self.name, self.options)

    @cached_property
    def renderer(self) -> Renderer[Any]:
        return self.make_renderer()

    @property
    def capabilities(self) -> RendererCapabilities:
        return self.renderer.capabilities

    def render(self, surface: Surface, materials: Materials, view: View, *, spp: int = 16, seed: int = 0) -> Rendering:
        """The surface, prepared and rendered."""
        return self.renderer.render(self.renderer.prepare(surface), materials, view, spp=spp, seed=seed)
