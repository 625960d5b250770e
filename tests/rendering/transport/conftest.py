"""Random transports with the edge cases of sparse products: empty rows, a long row, several textures, no entries."""

from collections.abc import Callable

import pytest
import torch

from svbrdfgan.rendering.transport.light_transport import LightTransport

HEIGHT, WIDTH, ROWS, COLS = 7, 9, 6, 8


def random_transport(seed: int, parts: int = 1, longest: int = 50, scale: float = 1.0) -> LightTransport:
    """In single precision. Half of the pixels are empty, one has `longest` entries; without parts, all are empty."""
    rng = torch.Generator().manual_seed(seed)
    count = torch.randint(6, (HEIGHT * WIDTH,), generator=rng) * (torch.rand(HEIGHT * WIDTH, generator=rng) < 0.5)
    count[int(torch.randint(HEIGHT * WIDTH, (1,), generator=rng))] = longest
    count = count.clamp(max=parts * ROWS * COLS)
    texel = [torch.randperm(parts * ROWS * COLS, generator=rng)[: int(n)].sort().values for n in count]
    return LightTransport(
        start=torch.cat([torch.zeros(1, dtype=torch.long), count.cumsum(0)]).int(),
        texel=torch.cat(texel).int(),
        weight=torch.rand(int(count.sum()), 3, generator=rng),
        scale=torch.tensor(scale),
        background=torch.rand(HEIGHT, WIDTH, 3, generator=rng),
        coverage=torch.rand(HEIGHT, WIDTH, generator=rng),
        gbuffer=torch.randn(HEIGHT, WIDTH, 6, generator=rng),
        parts=tuple(range(parts)),
        texture_shape=(ROWS, COLS),
    )


@pytest.fixture
def make_transport() -> Callable[..., LightTransport]:
    return random_transport
