"""Values in memory, within a budget."""

import torch

from svbrdfgan.utils.memory_cache import MemoryCache


def test_the_least_recently_used_is_dropped_first() -> None:
    tensor = torch.zeros(4)
    cache: MemoryCache[str, torch.Tensor] = MemoryCache(3 * tensor.nbytes)
    for key in "abc":
        cache[key] = tensor
    assert cache.get("a") is tensor
    cache["d"] = tensor
    assert set(cache) == {"a", "c", "d"}
    assert cache.get("b") is None
    assert "b" not in cache


def test_bytes_are_counted_through_every_change() -> None:
    tensors = [torch.zeros(100 * n) for n in range(5)]
    cache: MemoryCache[int, torch.Tensor] = MemoryCache(sum(t.nbytes for t in tensors[1:4]))
    for n in (0, 1, 2, 0, 3, 4, 1, 1, 2, 0):
        cache[n] = tensors[n]
        assert cache.nbytes == sum(t.nbytes for t in cache.values())
        assert cache.nbytes <= sum(t.nbytes for t in tensors[1:4])
    del cache[0]
    cache.clear()
    assert (len(cache), cache.nbytes) == (0, 0)


def test_one_that_exceeds_the_budget_stays_alone() -> None:
    cache: MemoryCache[int, torch.Tensor] = MemoryCache(1)
    cache[0], cache[1] = torch.zeros(3), torch.zeros(4)
    assert list(cache) == [1]


def test_without_a_budget_there_is_plenty() -> None:
    cache: MemoryCache[int, torch.Tensor] = MemoryCache()
    for n in range(50):
        cache[n] = torch.zeros(1000)
    assert len(cache) == 50
