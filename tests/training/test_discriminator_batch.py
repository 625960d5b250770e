"""Augmentation of pairs: both sides alike, by what leaves a picture possible."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from svbrdfgan.training.discriminator_batch import ImageBatch, Pictures, composite_pair

COUNT = 64


def images(height: int = 8, width: int = 8, seed: int = 0) -> ImageBatch:
    rng = torch.Generator().manual_seed(seed)
    shape = (COUNT, height, width)
    return ImageBatch(
        torch.rand(*shape, 3, generator=rng),
        torch.ones(shape),
        torch.rand(*shape, 6, generator=rng),
        torch.rand(*shape, 9, generator=rng),
        torch.rand(*shape, 3, generator=rng),
        torch.rand(COUNT, 2, generator=rng),
    )


def pair(real: ImageBatch, fake: ImageBatch, augment: float | None) -> tuple[Pictures, Pictures]:
    augmented = None if augment is None else torch.tensor(augment)
    found = composite_pair(real, fake, np.random.default_rng(5), augmented)
    return found.real, found.fake


def mirrored(picture: Tensor) -> list[Tensor]:
    """The eight ways to lay a square on itself."""
    turned = [picture.rot90(k, (-2, -1)) for k in range(4)]
    return turned + [each.flip(-1) for each in turned]


def way_of(shown: Tensor, plain: Tensor) -> int:
    (way,) = [n for n, each in enumerate(mirrored(plain)) if torch.equal(each, shown)]
    return way


def test_a_pair_is_mirrored_and_turned_alike_in_all_ways() -> None:
    real, fake = images(), images(seed=1)
    plain, shown = pair(real, fake, augment=None), pair(real, fake, augment=1.0)
    ways = [[way_of(*each) for each in zip(*sides, strict=True)] for sides in zip(shown, plain, strict=True)]
    assert ways[0] == ways[1]
    assert set(ways[0]) == set(range(8))


def test_so_many_pairs_are_changed_as_asked_for() -> None:
    real, fake = images(), images(seed=1)
    plain = pair(real, fake, augment=None)[0][:, 3:9]
    assert torch.equal(pair(real, fake, augment=0.0)[0][:, 3:9], plain)
    changed = [(pair(real, fake, augment=share)[0][:, 3:9] != plain).any(dim=(1, 2, 3)).sum() for share in (0.3, 1.0)]
    assert 0.1 * COUNT < changed[0] < 0.5 * COUNT < 0.75 * COUNT < changed[1] < COUNT, "one in eight lies as before"


def test_pictures_that_are_not_square_keep_their_size() -> None:
    real, fake = images(6, 10), images(6, 10, seed=1)
    for plain, shown in zip(pair(real, fake, augment=None), pair(real, fake, augment=1.0), strict=True):
        assert shown.shape == plain.shape
        torch.testing.assert_close(shown[:, 3:9].sum(dim=(2, 3)), plain[:, 3:9].sum(dim=(2, 3)))


@pytest.mark.parametrize("augment", [None, 0.5, 1.0])
def test_a_fake_has_its_gradient(augment: float | None) -> None:
    real, fake = images(), images(seed=1)
    painted = fake.image.clone().requires_grad_(True)
    _, shown = pair(real, replace(fake, image=painted), augment)
    shown[:, :3].sum().backward()
    assert painted.grad is not None
    assert (painted.grad > 0).all()
