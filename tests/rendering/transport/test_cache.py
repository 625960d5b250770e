"""Transports are prefetched from files."""

from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from svbrdfgan.errors import AssetError
from svbrdfgan.rendering.transport.cache import TransportReader
from svbrdfgan.rendering.transport.light_transport import LightTransport
from svbrdfgan.rendering.transport.product import TransportBatch
from svbrdfgan.utils.memory_cache import MemoryCache

Make = Callable[..., LightTransport]
DEVICES = ("cpu", "cuda") if torch.cuda.is_available() else ("cpu",)


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
