"""The tests that renderers and embeddings share: entry point, options, pickling, repr, and no global side effects."""

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

from svbrdfgan.plugins.registry import find_plugin, import_factory, make
from svbrdfgan.testing.kit import Kit, check, declared

LONGEST_REPR = 200


class PluginKit(Kit):
    """A kit with all that the shared tests need to know of its plugin.

    Attributes:
        group: of its entry point.
    """

    group: ClassVar[str] = ""

    @property
    def installed(self) -> bool:
        """Whether the plugin comes from the entry point `name`, and not from a method that a subclass overrides."""
        raise NotImplementedError

    def make_plugin(self) -> Any:
        """A new plugin."""
        raise NotImplementedError

    def results(self, plugin: Any) -> Mapping[str, Any]:
        """The plugin's results for fixed inputs, which must be the same bit for bit each time."""
        raise NotImplementedError

    def uses(self, plugin: Any) -> Iterator[object]:
        """Runs everything that the plugin can do, one step at a time."""
        yield self.results(plugin)

    def require_unchanged(self, states: Mapping[str, Callable[[], object]]) -> None:
        """Fails if using the plugin changes what one of these functions returns."""
        before = {name: state() for name, state in states.items()}
        for _ in self.uses(self.make_plugin()):
            for name, state in states.items():
                was, now = before[name], state()
                check(same(was, now), f"{name} was changed, from {_short(was)} to {_short(now)}; restore it.")


class PluginTests(PluginKit):
    """Entry point, options, pickling, and the process's random generators and settings."""

    def test_its_entry_point_finds_it(self) -> None:
        """The plugin's entry point loads it, and its default options suffice."""
        declared(self.installed, "an entry point")
        make(find_plugin(self.group, self.name))

    def test_options_have_types_and_defaults(self) -> None:
        """The constructor's parameters are named, annotated, and have defaults."""
        factory = import_factory(find_plugin(self.group, self.name)) if self.installed else type(self.make_plugin())
        for option in inspect.signature(factory).parameters.values():
            plain = option.kind in (option.POSITIONAL_OR_KEYWORD, option.KEYWORD_ONLY)
            check(plain, f"its constructor takes {option}; wanted only named options, so that a typing error is found.")
            check(option.annotation is not option.empty, f"its option {option.name!r} has no type.")
            check(option.default is not option.empty, f"its option {option.name!r} has no default.")

    def test_it_pickles(self) -> None:
        """A pickled copy, as in a worker process, gives the same results."""
        plugin = self.make_plugin()
        again = pickle.loads(pickle.dumps(plugin))
        check(again.capabilities == plugin.capabilities, "its capabilities did not survive pickle.")
        with seeded(0):
            wanted = self.results(plugin)
        with seeded(0):
            found = changed(wanted, self.results(again))
        check(not found, f"after pickle the same inputs give other {', '.join(found)}.")

    def test_its_repr_is_one_line(self) -> None:
        """The plugin's repr is one line of at most 200 characters with its class's name and no memory address."""
        plugin = self.make_plugin()
        text = repr(plugin)
        short = "\n" not in text and len(text) <= LONGEST_REPR
        named = type(plugin).__name__ in text and " at 0x" not in text
        check(short and named, f"its repr is {text[:300]!r}; wanted one such as a dataclass has.")

    def test_random_generators_are_left_alone(self) -> None:
        """The plugin does not advance or seed the random generators of torch, NumPy and Python."""
        with seeded(0):
            self.require_unchanged(
                {
                    "torch's random state": torch.random.get_rng_state,
                    "NumPy's random state": lambda: np.random.get_state(legacy=False),
                    "Python's random state": random.getstate,
                }
            )

    def test_random_seeds_of_the_caller_do_not_matter(self) -> None:
        """The plugin's results do not depend on the seeds of the global random generators."""
        results = []
        for seed in (1, 2):
            with seeded(seed):
                results.append(self.results(self.make_plugin()))
        found = changed(*results)
        check(not found, f"other seeds of torch, NumPy and random give other {', '.join(found)}.")

    def test_settings_of_torch_and_numpy_are_left_alone(self) -> None:
        """The plugin leaves the default dtype and device, grad mode, threads and error handling as they were."""
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
    """Seeds the global random generators, and restores their states afterwards."""
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
    """The names of the results that differ in any bit."""
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
