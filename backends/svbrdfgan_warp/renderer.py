"""The renderer: direct light, its gradients with respect to all maps and the environment, and its transport."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.protocols import Pullback, RendererCapabilities
from svbrdfgan.types import CHANNELS, Gradients, Material, Materials, Rendering, Surface, TransportSamples, View
from svbrdfgan_warp import light_records, prepared_scene
from svbrdfgan_warp.deferred_shading import ShadingPass
from svbrdfgan_warp.device import choose_device, in_order
from svbrdfgan_warp.environment import EmitterCache
from svbrdfgan_warp.frame import TangentSpace
from svbrdfgan_warp.light_records import LightTracer
from svbrdfgan_warp.material_pass import MaterialPass
from svbrdfgan_warp.materials import linear_in_base_color
from svbrdfgan_warp.prepared_scene import PreparedSurface, Tracer, film_chunks, prepare, prepare_camera
from svbrdfgan_warp.render_pass import RenderPass
from svbrdfgan_warp.shapes import ShapeCache
from svbrdfgan_warp.stored_light import StoredLight, store_light

CAPABILITIES = RendererCapabilities(
    maps=frozenset(CHANNELS),
    differentiable=frozenset({*CHANNELS, "environment"}),
    transport=True,
    pullback=True,
    deferred=True,
    alpha=True,
)


@dataclass(frozen=True, init=False)
class WarpRenderer:
    """Direct light from the environment by multiple importance sampling, on CUDA or on all of torch's CPU threads.

    Pictures of surfaces whose parts are all Lambertian, smooth and opaque are products with their base colours, and
    have kernels of their own, which are faster than those of whole materials.

    Pictures depend only on the seed, not on the number of threads; on the CPU, so do gradients. On CUDA, atomics sum
    the gradients in varying order, so their last bits may differ between runs.
    """

    device: torch.device
    _emitters: EmitterCache = field(compare=False, repr=False)
    _shapes: ShapeCache = field(compare=False, repr=False)

    def __init__(self, device: str = "auto") -> None:
        """A renderer on `device`: "auto" (CUDA where there is one), "cpu", "cuda" or "cuda:N".

        Raises:
            ConfigError: another name, or a device that does not exist.
        """
        object.__setattr__(self, "device", choose_device(device))
        object.__setattr__(self, "_emitters", EmitterCache(self.device))
        object.__setattr__(self, "_shapes", ShapeCache(self.device))

    def __reduce__(self) -> tuple[type[WarpRenderer], tuple[str]]:
        return WarpRenderer, (str(self.device),)

    @property
    def capabilities(self) -> RendererCapabilities:
        return CAPABILITIES

    def prepare(self, surface: Surface) -> PreparedSurface:
        """The surface and its BVH, which it shares with prepared surfaces that differ in UVs or parts alone.

        The first call in a process loads or compiles the kernels.
        """
        return prepare(surface, self.device, self._shapes)

    def render(self, prepared: PreparedSurface, materials: Materials, view: View, *, spp: int, seed: int) -> Rendering:
        """The picture; unbiased. Beyond the picture and the inputs, memory holds only a few chunks of the film."""
        return self._render_pass(prepared, materials, view, frozenset(), spp, seed).forward()

    def render_vjp(
        self,
        prepared: PreparedSurface,
        materials: Materials,
        view: View,
        grad_image: Float[Tensor, "height width 3"],
        *,
        wrt: frozenset[str],
        spp: int,
        seed: int,
    ) -> Gradients:
        """The gradient of sum(image * grad_image), on the same samples as `render`.

        For all but the base colours it treats the drawn directions and their densities as constants.
        """
        return self._render_pass(prepared, materials, view, wrt, spp, seed).backward(grad_image, wrt)

    def render_pullback(
        self, prepared: PreparedSurface, materials: Materials, view: View, *, wrt: frozenset[str], spp: int, seed: int
    ) -> tuple[Rendering, Pullback]:
        """The picture, and `render_vjp` from its records.

        Those take 36 bytes a sample; where all parts are Lambertian, smooth and opaque 24, or 48 for light's gradient.
        At most `svbrdfgan_warp.render_pass.KEPT` samples are kept; the others are traced again.
        """
        render_pass = self._render_pass(prepared, materials, view, wrt, spp, seed)
        return render_pass.forward(keep=bool(wrt)), partial(render_pass.backward, wrt=wrt)

    def transport(self, prepared: PreparedSurface, view: View, *, spp: int, seed: int) -> Iterator[TransportSamples]:
        """The samples that `render` draws, without materials, sorted by pixel."""
        if prepared.alpha is not None:
            return self._transport_through(prepared, view, spp, seed)
        tracer = self._tracer(prepared, view)
        chunks = film_chunks(view, spp, seed, prepared_scene.CHUNK[self.device.type])
        return in_order(lambda chunk: tracer(chunk).transport(), chunks, self.device)

    def store_light(
        self, prepared: PreparedSurface, view: View, *, learnable: Sequence[int], hits: int, spp: int, seed: int
    ) -> StoredLight:
        """Camera samples on learnable parts, with room for a light sample each: 20 bytes for both."""
        emitter = self._emitters.emitter(view.environment)
        return store_light(prepared, emitter, view, learnable=learnable, hits=hits, spp=spp, seed=seed)

    def shade(
        self,
        lights: Sequence[StoredLight],
        textures: Float[Tensor, "textures rows cols channels"],
        *,
        maps: Sequence[str],
        visit: int,
        seed: int,
    ) -> tuple[Float[Tensor, "views height width 3"], Callable[[Tensor], Tensor]]:
        """Pictures from the samples that `render` would draw: one stored by light, one ray drawn by the material."""
        values = torch.empty(textures.shape, dtype=torch.float32, device=self.device).copy_(textures.detach())
        shading = ShadingPass(tuple(lights), values, tuple(maps), visit, seed)
        return shading.forward(), shading.backward

    def _transport_through(
        self, prepared: PreparedSurface, view: View, spp: int, seed: int
    ) -> Iterator[TransportSamples]:
        """The transport of a surface with alpha: that of the light samples of Lambertian parts."""
        white = Materials((Material.lambertian((1.0, 1.0, 1.0)),) * len(prepared.surface.parts))
        render_pass = self._material_pass(prepared, white, view, spp, seed, dark=False)
        tracer, maps = render_pass.tracer, render_pass.maps.argument
        return in_order(lambda chunk: tracer.lambertian(chunk, maps).transport(), render_pass.chunks(), self.device)

    def _render_pass(
        self, prepared: PreparedSurface, materials: Materials, view: View, wrt: frozenset[str], spp: int, seed: int
    ) -> RenderPass | MaterialPass:
        light = "environment" in wrt
        if prepared.alpha is None and linear_in_base_color(materials):
            chunks = partial(film_chunks, view, spp, seed, prepared_scene.CHUNK[self.device.type])
            return RenderPass.of(self._tracer(prepared, view, light_samples=light), view, chunks, materials)
        return self._material_pass(prepared, materials, view, spp, seed, dark=light)

    def _tracer(self, prepared: PreparedSurface, view: View, *, light_samples: bool = False) -> Tracer:
        camera, emitter = prepare_camera(view, prepared.centre), self._emitters.emitter(view.environment)
        return Tracer(prepared, camera, emitter, light_samples)

    def _material_pass(
        self, prepared: PreparedSurface, materials: Materials, view: View, spp: int, seed: int, *, dark: bool
    ) -> MaterialPass:
        camera, emitter = prepare_camera(view, prepared.centre), self._emitters.emitter(view.environment)
        tilted = any("normal" in material.maps for material in materials.parts)
        space = prepared.tangent_space if tilted else TangentSpace()
        tracer = LightTracer(prepared, space, camera, emitter, dark)
        chunks = partial(film_chunks, view, spp, seed, light_records.CHUNK[self.device.type])
        return MaterialPass.of(tracer, view, chunks, materials)
