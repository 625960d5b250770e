"""The path tracer behind the renderer protocol."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from svbrdfgan.errors import ConfigError
from svbrdfgan.protocols import RendererCapabilities
from svbrdfgan.types import Gradients, Material, Materials, Rendering, Surface, TransportSamples, View
from svbrdfgan_numpy.environment import pixels_of, prepare_emitter
from svbrdfgan_numpy.integrator import PathTracer
from svbrdfgan_numpy.materials import MAPS
from svbrdfgan_numpy.shading import Bounce, radiance, radiance_vjp, shade, shade_vjp
from svbrdfgan_numpy.surface import PreparedSurface, prepare
from svbrdfgan_numpy.textures import Taps, Texture


@dataclass(frozen=True)
class NumpyRenderer:
    """A path tracer in NumPy, in float64: slow, exact, and written to be read.

    Args:
        max_bounces: scattering events on a path, 1 to 64. Only 1, direct light, has `transport`.
        chunk_vertices: path vertices held in memory at a time; the picture does not depend on it.

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
            maps=frozenset(MAPS),
            differentiable=frozenset({*MAPS, "environment"}),
            max_bounces=self.max_bounces,
            transport=self.max_bounces == 1,
            stochastic=True,
            alpha=True,
        )

    @property
    def device(self) -> torch.device:
        return torch.device("cpu")

    def prepare(self, surface: Surface) -> PreparedSurface:
        """The surface with its search tree."""
        return prepare(surface)

    def render(self, prepared: PreparedSurface, materials: Materials, view: View, *, spp: int, seed: int) -> Rendering:
        """The picture; see `Renderer.render`."""
        maps, environment = _textures(materials, prepared.surface), pixels_of(view.environment)
        image, coverage = np.zeros((view.height * view.width, 3)), np.zeros(view.height * view.width)
        for pixels, bounces in self._trace(_tracer(prepared, view, maps), spp, seed):
            shadings = [shade(bounce, maps, environment) for bounce in bounces]
            image[pixels] = radiance(len(pixels) * spp, bounces, shadings).reshape(-1, spp, 3).mean(axis=1)
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
        """The gradient; see `Renderer.render_vjp`. All but the base colour's treat drawn directions as constants."""
        maps, environment = _textures(materials, prepared.surface), pixels_of(view.environment)
        grad_pixels = grad_image.detach().cpu().double().numpy().reshape(-1, 3) / spp
        grad_maps = {name: np.zeros_like(texture.texels) for name, texture in maps.items() if name in wrt}
        grad_environment = np.zeros_like(environment)
        for pixels, bounces in self._trace(_tracer(prepared, view, maps), spp, seed):
            shadings = [shade(bounce, maps, environment) for bounce in bounces]
            grads = radiance_vjp(bounces, shadings, np.repeat(grad_pixels[pixels], spp, axis=0))
            for bounce, shading, grad_reflected, grad_lights in zip(bounces, shadings, *grads, strict=True):
                _add_to_maps(grad_maps, shade_vjp(bounce, shading, maps, grad_reflected))
                if "environment" in wrt:
                    _add_to_environment(grad_environment, bounce, grad_lights)
        split = {name: maps[name].split(grad) for name, grad in grad_maps.items()}
        parts = [{n: split[n][i] for n in split if n in material.maps} for i, material in enumerate(materials.parts)]
        light = _tensor(grad_environment.reshape(view.environment.radiance.shape))
        return Gradients(tuple(parts), light if "environment" in wrt else None)

    def transport(self, prepared: PreparedSurface, view: View, *, spp: int, seed: int) -> Iterator[TransportSamples]:
        """The samples of `render`'s picture without materials; see `TransportRenderer.transport`."""
        white = Materials((Material.lambertian((1.0, 1.0, 1.0)),) * len(prepared.surface.parts))
        maps, environment = _textures(white, prepared.surface), pixels_of(view.environment)
        return _samples(self._trace(_tracer(prepared, view, maps), spp, seed), maps, environment, spp)

    def _trace(self, tracer: PathTracer, spp: int, seed: int) -> Iterator[tuple[Int[ndarray, " pixels"], list[Bounce]]]:
        """All the paths of a picture, one chunk of pixels at a time."""
        step = max(1, self.chunk_vertices // (spp * self.max_bounces))
        return _chunks(tracer, step, spp, seed, self.max_bounces)


def _tracer(prepared: PreparedSurface, view: View, maps: Mapping[str, Texture]) -> PathTracer:
    return PathTracer(prepared, prepare_emitter(view.environment), view, maps)


def _textures(materials: Materials, surface: Surface) -> dict[str, Texture]:
    return {name: Texture.of(materials, name, surface.repeat) for name in MAPS}


def _chunks(
    tracer: PathTracer, step: int, spp: int, seed: int, max_bounces: int
) -> Iterator[tuple[Int[ndarray, " pixels"], list[Bounce]]]:
    count = tracer.view.width * tracer.view.height
    for start in range(0, count, step):
        stop = min(start + step, count)
        bounces = tracer.trace(range(start * spp, stop * spp), spp=spp, seed=seed, max_bounces=max_bounces)
        yield np.arange(start, stop), list(bounces)


def _add_to_maps(
    grad_maps: Mapping[str, Float[ndarray, "texels channels"]],
    lookups: Iterable[tuple[str, Taps, Float[ndarray, "vertices channels"]]],
) -> None:
    for name, taps, grad in lookups:
        if name in grad_maps:
            grad_maps[name][...] += taps.transpose(grad, len(grad_maps[name]))


def _add_to_environment(
    grad_environment: Float[ndarray, "pixels 3"], bounce: Bounce, grad_lights: Sequence[Float[ndarray, "_ 3"]]
) -> None:
    for arrival, grad in zip(bounce.arrivals, grad_lights, strict=True):
        grad_environment += arrival.light.transpose(grad, len(grad_environment))


def _samples(
    chunks: Iterator[tuple[Int[ndarray, " pixels"], list[Bounce]]],
    maps: Mapping[str, Texture],
    environment: Float[ndarray, "texels 3"],
    spp: int,
) -> Iterator[TransportSamples]:
    for pixels, (bounce,) in chunks:
        light = radiance(len(pixels) * spp, [bounce], [shade(bounce, maps, environment)])
        points = bounce.vertices.points
        yield TransportSamples(
            pixel=torch.from_numpy(pixels[bounce.path // spp]),
            part=torch.from_numpy(points.part),
            uv=_tensor(points.uv),
            weight=_tensor(light[bounce.path] / spp),
        )


def _tensor(array: Float[ndarray, "*shape"]) -> Float[Tensor, "*shape"]:
    return torch.from_numpy(array).float()
