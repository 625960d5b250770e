"""Pictures with known answers."""

import pytest
from svbrdfgan_warp import WarpRenderer

from svbrdfgan.testing import scenes
from svbrdfgan.types import Camera, View

WHITE = (1.0, 1.0, 1.0)


@pytest.mark.parametrize(("scale", "away"), [(1e-3, 0.0), (1.0, 1e4), (1e3, 0.0)])
def test_size_and_place_do_not_matter(renderer: WarpRenderer, scale: float, away: float) -> None:
    """Ray offsets scale with the scene: a sphere does not shadow itself at any size, nor far from the origin."""
    unit = scenes.sphere(1.0, 32, 64)
    moved = scenes.surface_of(unit.positions * scale + away, unit.normals, unit.uv, unit.faces)
    camera = Camera((away, away, away + 3.0 * scale), (away, away, away), vertical_fov=0.8)
    view = View(camera, scenes.constant_light(), 16, 16)
    seen = scenes.picture(renderer, moved, scenes.lambertian(WHITE), view, spp=256)
    assert scenes.surface_radiance(seen)[0] == pytest.approx(1.0, rel=0.01)
