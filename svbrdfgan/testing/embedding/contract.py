"""Tests of the embedding protocol, independent of the map."""

from __future__ import annotations

import inspect
from dataclasses import fields

import numpy as np

from svbrdfgan.protocols import UVCapabilities, UVEmbedding
from svbrdfgan.testing.contract import PluginTests, changed, seeded
from svbrdfgan.testing.embedding.base import EmbeddingKit
from svbrdfgan.testing.embedding.meshes import body, box
from svbrdfgan.testing.kit import check
from svbrdfgan.types import Surface

_FLOATS = ("positions", "normals", "uv", "elevation", "source_barycentric")
_INTEGERS = ("faces", "face_part", "source_face")


class ContractTests(PluginTests, EmbeddingKit):
    """An embedding conforms to `svbrdfgan.protocols.UVEmbedding`."""

    def test_is_an_embedding(self) -> None:
        """The embedding has the protocol's members, and its capabilities are a `UVCapabilities` of two booleans."""
        check(isinstance(self.embedding, UVEmbedding), f"{self.embedding!r} lacks `capabilities` or `embed`.")
        record = self.capabilities
        check(isinstance(record, UVCapabilities), f"capabilities are {record!r}; wanted a UVCapabilities.")
        check(
            all(isinstance(getattr(record, field.name), bool) for field in fields(UVCapabilities)),
            f"capabilities are {record}; wanted True or False in each field.",
        )

    def test_embed_takes_a_mesh(self) -> None:
        """`embed(mesh=...)` gives a `Surface`; no other argument is needed."""
        names = list(inspect.signature(self.embedding.embed).parameters)
        check(names[:1] == ["mesh"], f"the parameters of embed are {names}; wanted the first to be 'mesh'.")
        made = self.embedding.embed(mesh=body())
        check(isinstance(made, Surface), f"embed gave a {type(made).__name__}; wanted a Surface.")

    def test_capabilities_are_constant(self) -> None:
        """Capabilities are the same before and after use and in another instance, and are hashable."""
        before = self.capabilities
        hash(before)
        self.embedding.embed(body())
        check(self.capabilities == before, f"capabilities were {before} and are {self.capabilities} after embedding.")
        other = self.make_embedding().capabilities
        check(other == before, f"capabilities are {before}, of another instance with the same options {other}.")

    def test_surfaces_are_float64_and_int64(self) -> None:
        """Geometry is NumPy, in float64 and int64."""
        surface = self.embedding.embed(body())
        for names, wanted in ((_FLOATS, np.float64), (_INTEGERS, np.int64)):
            found = {name: getattr(surface, name).dtype for name in names}
            wrong = {name: str(dtype) for name, dtype in found.items() if dtype != wanted}
            check(not wrong, f"{wrong}; wanted {np.dtype(wanted)}.")

    def test_is_a_pure_function_of_the_mesh(self) -> None:
        """The same mesh gives the same surface bit for bit, also after other meshes and in another instance."""
        with seeded(0):
            first = self.results(self.embedding)
            self.embedding.embed(box())
        for embedding, what in ((self.embedding, "again"), (self.make_embedding(), "by another instance")):
            with seeded(0):
                found = changed(first, self.results(embedding))
            check(not found, f"the same mesh, embedded {what}, has other {', '.join(found)}.")

    def test_leaves_the_mesh_as_it_was(self) -> None:
        """The mesh's arrays are not written to."""
        mesh, wanted = body(), body()
        self.embedding.embed(mesh)
        for name in ("positions", "faces", "face_part", "uv"):
            check(np.array_equal(getattr(mesh, name), getattr(wanted, name)), f"embedding wrote into mesh.{name}.")
