"""What every test of a UV embedding starts from."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

from svbrdfgan.plugins import load_embedding
from svbrdfgan.protocols import UVCapabilities, UVEmbedding
from svbrdfgan.testing.embedding.meshes import body, box, clutter, shell
from svbrdfgan.testing.kit import Kit, check
from svbrdfgan.types import Mesh, Surface

_ORDINARY = (body, box, shell, clutter)


class EmbeddingKit(Kit):
    """A UV embedding under test: that of the entry point `name`, unless `make_embedding` says otherwise."""

    def make_embedding(self) -> UVEmbedding:
        """An embedding of its own for each test; override to test one that is not installed."""
        return load_embedding(self.name, self.options)

    @cached_property
    def embedding(self) -> UVEmbedding:
        return self.make_embedding()

    @property
    def capabilities(self) -> UVCapabilities:
        return self.embedding.capabilities

    def surfaces(self) -> Iterator[tuple[str, Mesh, Surface]]:
        """The ordinary meshes that can be embedded, each with its name and surface.

        Whether a mesh may be refused, and how, is for the tests of robustness.
        """
        refused = []
        for make in _ORDINARY:
            try:
                surface = self.embedding.embed(make())
            except Exception as error:
                refused.append(f"{make.__name__}: {type(error).__name__}: {error}")
            else:
                yield make.__name__, make(), surface
        check(len(refused) < len(_ORDINARY), f"no mesh can be embedded at all: {'; '.join(refused)}")
