"""Points of a mesh are found again on the surface of its embedding, whose faces are cut."""

from __future__ import annotations

import numpy as np
import pytest

from svbrdfgan.asset.points import SurfacePoints
from svbrdfgan.asset.subfaces import SubFaces
from svbrdfgan.geometry.layers import embed_and_rasterize
from svbrdfgan.plugins.registry import load_embedding
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle


@pytest.mark.parametrize("kind", ["sedan", "van"])
def test_a_point_has_the_same_place_on_the_cut_surface(kind: str) -> None:
    mesh = build_vehicle(sample_vehicle(kind, 3))
    surface = embed_and_rasterize(load_embedding("hemispherical"), mesh, 64).surface
    assert len(surface.faces) > len(mesh.faces)
    rng = np.random.default_rng(0)
    inside = SurfacePoints(rng.integers(0, len(mesh.faces), 20_000), rng.dirichlet(np.ones(3), 20_000))
    corners = np.arange(3 * len(mesh.faces))
    at_corners = SurfacePoints(corners // 3, np.eye(3)[corners % 3])
    for points in (inside, at_corners):
        found = SubFaces.of(surface, len(mesh.faces)).find(points)
        assert (surface.source_face[found.face] == points.face).all()
        there = found.interpolate(surface.positions[surface.faces])
        np.testing.assert_allclose(there, points.positions(mesh), atol=1e-6)
