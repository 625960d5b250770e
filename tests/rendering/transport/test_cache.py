"""Transports in memory within a budget, and their prefetching."""

from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from svbrdfgan.errors import AssetError
from svbrdfgan.rendering.transport.cache import MemoryCache, TransportReader
from svbrdfgan.rendering.transport.light_transport import LightTransport
from svbrdfgan.rendering.transport.product import TransportBatch

Make = Callable[..., LightTransport]
DEVICES = ("cpu", "cuda") if torch.cuda.is_available() else ("cpu",)


def test_the_least_recently_used_is_dropped_first(make_transport: Make) -> None:
    transport = make_transport(0)
    cache: MemoryCache[str] = MemoryCache(3 * transport.nbytes)
    for key in "abc":
        cache[key] = transport
    assert cache.get("a") is transport
    cache["d"] = transport
    assert set(cache) == {"a", "c", "d"}
    assert cache.get("b") is None
    assert "b" not in cache


def test_bytes_are_counted_through_every_change(make_transport: Make) -> None:
    transports = [make_transport(n, parts=n) for n in range(5)]
    cache: MemoryCache[int] = MemoryCache(sum(t.nbytes for t in transports[1:4]))
    for n in (0, 1, 2, 0, 3, 4, 1, 1, 2, 0):
        cache[n] = transports[n]
        assert cache.nbytes == sum(t.nbytes for t in cache.values())
        assert cache.nbytes <= sum(t.nbytes for t in transports[1:4])
    del cache[0]
    cache.clear()
    assert (len(cache), cache.nbytes) == (0, 0)


def test_one_that_exceeds_the_budget_stays_alone(make_transport: Make) -> None:
    cache: MemoryCache[int] = MemoryCache(1)
    cache[0], cache[1] = make_transport(0), make_transport(1)
    assert list(cache) == [1]


def test_without_a_budget_there_is_plenty(make_transport: Make) -> None:
    cache: MemoryCache[int] = MemoryCache()
    for n in range(50):
        cache[n] = make_transport(n)
    assert len(cache) == 50


@pytest.mark.parametrize("device", DEVICES)
def test_what_is_prefetched_is_what_was_saved(make_transport: Make, tmp_path: Path, device: str) -> None:
    """More than the cache holds, so that memory is reused while products still run."""
    transports = [make_transport(n, parts=2).half() for n in range(24)]
    for n, transport in enumerate(transports):
        transport.save(tmp_path / f"{n}.safetensors")
    reader, cache = TransportReader(torch.device(device)), MemoryCache[int](2 * transports[0].nbytes)
    textures = torch.rand(2, 6, 8, 3, generator=torch.Generator().manual_seed(0))
    order = torch.randint(len(transports), (150,), generator=torch.Generator().manual_seed(1)).tolist()
    pending, pictures = [], []
    for n, following in zip([None, *order], [*order, None], strict=True):
        if following is not None:
            pending.append(reader.read(tmp_path / f"{following}.safetensors"))
        if n is not None:
            cache[n] = pending.pop(0).result()
            pictures.append(TransportBatch.stack([cache[n]]).render(textures.to(device))[0])
    for n, picture in zip(order, pictures, strict=True):
        expected = TransportBatch.stack([transports[n]]).render(textures)[0]
        torch.testing.assert_close(picture.cpu(), expected)


def test_a_damaged_file_raises_when_its_result_is_asked_for(make_transport: Make, tmp_path: Path) -> None:
    reader = TransportReader(torch.device("cpu"))
    (tmp_path / "broken.safetensors").write_bytes(b"x" * 100)
    broken, missing = reader.read(tmp_path / "broken.safetensors"), reader.read(tmp_path / "missing.safetensors")
    with pytest.raises(AssetError, match=r"broken\.safetensors"):
        broken.result()
    with pytest.raises(AssetError, match=r"missing\.safetensors"):
        missing.result()
