"""What recipes go by stays affordable, whatever the mesh."""

import numpy as np
import pytest

from svbrdfgan.asset import surroundings
from svbrdfgan.asset.surroundings import Surroundings
from svbrdfgan.types import Mesh, Part


def test_faces_that_lie_on_each_other_by_thousands_are_divided_coarsely(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(surroundings, "_MOST_NODES", 5_000)
    corners = np.array([[0.0, 0, 0], [0, 0, 4], [4, 0, 0]])

    def found(count: int) -> Surroundings:
        faces = np.tile([[0, 1, 2]], (count, 1))
        return Surroundings.of(Mesh(corners, faces, np.zeros(count, np.int64), (Part("paint"),)))

    one, many = found(1), found(40)
    assert len(one.node) > 1000
    assert len(many.node) < 10_000
    assert (many.divisions >= 1).all()
