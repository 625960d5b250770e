"""The path tracer behind the renderer protocol."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from svbrdfgan.errors import ConfigError, UnsupportedError
from svbrdfgan.protocols import RendererCapabilities
from svbrdfgan.types import Gradients, Materials, Rendering, Surface, TransportSamples, View
from svbrdfgan_numpy.checks import check_gradient, check_materials
from svbrdfgan_numpy.environment import pixels_of, prepare_light
from svbrdfgan_numpy.integrator import Bounce, trace_paths
from svbrdfgan_numpy.radiance import radiance, radiance_vjp, shade
from svbrdfgan_numpy.surface import PreparedSurface, prepare
from svbrdfgan_numpy.texture import base_color


@dataclass(frozen=True)
class NumpyRenderer:
    """A path tracer in NumPy, float64 inside: slow, exact, and written to be read.

    Args:
        max_bounces: scattering events on a path, 1 to 64. 1 is direct light alone, and only then is there `transport`.
        chunk_vertices: path vertices held in memory at a time; changes nothing in the picture.

    Raises:
        ConfigError: an option is out of range.
    """

    max_bounces: int = 1
    chunk_vertices: int = 131_072

    def __post_init__(self) -> None:
        if not 1 <= self.max_bounces <= 64:
            raise ConfigError(f"numpy renderer: max_bounces is {self.max_bounces}; wanted 1 to 64.")
        if self.chunk_vertices < 1:
            raise ConfigError(f"numpy renderer: chunk_vertices is {self.chunk_vertices}; wanted at least 1.")

    @property
    def capabilities(self) -> RendererCapabilities:
        return RendererCapabilities(
            maps=frozenset({"base_color"}),
            differentiable=frozenset({"base_color", "environment"}),
            max_bounces=self.max_bounces,
            transport=self.max_bounces == 1,
            stochastic=True,
        )

    @property
    def device(self) -> torch.device:
        return torch.device("cpu")

    def prepare(self, surface: Surface) -> PreparedSurface:
        """The surface with its search tree."""
        return prepare(surface)

    def render(self, prepared: PreparedSurface, materials: Materials, view: View, *, spp: int, seed: int) -> Rendering:
        """The picture; see `Renderer.render`."""
        check_materials(prepared.surface, materials)
        texture, environment = base_color(materials, prepared.surface.repeat), pixels_of(view.environment)
        image, coverage = np.zeros((view.height * view.width, 3)), np.zeros(view.height * view.width)
        for pixels, bounces in self._trace(prepared, view, spp, seed):
            carried = radiance(len(pixels) * spp, bounces, *shade(bounces, texture, environment))
            image[pixels] = carried.reshape(-1, spp, 3).mean(axis=1)
            coverage[pixels] = np.bincount(bounces[0].path // spp, minlength=len(pixels)) / spp
        film = (view.height, view.width)
        return Rendering(_tensor(image.reshape(*film, 3)), _tensor(coverage.reshape(film)))

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
        """The gradient; see `Renderer.render_vjp`. That of the environment takes the drawn directions as given."""
        check_materials(prepared.surface, materials)
        check_gradient(view, grad_image, wrt, self.capabilities.differentiable)
        texture, environment = base_color(materials, prepared.surface.repeat), pixels_of(view.environment)
        grad_pixels = grad_image.detach().cpu().double().numpy().reshape(-1, 3) / spp
        grad_texels, grad_environment = np.zeros_like(texture.texels), np.zeros_like(environment)
        for pixels, bounces in self._trace(prepared, view, spp, seed):
            grad_paths = np.repeat(grad_pixels[pixels], spp, axis=0)
            grads = radiance_vjp(bounces, *shade(bounces, texture, environment), grad_paths)
            for bounce, grad_albedo, grad_light in zip(bounces, *grads, strict=True):
                if "base_color" in wrt:
                    grad_texels += texture.taps(bounce.part, bounce.uv).transpose(grad_albedo, len(grad_texels))
                if "environment" in wrt:
                    grad_environment += bounce.light.transpose(grad_light, len(grad_environment))
        maps = [{"base_color": grad} if "base_color" in wrt else {} for grad in texture.split(grad_texels)]
        light = _tensor(grad_environment.reshape(view.environment.radiance.shape))
        return Gradients(tuple(maps), light if "environment" in wrt else None)

    def transport(self, prepared: PreparedSurface, view: View, *, spp: int, seed: int) -> Iterator[TransportSamples]:
        """The samples of `render`'s picture before materials; see `TransportRenderer.transport`.

        Raises:
            UnsupportedError: paths have more than one bounce, so that pictures are not linear in the base colour.
        """
        if self.max_bounces > 1:
            raise UnsupportedError(
                f"numpy renderer: transport is for direct light, and max_bounces is {self.max_bounces}; set it to 1."
            )
        return _samples(self._trace(prepared, view, spp, seed), pixels_of(view.environment), spp)

    def _trace(
        self, prepared: PreparedSurface, view: View, spp: int, seed: int
    ) -> Iterator[tuple[Int[ndarray, " pixels"], list[Bounce]]]:
        """All the paths of a picture, some pixels at a time."""
        if spp < 1:
            raise ConfigError(f"numpy renderer: spp is {spp}; wanted at least 1 sample in each pixel.")
        step = max(1, self.chunk_vertices // (spp * self.max_bounces))
        return _chunks(prepared, view, step, spp, seed, self.max_bounces)


def _chunks(
    prepared: PreparedSurface, view: View, step: int, spp: int, seed: int, max_bounces: int
) -> Iterator[tuple[Int[ndarray, " pixels"], list[Bounce]]]:
    light, count = prepare_light(view.environment), view.width * view.height
    for start in range(0, count, step):
        stop = min(start + step, count)
        paths = range(start * spp, stop * spp)
        bounces = trace_paths(prepared, light, view, paths, spp=spp, seed=seed, max_bounces=max_bounces)
        yield np.arange(start, stop), list(bounces)


def _samples(
    chunks: Iterator[tuple[Int[ndarray, " pixels"], list[Bounce]]], environment: Float[ndarray, "texels 3"], spp: int
) -> Iterator[TransportSamples]:
    for pixels, (bounce,) in chunks:
        yield TransportSamples(
            pixel=torch.from_numpy(pixels[bounce.path // spp]),
            part=torch.from_numpy(bounce.part),
            uv=_tensor(bounce.uv),
            weight=_tensor(bounce.light.apply(environment) / spp),
        )


def _tensor(array: Float[ndarray, "*shape"]) -> Float[Tensor, "*shape"]:
    return torch.from_numpy(array).float()
