"""Errors of imported reflectance: what they do to fakes, and their files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from svbrdfgan.data.reflectance_errors import (
    ReflectanceErrors,
    errors_path,
    load_errors,
    no_errors,
    save_errors,
    with_errors,
)
from svbrdfgan.errors import AssetError

HEIGHT, WIDTH = 6, 9


def picture() -> torch.Tensor:
    return torch.rand(1, HEIGHT, WIDTH, 3, generator=torch.Generator().manual_seed(1))


def test_no_error_changes_nothing() -> None:
    assert torch.allclose(with_errors(picture(), no_errors(HEIGHT, WIDTH)[None]), picture(), atol=1e-5)


def test_gain_and_offset_act_on_each_pixel() -> None:
    errors = no_errors(HEIGHT, WIDTH)[None]
    errors[0, 2, 3, :6] = torch.tensor([2.0, 1.0, 0.5, 0.1, 0.0, -0.1])
    changed = with_errors(picture(), errors) - picture()
    there = picture()[0, 2, 3] * torch.tensor([1.0, 0.0, -0.5]) + torch.tensor([0.1, 0.0, -0.1])
    assert torch.allclose(changed[0, 2, 3], there, atol=1e-5)
    changed[0, 2, 3] = 0.0
    assert float(changed.abs().max()) < 1e-5


def test_shift_says_where_the_picture_shows_what_belongs_there() -> None:
    errors = no_errors(HEIGHT, WIDTH)[None]
    errors[..., 6], errors[..., 7] = 2.0, -1.0  # two to the right, one up
    found = with_errors(picture(), errors)
    assert torch.allclose(found[0, 1:, :-2], picture()[0, :-1, 2:], atol=1e-5)
    assert torch.allclose(found[0, 0, -1], picture()[0, 0, -1], atol=1e-5)  # the border goes on


def test_gradient_reaches_the_fake() -> None:
    fake = picture().requires_grad_()
    with_errors(fake, no_errors(HEIGHT, WIDTH)[None] * 2).sum().backward()
    assert fake.grad is not None
    assert torch.allclose(fake.grad, torch.full_like(fake, 2.0), atol=1e-4)


def test_draws_are_of_the_exemplars_asked_for() -> None:
    values = torch.arange(6.0).reshape(3, 2, 1, 1, 1).expand(3, 2, HEIGHT, WIDTH, 8)
    errors = ReflectanceErrors(values.half())
    rng = np.random.default_rng(0)
    found = torch.cat([errors.drawn([2, 0], rng, torch.device("cpu"))[:, 0, 0, 0] for _ in range(20)])
    assert set(found.tolist()) == {0.0, 1.0, 4.0, 5.0}


def test_files_come_back_and_missing_ones_are_named(tmp_path: Path) -> None:
    assert load_errors(tmp_path, "train", 2) is None
    for number in range(2):
        save_errors(
            errors_path(tmp_path, "train", number), no_errors(HEIGHT, WIDTH).expand(3, -1, -1, -1) * (number + 1)
        )
    found = load_errors(tmp_path, "train", 2)
    assert found is not None
    assert found.values.shape == (2, 3, HEIGHT, WIDTH, 8)
    assert float(found.values[1, 0, 0, 0, 0]) == 2.0
    errors_path(tmp_path, "train", 1).unlink()
    with pytest.raises(AssetError, match="errors of the train exemplars"):
        load_errors(tmp_path, "train", 2)


def test_other_shapes_are_refused() -> None:
    with pytest.raises(AssetError, match="wanted"):
        ReflectanceErrors(torch.zeros(2, 3, HEIGHT, WIDTH, 7))
