"""What renderers and embeddings have in common: found, typed, picklable, named, and no business of the process."""

from __future__ import annotations

import inspect
import pickle
import random
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, ClassVar

import numpy as np
import torch
from numpy import ndarray
from torch import Tensor

from svbrdfgan.plugins import find_plugin, import_factory, make
from svbrdfgan.testing.kit import Kit, check, declared

LONGEST_REPR = 200


class PluginKit(Kit):
    """What a kit says of its plugin, for the tests that all kits share.

    Attributes:
        group: of its entry point.
    """

    group: ClassVar[str] = ""

    @property
    def installed(self) -> bool:
        """Whether the plugin is that of the entry point `name`, and not one that the kit's heir makes itself."""
        raise NotImplementedError

    def make_plugin(self) -> Any:
        """A plugin of its own."""
        raise NotImplementedError

    def results(self, plugin: Any) -> Mapping[str, Any]:
        """What it makes of the same inputs, to be the same bit for bit each time."""
        raise NotImplementedError

    def uses(self, plugin: Any) -> Iterator[object]:
        """All that can be done with it, one after the other."""
        yield self.results(plugin)

    def require_unchanged(self, states: Mapping[str, Callable[[], object]]) -> None:
        """Fails if a use of the plugin changes what these functions say."""
        before = {name: state() for name, state in states.items()}
        for _ in self.uses(self.make_plugin()):
            for name, state in states.items():
                was, now = before[name], state()
                check(same(was, now), f"{name} was changed, from {_short(was)} to {_short(now)}; restore it.")


class PluginTests(PluginKit):
    """Entry point, options, pickles, and the process's own chance and settings."""

    def test_its_entry_point_finds_it(self) -> None:
        """Its entry point's name leads to it, and its defaults suffice."""
        declared(self.installed, "an entry point")
        make(find_plugin(self.group, self.name))

    def test_options_have_types_and_defaults(self) -> None:
        """Its constructor's parameters are named, annotated, and have defaults."""
        factory = import_factory(find_plugin(self.group, self.name)) if self.installed else type(self.make_plugin())
        for option in inspect.signature(factory).parameters.values():
            plain = option.kind in (option.POSITIONAL_OR_KEYWORD, option.KEYWORD_ONLY)
            check(plain, f"its constructor takes {option}; wanted only named options, so that a typing error is found.")
            check(option.annotation is not option.empty, f"its option {option.name!r} has no type.")
            check(option.default is not option.empty, f"its option {option.name!r} has no default.")

    def test_it_pickles(self) -> None:
        """A copy that went through pickle, as to a worker process, does the same."""
        plugin = self.make_plugin()
        again = pickle.loads(pickle.dumps(plugin))
        check(again.capabilities == plugin.capabilities, "its capabilities did not survive pickle.")
        with seeded(0):
            wanted = self.results(plugin)
        with seeded(0):
            found = changed(wanted, self.results(again))
        check(not found, f"after pickle the same inputs give other {', '.join(found)}.")

    def test_its_repr_is_one_line(self) -> None:
        """Its repr is one line of at most 200 characters that names its class, and no address."""
        plugin = self.make_plugin()
        text = repr(plugin)
        short = "\n" not in text and len(text) <= LONGEST_REPR
        named = type(plugin).__name__ in text and " at 0x" not in text
        check(short and named, f"its repr is {text[:300]!r}; wanted one such as a dataclass has.")

    def test_random_generators_are_left_alone(self) -> None:
        """torch's, NumPy's and Python's own random numbers are left alone."""
        with seeded(0):
            self.require_unchanged(
                {
                    "torch's random state": torch.random.get_rng_state,
                    "NumPy's random state": lambda: np.random.get_state(legacy=False),
                    "Python's random state": random.getstate,
                }
            )

    def test_random_seeds_of_the_caller_do_not_matter(self) -> None:
        """Global random generators, seeded otherwise, change nothing."""
        results = []
        for seed in (1, 2):
            with seeded(seed):
                results.append(self.results(self.make_plugin()))
        found = changed(*results)
        check(not found, f"other seeds of torch, NumPy and random give other {', '.join(found)}.")

    def test_settings_of_torch_and_numpy_are_left_alone(self) -> None:
        """Default dtype and device, grad mode, threads and error handling stay."""
        dtype, grad = torch.get_default_dtype(), torch.is_grad_enabled()
        try:
            with np.errstate(divide="warn", over="warn", under="ignore", invalid="warn"):
                self.require_unchanged(
                    {
                        "torch's default dtype": torch.get_default_dtype,
                        "torch's default device": torch.get_default_device,
                        "torch's grad mode": torch.is_grad_enabled,
                        "torch's number of threads": torch.get_num_threads,
                        "torch's deterministic algorithms": torch.are_deterministic_algorithms_enabled,
                        "torch's matmul precision": torch.get_float32_matmul_precision,
                        "NumPy's error handling": np.geterr,
                    }
                )
        finally:
            torch.set_default_dtype(dtype)
            torch.set_grad_enabled(grad)


@contextmanager
def seeded(seed: int) -> Iterator[None]:
    """The global random generators seeded, and as they were afterwards."""
    python, numpy, pytorch = random.getstate(), np.random.get_state(), torch.get_rng_state()
    for generator in (random.seed, np.random.seed, torch.manual_seed):
        generator(seed)
    try:
        yield
    finally:
        random.setstate(python)
        np.random.set_state(numpy)
        torch.set_rng_state(pytorch)


def changed(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """The names under which two results are not the same, bit for bit."""
    return [name for name in one if not same(one[name], other[name])]


def same(a: Any, b: Any) -> bool:
    """Whether two states or results are the same, bit for bit."""
    if isinstance(a, Tensor):
        return bool(torch.equal(a, b))
    if isinstance(a, ndarray):
        return bool(np.array_equal(a, b))
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    return bool(a == b)


def _short(value: object) -> str:
    text = " ".join(str(value).split())
    return text if len(text) <= 40 else f"{text[:37]}..."
