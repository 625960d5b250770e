"""The protocol: what an embedding is, whatever it does with the mesh."""

from __future__ import annotations

import inspect
import pickle
import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields

import numpy as np
import torch

from svbrdfgan.plugins import EMBEDDINGS, find_plugin, import_factory
from svbrdfgan.protocols import UVCapabilities, UVEmbedding
from svbrdfgan.testing.embedding.base import EmbeddingKit
from svbrdfgan.testing.embedding.meshes import body, box
from svbrdfgan.testing.kit import check, declared
from svbrdfgan.types import Surface

_FLOATS = ("positions", "normals", "uv", "elevation", "source_barycentric")
_INTEGERS = ("faces", "face_part", "source_face")


class ContractTests(EmbeddingKit):
    """An embedding keeps `svbrdfgan.protocols.UVEmbedding`."""

    def test_is_found_by_its_entry_point(self) -> None:
        """It is installed under its name, and the class or function named there can be imported."""
        declared(bool(self.name), "an entry point")
        check(callable(import_factory(find_plugin(EMBEDDINGS, self.name))), f"{self.name!r} is no class or function.")

    def test_is_an_embedding(self) -> None:
        """It has the members of the protocol, and its capabilities are a `UVCapabilities` of two booleans."""
        check(isinstance(self.embedding, UVEmbedding), f"{self.embedding!r} lacks `capabilities` or `embed`.")
        record = self.capabilities
        check(isinstance(record, UVCapabilities), f"capabilities are {record!r}; wanted a UVCapabilities.")
        check(
            all(isinstance(getattr(record, field.name), bool) for field in fields(UVCapabilities)),
            f"capabilities are {record}; wanted True or False in each field.",
        )

    def test_options_are_typed_and_have_defaults(self) -> None:
        """Every parameter of the constructor can be given by its name, has an annotation, and a default."""
        factory = import_factory(find_plugin(EMBEDDINGS, self.name)) if self.name else type(self.embedding)
        for option in inspect.signature(factory).parameters.values():
            check(
                option.kind in (option.POSITIONAL_OR_KEYWORD, option.KEYWORD_ONLY),
                f"option {option} of {factory!r} has no name that a configuration could give.",
            )
            check(option.annotation is not option.empty, f"option {option.name!r} of {factory!r} has no annotation.")
            check(option.default is not option.empty, f"option {option.name!r} of {factory!r} has no default.")

    def test_embed_takes_a_mesh(self) -> None:
        """`embed(mesh=...)` gives a `Surface`; no other argument is needed."""
        names = list(inspect.signature(self.embedding.embed).parameters)
        check(names[:1] == ["mesh"], f"the parameters of embed are {names}; wanted the first to be 'mesh'.")
        made = self.embedding.embed(mesh=body())
        check(isinstance(made, Surface), f"embed gave a {type(made).__name__}; wanted a Surface.")

    def test_capabilities_are_constant(self) -> None:
        """They are the same before and after use, in another instance as well, and can be a key."""
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
        """The same mesh gives the same surface bit for bit, after other meshes too, and in another instance."""
        with _seeded(0):
            first = self.embedding.embed(body())
            self.embedding.embed(box())
        for embedding, what in ((self.embedding, "again"), (self.make_embedding(), "by another instance")):
            with _seeded(0):
                changed = differences(first, embedding.embed(body()))
            check(not changed, f"the same mesh, embedded {what}, has other {', '.join(changed)}.")

    def test_chance_plays_no_part(self) -> None:
        """No random generator of Python, NumPy or torch is read or moved on."""
        surfaces = []
        for seed in (0, 1):
            with _seeded(seed):
                before = _random_states()
                surfaces.append(self.make_embedding().embed(body()))
                moved = [name for name, state in _random_states().items() if state != before[name]]
            check(not moved, f"embedding moved on the random generator of {', '.join(moved)}; use one of its own.")
        changed = differences(*surfaces)
        check(not changed, f"other seeds of the global generators give other {', '.join(changed)}.")

    def test_leaves_the_mesh_as_it_was(self) -> None:
        """The mesh's arrays are not written to."""
        mesh, wanted = body(), body()
        self.embedding.embed(mesh)
        for name in ("positions", "faces", "face_part", "uv"):
            check(np.array_equal(getattr(mesh, name), getattr(wanted, name)), f"embedding wrote into mesh.{name}.")

    def test_leaves_settings_as_they_were(self) -> None:
        """torch's default dtype and gradient mode, and what NumPy does about floating-point errors, stay."""
        settings: dict[str, Callable[[], object]] = {
            "torch's default dtype": torch.get_default_dtype,
            "torch's gradient mode": torch.is_grad_enabled,
            "torch's deterministic mode": torch.are_deterministic_algorithms_enabled,
            "numpy.errstate": np.geterr,
        }
        dtype, grad = torch.get_default_dtype(), torch.is_grad_enabled()
        with np.errstate(divide="warn", over="warn", under="ignore", invalid="warn"):
            before = {name: read() for name, read in settings.items()}
            self.embedding.embed(body())
            changed = [name for name, read in settings.items() if read() != before[name]]
        torch.set_default_dtype(dtype)
        torch.set_grad_enabled(grad)
        check(not changed, f"embedding changed {', '.join(changed)} for the whole process; restore it.")

    def test_pickles(self) -> None:
        """A copy that went through pickle, as to a worker process, embeds alike."""
        with _seeded(0):
            copy = pickle.loads(pickle.dumps(self.embedding))
            wanted = self.embedding.embed(body())
        with _seeded(0):
            changed = differences(wanted, copy.embed(body()))
        check(not changed, f"after pickling, the same mesh has other {', '.join(changed)}.")

    def test_repr_says_what_it_is(self) -> None:
        """Its repr is one line that names the class and no address."""
        text = repr(self.embedding)
        check(
            type(self.embedding).__name__ in text and " at 0x" not in text and "\n" not in text,
            f"repr is {text!r}; wanted one line with the class's name and its options, such as a dataclass has.",
        )


def differences(one: Surface, other: Surface) -> list[str]:
    """The fields in which two surfaces are not the same, bit for bit."""
    return [
        *(name for name in (*_FLOATS, *_INTEGERS) if not np.array_equal(getattr(one, name), getattr(other, name))),
        *(name for name in ("parts", "repeat") if getattr(one, name) != getattr(other, name)),
    ]


@contextmanager
def _seeded(seed: int) -> Iterator[None]:
    """The global random generators seeded, and as they were afterwards."""
    python, numpy, pytorch = random.getstate(), np.random.get_state(), torch.get_rng_state()
    random.seed(seed)
    np.random.seed(seed)
    torch.manual_seed(seed)
    try:
        yield
    finally:
        random.setstate(python)
        np.random.set_state(numpy)
        torch.set_rng_state(pytorch)


def _random_states() -> dict[str, bytes]:
    return {
        "Python": pickle.dumps(random.getstate()),
        "NumPy": pickle.dumps(np.random.get_state()),
        "torch": pickle.dumps(torch.get_rng_state().tolist()),
    }
