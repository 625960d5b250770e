"""Stored light of `warp`: which hits are kept, what they weigh and take, and when their light is drawn."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from svbrdfgan_warp import WarpRenderer
from svbrdfgan_warp.deferred_kernels import REDRAWS
from svbrdfgan_warp.prepared_scene import film_chunks
from svbrdfgan_warp.stored_light import _kept

from svbrdfgan.testing import scenes
from svbrdfgan.testing.renderer import stored_light
from svbrdfgan.testing.renderer.stored_light import StoredCase
from svbrdfgan.types import Environment

MAPS = ("base_color", "roughness", "metallic", "normal")


@pytest.fixture
def stored(renderer: WarpRenderer) -> StoredCase:
    return StoredCase(renderer, stored_light.strips(MAPS), (0, 1))


def kept(hit: list[bool], most: int, pixels: int) -> Any:
    """What is kept of pixels whose camera samples hit alike; barycentrics hold the number of the sample."""
    view = scenes.front_view(scenes.constant_light(), width=pixels, height=1)
    (chunk,) = film_chunks(view, len(hit), 0, 2**20)
    face = torch.tensor(hit).int().repeat(pixels) - 1
    at = torch.arange(len(hit)).repeat(pixels).unsqueeze(-1).float().expand(-1, 2)
    return _kept(chunk, face, at, torch.ones_like(face, dtype=torch.bool), most, torch.Generator().manual_seed(0))


@pytest.mark.parametrize("most", [1, 3, 5])
def test_each_hit_is_kept_with_equal_probability(most: int) -> None:
    hit, pixels = [True, False, True, True, True, False, True, True], 30_000
    found = kept(hit, most, pixels)
    counts = torch.bincount(found.at[:, 0].int(), minlength=len(hit)).double()
    chance = most / sum(hit)
    wanted = pixels * chance * torch.tensor(hit).double()
    error = (pixels * chance * (1.0 - chance)) ** 0.5
    assert float((counts - wanted).abs().max()) < 5.0 * error
    assert torch.equal(found.start.diff(), torch.full((pixels,), most, dtype=torch.int32))
    assert torch.equal(found.pixel, torch.arange(pixels).repeat_interleave(most).int())


@pytest.mark.parametrize(("hit", "most", "weight"), [(6, 4, 6 / 32), (3, 4, 1 / 8), (8, 8, 1 / 8), (0, 4, 0.0)])
def test_kept_hits_weigh_the_share_of_all_that_were_found(hit: int, most: int, weight: float) -> None:
    found = kept([n < hit for n in range(8)], most, 5)
    assert len(found) == 5 * min(hit, most)
    torch.testing.assert_close(found.weight, torch.full((5,), weight))


def test_kept_hits_are_spread_over_their_pixel(renderer: WarpRenderer) -> None:
    """Of 16 camera samples that hit a plane, four kept ones lie in three quarters of the pixel's width or more."""
    stored = StoredCase(renderer, stored_light.uniform(scenes.constant_light()), (0,))
    light: Any = stored.store(hits=4, spp=16, seed=0)
    frame = stored.rendered.prepared.geometry
    corners = torch.from_numpy(frame.corners.numpy()).view(-1, 3)[light.hits.face.cpu().long()].long()
    u = torch.from_numpy(frame.uv.numpy())[..., 0][corners]
    at = torch.cat([light.hits.at, 1.0 - light.hits.at.sum(dim=1, keepdim=True)], dim=1).cpu()
    columns = (u * at).sum(dim=1).view(16, 16, 4)
    extent = (columns.amax(dim=-1) - columns.amin(dim=-1)).mean()
    pixel = (columns.max() - columns.min()) / 16
    assert extent > 0.5 * pixel


def test_light_takes_twenty_bytes_a_hit(stored: StoredCase) -> None:
    light: Any = stored.store(hits=3, spp=16, seed=0)
    pixels, hits = 4 * 4, len(light.hits)
    assert hits == 3 * 12  # two of three strips: three of four columns
    assert light.nbytes == 20 * hits + 4 * (pixels + 1) + 4 * pixels + 4 * 3


def test_every_light_sample_is_drawn_anew_in_some_visits(renderer: WarpRenderer) -> None:
    """At each visit those of one group of pixels, and after `REDRAWS` visits all."""
    light_of = scenes.random_light(64, 128)
    stored = StoredCase(renderer, stored_light.uniform(light_of), (0,))
    light: Any = stored.store(hits=7, spp=8, seed=0)
    stored.shade(light, visit=0)
    first, fresh = light.light.clone(), torch.zeros(len(light.hits), dtype=torch.bool, device=light.light.device)
    for visit in range(1, REDRAWS + 1):
        before = light.light.clone()
        stored.shade(light, visit=visit)
        drawn = light.hits.pixel % REDRAWS == visit % REDRAWS
        changed = light.light != before
        assert not (changed & ~drawn).any()
        assert changed[drawn].float().mean() > 0.7  # the others were in shadow before, and are again
        fresh |= drawn
    assert fresh.all()
    assert (light.light != first).float().mean() > 0.7


@pytest.mark.parametrize(("visit", "sun"), [(0, 0.0), (5, 0.0), (5, 100.0)])
def test_stored_pictures_are_as_noisy_as_rendered_ones(renderer: WarpRenderer, visit: int, sun: float) -> None:
    """Otherwise a discriminator tells fakes from exemplars by their noise, and no layer changes that."""
    case = stored_light.sheet(MAPS)
    case = replace(case, view=replace(case.view, environment=_smooth_light(sun)))
    stored, spp, seeds = StoredCase(renderer, case, (0,)), 16, range(48)
    rendered = np.stack([stored.rendered.image(case, spp=spp, seed=seed) for seed in seeds])
    shaded = torch.stack(
        [stored.shade(stored.store(hits=spp, spp=spp, seed=seed), visit=visit, seed=seed)[0][0] for seed in seeds]
    )
    assert shaded.var(dim=0).mean().item() == pytest.approx(rendered.var(axis=0, ddof=1).mean(), rel=0.15)


def _smooth_light(sun: float, rows: int = 64, cols: int = 128) -> Environment:
    """Light from one side with neither edges nor broad pixels: what noise it has depends on how samples spread.

    Args:
        sun: radiance of one pixel more, in the midst of the light.
    """
    polar = torch.linspace(0.0, math.pi, rows).unsqueeze(1)
    around = torch.linspace(0.0, 2.0 * math.pi, cols)
    lobe = torch.exp(3.0 * (polar.sin() * around.cos() - 1.0))
    radiance = 0.2 + 4.0 * lobe
    radiance[rows // 2, 0] += sun
    return Environment(radiance.unsqueeze(-1).repeat(1, 1, 3))


def test_light_is_drawn_for_views_that_need_it(stored: StoredCase) -> None:
    """A batch of views that were last looked at on different visits."""
    lights: list[Any] = [stored.store(hits=4, spp=8, seed=seed) for seed in (0, 1)]
    stored.shade(lights[0], visit=5)
    found, _ = stored.shade(*lights, visit=6, seed=9)
    anew, _ = stored.shade(*(stored.store(hits=4, spp=8, seed=seed) for seed in (0, 1)), visit=6, seed=9)
    assert torch.equal(found, anew)
    assert [light.visit for light in lights] == [6, 6]


def test_light_stored_without_learnable_parts_is_black(stored: StoredCase) -> None:
    nothing: Any = replace(stored, learnable=(2,)).renderer
    light = nothing.store_light(stored.rendered.prepared, stored.case.view, learnable=(), hits=4, spp=4, seed=0)
    images, pullback = nothing.shade([light], stored.textures[:0], maps=MAPS, visit=0, seed=0)
    assert not images.any()
    assert pullback(images).shape == (0, *stored.textures.shape[1:])
