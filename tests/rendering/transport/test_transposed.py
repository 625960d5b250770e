"""The transpose of a batch of transports as an operation of its own, with its gradient."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from svbrdfgan.rendering.transport.light_transport import LightTransport
from svbrdfgan.rendering.transport.product import ReferenceProduct, TransportBatch

ROWS, COLS, HEIGHT, WIDTH = 5, 4, 6, 7


def view(seed: int, parts: tuple[int, ...]) -> LightTransport:
    rng = torch.Generator().manual_seed(seed)
    pixels, texels = HEIGHT * WIDTH, len(parts) * ROWS * COLS
    count = torch.randint(0, 4, (pixels,), generator=rng)
    start = torch.cat([torch.zeros(1, dtype=torch.int64), count.cumsum(0)]).int()
    texel = torch.cat([torch.randperm(texels, generator=rng)[: int(n)].sort().values for n in count]).int()
    return LightTransport(
        start=start,
        texel=texel,
        weight=torch.rand(len(texel), 3, generator=rng),
        scale=torch.tensor(1.5),
        background=torch.rand(HEIGHT, WIDTH, 3, generator=rng),
        coverage=torch.ones(HEIGHT, WIDTH),
        gbuffer=torch.zeros(HEIGHT, WIDTH, 6),
        parts=parts,
        texture_shape=(ROWS, COLS),
    )


@pytest.fixture(params=["csr", "reference"])
def batch(request: pytest.FixtureRequest) -> TransportBatch:
    made = TransportBatch.stack([view(0, (0, 2)), view(1, (1,))])
    return made if request.param == "csr" else replace(made, product=ReferenceProduct(made.transports))


def random(*size: int, seed: int = 9) -> Tensor:
    return torch.rand(*size, generator=torch.Generator().manual_seed(seed))


def test_linear_is_the_picture_without_its_background(batch: TransportBatch) -> None:
    textures = random(3, ROWS, COLS, 3)
    torch.testing.assert_close(batch.linear(textures) + batch.background, batch.render(textures))
    torch.testing.assert_close(batch.linear(2 * textures), 2 * batch.linear(textures))


def test_it_is_the_transpose(batch: TransportBatch) -> None:
    textures, images = random(3, ROWS, COLS, 3), random(2, HEIGHT, WIDTH, 3)
    left, right = (batch.linear(textures) * images).sum(), (textures * batch.transposed(images)).sum()
    torch.testing.assert_close(left, right)


def test_the_gradient_of_the_transpose_is_the_product(batch: TransportBatch) -> None:
    images, weight = random(2, HEIGHT, WIDTH, 3).requires_grad_(True), random(3, ROWS, COLS, 3)
    (batch.transposed(images) * weight).sum().backward()
    assert images.grad is not None
    torch.testing.assert_close(images.grad, batch.linear(weight))


def test_small_gradients_are_not_lost_before_a_bright_background(batch: TransportBatch) -> None:
    weight = random(3, ROWS, COLS, 3)
    images = random(2, HEIGHT, WIDTH, 3).requires_grad_(True)
    (batch.transposed(images) * 1e-8 * weight).sum().backward()
    assert images.grad is not None
    torch.testing.assert_close(images.grad * 1e8, batch.linear(weight))
    torch.testing.assert_close(batch.linear(1e-8 * weight) * 1e8, batch.linear(weight))
