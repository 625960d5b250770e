"""Prepared surfaces of one shape share its BVH and tangents, and render as if each had its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from svbrdfgan_warp import WarpRenderer

from svbrdfgan.scene.window import Window, windowed
from svbrdfgan.testing import scenes
from svbrdfgan.types import Material, Materials, Surface

_VIEW = scenes.front_view(scenes.random_light(), width=16, height=16)


def bumpy() -> Materials:
    rng = torch.Generator().manual_seed(0)
    normal = torch.cat([0.4 * torch.rand(8, 8, 2, generator=rng) - 0.2, torch.ones(8, 8, 1)], dim=-1)
    return Materials((Material({"base_color": torch.rand(8, 8, 3, generator=rng), "normal": normal}),))


def picture(renderer: WarpRenderer, surface: Surface) -> torch.Tensor:
    return renderer.render(renderer.prepare(surface), bumpy(), _VIEW, spp=2, seed=1).image


def windows() -> list[Surface]:
    return [windowed(scenes.sphere(), Window(row, 32, 64), 256) for row in (0, 64, 128)]


def test_windows_of_a_map_share_all_but_their_uvs() -> None:
    renderer = WarpRenderer("cpu")
    first, *others = [renderer.prepare(window) for window in windows()]
    for other in others:
        assert other.shape is first.shape
        assert other.tangent_space is first.tangent_space


def test_pictures_are_those_of_a_renderer_that_shares_nothing() -> None:
    renderer = WarpRenderer("cpu")
    held = [renderer.prepare(window) for window in windows()]
    for window, prepared in zip(windows(), held, strict=True):
        shared = renderer.render(prepared, bumpy(), _VIEW, spp=2, seed=1).image
        assert torch.equal(shared, picture(WarpRenderer("cpu"), window))


def test_what_differs_is_not_shared() -> None:
    """Even where arrays are the same objects, and were written into."""
    renderer, surface = WarpRenderer("cpu"), scenes.sphere()
    held = renderer.prepare(surface)
    assert renderer.prepare(replace(surface, normals=-surface.normals)).shape is not held.shape
    assert renderer.prepare(replace(surface, faces=surface.faces[::-1].copy())).shape is not held.shape
    surface.positions[:, 1] *= 2.0
    assert renderer.prepare(surface).shape is not held.shape
    assert torch.equal(picture(renderer, surface), picture(WarpRenderer("cpu"), surface))


def test_other_uvs_have_other_tangents() -> None:
    renderer, surface = WarpRenderer("cpu"), scenes.sphere()
    turned = replace(surface, uv=np.ascontiguousarray(surface.uv[:, ::-1]))
    held = renderer.prepare(surface)
    assert renderer.prepare(turned).shape is held.shape
    for one in (surface, turned, surface):
        assert torch.equal(picture(renderer, one), picture(WarpRenderer("cpu"), one))


def test_nothing_is_kept_that_no_prepared_surface_has() -> None:
    renderer = WarpRenderer("cpu")
    held = renderer.prepare(scenes.sphere())
    assert len(renderer._shapes) == 1
    del held
    assert len(renderer._shapes) == 0
