"""Times one renderer on one scene: rendered pictures, pictures of the stored transport, and gradients of both."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from svbrdfgan.bench import BenchError
from svbrdfgan.bench.meter import Meter
from svbrdfgan.bench.scene import BenchScene
from svbrdfgan.protocols import Renderer
from svbrdfgan.rendering.render_layer import RenderLayer
from svbrdfgan.rendering.transport import LightTransport, TransportBatch, build_transport
from svbrdfgan.types import View

TOLERANCE = 1e-3
"""Largest allowed difference between the transport's picture and the renderer's, relative to the brightest value."""


def measure(renderer: Renderer[Any], scene: BenchScene, spp: int, batch: int, repeats: int) -> Meter:
    """Time and memory of each step for `batch` pictures, each with its own textures.

    Preparing the surface and building a transport are done once. The memory of `stored_` steps is that of transports
    and products, without the surface and the renderer.

    Raises:
        BenchError: the transport's picture differs from the renderer's picture of the same seed.
    """
    surface, view = scene.surface(), scene.view()
    textures = [scene.textures(renderer.device) for _ in range(batch)]
    inputs = [values.requires_grad_() for each in textures for values in each.values()]
    layer, meter = RenderLayer(renderer, spp), Meter(renderer.device, repeats)
    prepared = meter.step("prepare", lambda: renderer.prepare(surface))

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
    return meter


def _both_passes(meter: Meter, prefix: str, render: Callable[[], Tensor], textures: Sequence[Tensor]) -> None:
    """Measures the pictures alone, and with the gradient of their mean square."""

    def forward() -> Tensor:
        with torch.no_grad():
            return render()

    def forward_backward() -> tuple[Tensor, ...]:
        return torch.autograd.grad(render().square().mean(), textures)

    meter.step(f"{prefix}forward", forward)
    meter.step(f"{prefix}forward_backward", forward_backward)


def _transport(renderer: Any, prepared: Any, scene: BenchScene, view: View, spp: int) -> LightTransport:
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


def _check_same(stored: Tensor, fresh: Tensor) -> None:
    error = ((stored - fresh).abs().max() / fresh.abs().max()).item()
    if not error <= TOLERANCE:
        raise BenchError(f"the stored transport's picture differs from the renderer's by {error:.1e} of the brightest.")
