"""Agreement with the reference path tracer, over many seeds."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from svbrdfgan_mitsuba import MitsubaRenderer

from svbrdfgan.protocols import Renderer
from svbrdfgan.testing import scenes
from svbrdfgan.types import Camera, Material, Materials, Surface, View

SEEDS = 24


def random_map(rows: int, cols: int, low: float, high: float, seed: int = 0) -> torch.Tensor:
    return low + (high - low) * torch.rand((rows, cols, 1), generator=torch.Generator().manual_seed(seed))


def random_normals(rows: int, cols: int, seed: int = 0) -> torch.Tensor:
    """Steep enough for some to be bent."""
    tilt = 1.2 * torch.rand((rows, cols, 2), generator=torch.Generator().manual_seed(seed)) - 0.6
    return torch.cat([tilt, torch.full((rows, cols, 1), 0.8)], dim=-1)


def some_transparent(surface: Surface) -> Surface:
    """The surface with a constant and a textured alpha."""
    alphas = (1.0, np.linspace(0.2, 1.0, 6).reshape(2, 3), 0.6)
    parts = zip(surface.parts, alphas, strict=True)
    return replace(surface, parts=tuple(replace(part, alpha=alpha) for part, alpha in parts))


WHOLE = Materials(
    (
        Material(
            {
                "base_color": scenes.random_texture(3, 4),
                "roughness": random_map(4, 2, 0.3, 0.7),
                "metallic": random_map(2, 3, 0.0, 1.0, seed=1),
                "normal": random_normals(3, 3),
            }
        ),
        Material({"base_color": scenes.random_texture(2, 2, seed=1), "normal": random_normals(2, 4, seed=1)}),
        Material(
            {
                "base_color": scenes.random_texture(2, 3, seed=2),
                "roughness": torch.tensor([0.5]),
                "metallic": torch.tensor([0.9]),
            }
        ),
    )
)

SCENES = {
    "shadow": (
        scenes.occluder(),
        scenes.lambertian(scenes.random_texture(5, 7), scenes.GREEN),
        View(Camera((1.5, 1.2, 3.0)), scenes.random_light(rotation=0.7), 12, 9),
    ),
    "sphere": (
        scenes.sphere(),
        scenes.lambertian(scenes.random_texture(8, 4)),
        scenes.front_view(scenes.random_light(5, 9), width=8, height=8),
    ),
    "corner": (
        scenes.corner_box(),
        scenes.lambertian(scenes.RED, scenes.GREEN, (1.0, 1.0, 1.0)),
        scenes.corner_view(scenes.random_light(6, 6, seed=2, rotation=-1.0)),
    ),
    "gloss": (
        scenes.corner_box(),
        Materials(
            (
                Material({"base_color": scenes.random_texture(3, 4), "roughness": random_map(4, 2, 0.0, 1.0)}),
                Material.lambertian(scenes.RED),
                Material({"base_color": torch.zeros(3), "roughness": torch.tensor([0.3])}),
            )
        ),
        scenes.corner_view(scenes.random_light(6, 6, seed=2, rotation=-1.0)),
    ),
    "material": (scenes.corner_box(), WHOLE, scenes.corner_view(scenes.random_light(6, 12, rotation=0.3))),
    "alpha": (
        some_transparent(scenes.corner_box()),
        WHOLE,
        View(Camera((1.6, 1.4, -1.8), (0.25, 0.25, 0.25), vertical_fov=0.6), scenes.random_light(6, 12), 12, 9),
    ),
}


def pictures(
    renderer: Renderer, surface: Surface, materials: Materials, view: View, spp: int
) -> tuple[torch.Tensor, torch.Tensor]:
    """The mean over seeds, and the variance of that mean."""
    prepared = renderer.prepare(surface)
    stack = torch.stack([renderer.render(prepared, materials, view, spp=spp, seed=s).image for s in range(SEEDS)])
    return stack.double().mean(dim=0), stack.double().var(dim=0) / SEEDS


@pytest.mark.parametrize("max_bounces", [1, pytest.param(3, marks=pytest.mark.full)])
@pytest.mark.parametrize("name", SCENES)
def test_it_agrees_with_the_reference(name: str, max_bounces: int) -> None:
    reference = pytest.importorskip("svbrdfgan_numpy").NumpyRenderer(max_bounces)
    truth, truth_variance = pictures(reference, *SCENES[name], spp=16)
    seen, variance = pictures(MitsubaRenderer("cpu", max_bounces), *SCENES[name], spp=64)
    total = variance + truth_variance
    noisy = total > 1e-12
    assert noisy.float().mean() > 0.2
    difference = seen - truth
    assert abs(float(difference.sum())) < 4 * float(total.sum().sqrt())
    assert float((difference[noisy] ** 2 / total[noisy]).mean()) < 2.0
    assert torch.allclose(seen[~noisy], truth[~noisy], atol=1e-5)
