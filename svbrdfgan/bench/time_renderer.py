"""Times one renderer on one scene: rendered pictures, pictures from stored light, and gradients of both."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import count
from typing import Any

import torch
from torch import Tensor

from svbrdfgan.bench import BenchError
from svbrdfgan.bench.bench_scene import BenchScene
from svbrdfgan.bench.meter import Meter
from svbrdfgan.rendering.checked_renderer import CheckedLight, CheckedRenderer, PreparedSurface
from svbrdfgan.rendering.render_layer import RenderLayer
from svbrdfgan.rendering.shade_layer import shade
from svbrdfgan.rendering.transport.build import build_transport
from svbrdfgan.rendering.transport.light_transport import LightTransport
from svbrdfgan.rendering.transport.product import TransportBatch
from svbrdfgan.types import Material, Materials, View

TOLERANCE = 1e-3
"""Largest allowed difference between the transport's picture and the renderer's, relative to the brightest value."""
MEAN_TOLERANCE = 0.02
"""Largest allowed relative difference between the means of pictures of whole materials, whose samples differ."""
_COMPARED_SAMPLES = 2**19
"""Camera samples in each of those means, at least."""


def measure(renderer: CheckedRenderer, scene: BenchScene, spp: int, batch: int, repeats: int) -> Meter:
    """Time and memory of each step for `batch` pictures, each with its own textures.

    Preparing the surface and storing light are done once. The memory of `stored_` steps is that of stored light and
    its pictures, without the surface and the renderer.

    Raises:
        BenchError: the picture from stored light differs from the renderer's.
    """
    surface, view = scene.surface(), scene.view()
    textures = [scene.textures(renderer.device) for _ in range(batch)]
    inputs = [values.requires_grad_() for each in textures for values in each.values()]
    layer, meter = RenderLayer(renderer, spp), Meter(renderer.device, repeats)
    prepared = meter.step("prepare", lambda: _unused(renderer).prepare(surface))

    def fresh() -> Tensor:
        materials = [scene.materials(each) for each in textures]
        return torch.stack([layer(prepared, each, view, seed=seed).image for seed, each in enumerate(materials)])

    _both_passes(meter, "", fresh, inputs)
    if renderer.capabilities.transport and not scene.gloss.size:
        transport = meter.step("transport", lambda: _transport(renderer, prepared, scene, view, spp))
        meter.start(kept=transport.nbytes)
        stored = TransportBatch.stack([transport, *(_copy(transport) for _ in range(batch - 1))])
        texels = torch.stack([each["base_color"].detach() for each in textures]).requires_grad_()
        _check_same(stored.render(texels)[0].detach(), fresh()[0].detach())
        _both_passes(meter, "stored_", lambda: stored.render(texels), [texels])
    if renderer.capabilities.deferred and scene.gloss.size:
        lights = [
            meter.step("transport", lambda: _light(renderer, prepared, view, spp, 0)),
            *(_light(renderer, prepared, view, spp, seed) for seed in range(1, batch)),
        ]
        maps, visits = tuple(textures[0]), count()
        values = torch.stack([torch.cat([each[name].detach() for name in maps], dim=-1) for each in textures])
        values.requires_grad_()

        def deferred() -> Tensor:
            visit = next(visits)
            return shade(renderer, lights, values, maps=maps, visit=visit, seed=visit)

        black = [Material.lambertian((0.0, 0.0, 0.0))] * (len(scene.base_color) - 1)
        learnable = Materials((scene.materials(textures[0])[0], *black))
        draws = range(-(-_COMPARED_SAMPLES // (scene.width * scene.height * spp)))
        _check_mean(
            torch.stack([deferred()[0].detach().mean() for _ in draws]).mean(),
            torch.stack([layer(prepared, learnable, view, seed=seed).image.detach().mean() for seed in draws]).mean(),
        )
        _both_passes(meter, "stored_", deferred, [values])
    return meter


def _unused(renderer: CheckedRenderer) -> CheckedRenderer:
    """The same renderer as if new: one that has prepared a surface may share what it made of it."""
    return replace(renderer, plugin=copy.copy(renderer.plugin))


def _both_passes(meter: Meter, prefix: str, render: Callable[[], Tensor], textures: Sequence[Tensor]) -> None:
    """Measures the pictures alone, and with the gradient of their mean square."""

    def forward() -> Tensor:
        with torch.no_grad():
            return render()

    def forward_backward() -> tuple[Tensor, ...]:
        return torch.autograd.grad(render().square().mean(), textures)

    meter.step(f"{prefix}forward", forward)
    meter.step(f"{prefix}forward_backward", forward_backward)


def _transport(
    renderer: CheckedRenderer, prepared: PreparedSurface, scene: BenchScene, view: View, spp: int
) -> LightTransport:
    """The transport of the first rendered picture, whose seed is 0."""
    textures = scene.textures(torch.device("cpu"))
    return build_transport(
        renderer.transport(prepared, view, spp=spp, seed=0),
        materials=scene.materials(textures),
        learnable=(0,),
        gbuffer=torch.zeros(*scene.texture.shape[:2], 6),
        view=view,
        spp=spp,
        repeat=(bool(scene.repeat[0]), bool(scene.repeat[1])),
    )


def _copy(transport: LightTransport) -> LightTransport:
    """A copy in other memory, like the transport of another view, so that no cache serves two pictures of a batch."""
    changes: dict[str, Any] = {name: tensor.clone() for name, tensor in transport.tensors().items()}
    return replace(transport, **changes)


def _light(renderer: CheckedRenderer, prepared: PreparedSurface, view: View, spp: int, seed: int) -> CheckedLight:
    """The stored light of one view, with all of its samples."""
    return renderer.store_light(prepared, view, learnable=(0,), hits=spp, spp=spp, seed=seed)


def _check_mean(stored: Tensor, fresh: Tensor) -> None:
    error = (stored / fresh - 1.0).abs().item()
    if not error <= MEAN_TOLERANCE:
        raise BenchError(f"the mean of the picture from stored light differs from the renderer's by {error:.1%}.")


def _check_same(stored: Tensor, fresh: Tensor) -> None:
    error = ((stored - fresh).abs().max() / fresh.abs().max()).item()
    if not error <= TOLERANCE:
        raise BenchError(f"the stored transport's picture differs from the renderer's by {error:.1e} of the brightest.")
