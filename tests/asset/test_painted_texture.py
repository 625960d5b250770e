"""A painted texture is the same on any number of threads."""

from collections.abc import Iterator

import numpy as np
import pytest
import torch

from svbrdfgan.asset.painted_texture import ALPHA, Canvas, Model, paint_texture
from svbrdfgan.asset.painters import RecipePainter
from svbrdfgan.asset.surroundings import Surroundings
from svbrdfgan.asset.texture_bands import TILE
from svbrdfgan.types import Mesh, Part
from svbrdfgan.weathering.recipes import Rust


@pytest.fixture
def restored_threads() -> Iterator[None]:
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


def test_threads_do_not_show(restored_threads: None) -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 0.5, 1], [0, 0.5, 1]], float)
    faces = np.array([[0, 2, 1], [0, 3, 2]])
    mesh = Mesh(corners, faces, np.zeros(2, np.int64), (Part("paint", (0.5, 0.5, 0.5)),))
    around = Surroundings.of(mesh)
    canvas = Canvas(Model(mesh, around.reversed), np.arange(2), corners[faces][..., [0, 2]])
    made = []
    for threads in (1, 3):
        torch.set_num_threads(threads)
        made.append(paint_texture(canvas, RecipePainter(around, Rust(amount=1.0)), 2 * TILE + 9, TILE))
    assert made[0][..., ALPHA].std() > 0.1
    np.testing.assert_array_equal(made[0], made[1])
