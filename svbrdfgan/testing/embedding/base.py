"""The base class of all tests of a UV embedding."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from functools import cached_property
from typing import Any

from svbrdfgan.plugins.registry import EMBEDDINGS, load_embedding
from svbrdfgan.protocols import UVCapabilities, UVEmbedding
from svbrdfgan.testing.contract import PluginKit
from svbrdfgan.testing.embedding.meshes import body, box, clutter, shell
from svbrdfgan.testing.kit import check
from svbrdfgan.types import Mesh, Surface

_ORDINARY = (body, box, shell, clutter)


class EmbeddingKit(PluginKit):
    """A UV embedding under test: the plugin of the entry point `name`, unless `make_embedding` is overridden."""

    group = EMBEDDINGS

    def make_embedding(self) -> UVEmbedding:
        """A new embedding for each test; override it to test an embedding that is not installed."""
        return load_embedding(self.name, self.options)

    def make_plugin(self) -> UVEmbedding:
        return self.make_embedding()

    @property
    def installed(self) -> bool:
        return bool(self.name) and type(self).make_embedding is EmbeddingKit.make_embedding

    def results(self, plugin: UVEmbedding) -> dict[str, Any]:
        """The fields of the surface that a plugin makes of `body`."""
        return contents(plugin.embed(body()))

    @cached_property
    def embedding(self) -> UVEmbedding:
        return self.make_embedding()

    @property
    def capabilities(self) -> UVCapabilities:
        return self.embedding.capabilities

    def surfaces(self) -> Iterator[tuple[str, Mesh, Surface]]:
        """The ordinary meshes that can be embedded, each with its name and surface.

        Meshes that raise an error are left out here; `RobustnessTests` judges the errors.
        """
        refused = []
        for make in _ORDINARY:
            try:
                surface = self.embedding.embed(make())
            except Exception as error:  # any error counts as a refusal
                refused.append(f"{make.__name__}: {type(error).__name__}: {error}")
            else:
                yield make.__name__, make(), surface
        check(len(refused) < len(_ORDINARY), f"no mesh can be embedded at all: {'; '.join(refused)}")


def contents(surface: Surface) -> dict[str, Any]:
    """The surface's fields, arrays and others, by name."""
    return {field.name: getattr(surface, field.name) for field in fields(Surface)}
