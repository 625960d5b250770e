"""What the kit says of a wrong renderer."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch

from svbrdfgan.testing.kit import Outcome, run_kit
from svbrdfgan.testing.renderer import RendererTests
from wrong.base import Right


def failures(renderer: type[Right], *tests: str, power: float = 1.0) -> dict[str, str]:
    """The tests of the kit that a renderer fails, with their messages; of all, or of some."""
    return {o.name: o.message for o in outcomes(renderer, *tests, power=power) if o.status == "failed"}


def outcomes(renderer: type[Right], *tests: str, power: float = 1.0) -> Iterator[Outcome]:
    def make_renderer(self: Any) -> Any:
        return renderer()

    kit = type("Kit", (RendererTests,), {"make_renderer": make_renderer, "power": power})
    for test in tests or ("",):
        running = run_kit(kit, test)
        while True:
            with process_left_alone():
                outcome = next(running, None)
            if outcome is None:
                break
            yield outcome


@contextmanager
def process_left_alone() -> Iterator[None]:
    """Undoes what wrong renderers do to the process."""
    dtype, state, other = torch.get_default_dtype(), torch.random.get_rng_state(), np.random.get_state()
    try:
        yield
    finally:
        torch.set_default_dtype(dtype)
        torch.random.set_rng_state(state)
        np.random.set_state(other)
