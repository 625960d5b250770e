"""Results come in order, however many threads there are, and not far ahead of who takes them."""

import threading
import time
from collections.abc import Iterator

import pytest
import torch

from svbrdfgan.utils.threads import in_threads


@pytest.fixture(params=[1, 2, 3])
def threads(request: pytest.FixtureRequest) -> Iterator[int]:
    before = torch.get_num_threads()
    torch.set_num_threads(request.param)
    yield request.param
    torch.set_num_threads(before)


def test_results_are_in_order(threads: int) -> None:
    def late(number: int) -> int:
        time.sleep(0.001 * (number % 3))
        return number**2

    assert list(in_threads(late, range(20))) == [number**2 for number in range(20)]


def test_errors_arrive(threads: int) -> None:
    def fail(number: int) -> int:
        raise ValueError(f"item {number}")

    with pytest.raises(ValueError, match="item 0"):
        list(in_threads(fail, range(9)))


def test_few_results_wait(threads: int) -> None:
    taken = 0

    def items() -> Iterator[int]:
        for number in range(50):
            assert number - taken <= 2 * threads + 1
            yield number

    for _ in in_threads(abs, items()):
        taken += 1
    assert taken == 50


def test_work_inside_of_work_starts_no_threads(threads: int) -> None:
    def inner(_: int) -> set[str]:
        return set(in_threads(lambda _: threading.current_thread().name, range(4)))

    names = list(in_threads(inner, range(4)))
    assert all(len(found) == 1 for found in names) or threads == 1
