"""Picture, gradient and transport of a film chunk, all from the very same paths.

Mitsuba's `prb` integrator agrees with this one (tests/backends/mitsuba/test_prb.py), but was not taken, for two
reasons. `prb` replays paths by dividing by what their vertices reflect, so black texels get no gradient from the light
that they would pass on. `prb` also calls every BSDF, shape and emitter that is alive in the process, the caller's too,
so kernels are compiled again as scenes come and go. The integrator of this module keeps the hits of every vertex
instead, which takes memory for each bounce.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.types import CHANNELS, TransportSamples
from svbrdfgan_mitsuba.interop import dr, tensor
from svbrdfgan_mitsuba.prepared_scene import CameraSamples, FilmChunk
from svbrdfgan_mitsuba.rays import Hits
from svbrdfgan_mitsuba.textures import GradientAccumulator, Taps
from svbrdfgan_mitsuba.vertex import PathTracer, Vertex, VertexValues


@dataclass(frozen=True, eq=False)
class DirectSamples:
    """The samples of a chunk whose picture is linear in the base colour: direct light, and no gloss.

    Attributes:
        found: whether a sample hit the surface.
        part, uv: where.
        weight: the radiance that a white surface would reflect.
    """

    found: Any
    part: Any
    uv: Any
    weight: Any


@dataclass(frozen=True, eq=False)
class PathIntegrator:
    """A view of a surface, lit over at most `bounces` scattering events.

    The methods named `direct` serve pictures that are linear in the base colour, where the paths need no second trace.
    """

    tracer: PathTracer
    bounces: int

    @property
    def linear(self) -> bool:
        """Whether pictures are linear in the base colour."""
        return self.bounces == 1 and "roughness" not in self.tracer.maps.atlases

    def trace_direct(self, chunk: FilmChunk) -> DirectSamples:
        """The samples of a chunk of a linear picture, 25 bytes each."""
        mi, samples = self.tracer.mi, CameraSamples.of(self.tracer.mi, chunk)
        vertex = self._vertex(self.tracer.camera_hits(samples), samples, 1)
        white = replace(vertex.values, maps={**vertex.values.maps, "base_color": mi.Color3f(1.0)})
        direct = DirectSamples(vertex.found, vertex.part, vertex.uv, self.tracer.shade(vertex, white)[0])
        dr.eval(direct.found, direct.part, direct.uv, direct.weight)
        return direct

    def forward_direct(
        self, chunk: FilmChunk, direct: DirectSamples
    ) -> tuple[Float[Tensor, "pixels 3"], Float[Tensor, " pixels"]]:
        """The picture and the coverage that `forward` returns, from traced samples."""
        mi, color = self.tracer.mi, self.tracer.maps.base_color
        radiance = direct.weight * self._color_taps(direct).read(mi.Color3f, color.texels)
        return chunk.mean(mi, radiance).view(-1, 3), chunk.mean(mi, mi.Float(direct.found))

    def backward_direct(
        self,
        chunk: FilmChunk,
        direct: DirectSamples,
        grad_image: Float[Tensor, "pixels 3"],
        accumulator: GradientAccumulator,
    ) -> None:
        """Adds what `backward` adds for the base colour, from traced samples."""
        grad = direct.weight * chunk.mean_vjp(self.tracer.mi, grad_image)
        self._color_taps(direct).scatter(accumulator.maps["base_color"], list(grad))
        dr.eval(accumulator.maps)
        dr.sync_thread()

    def forward(self, chunk: FilmChunk) -> tuple[Float[Tensor, "pixels 3"], Float[Tensor, " pixels"]]:
        """The mean radiance of each pixel of the chunk, and its coverage."""
        mi = self.tracer.mi
        samples = CameraSamples.of(mi, chunk)
        hits = self.tracer.camera_hits(samples)
        seen = hits.found
        radiance, throughput = mi.Color3f(0.0), mi.Color3f(1.0)
        for depth in range(1, self.bounces + 1):
            vertex = self._vertex(hits, samples, depth)
            gathered, onward = self.tracer.shade(vertex, vertex.values)
            radiance, throughput = radiance + throughput * gathered, throughput * onward
            if vertex.hits:
                hits = vertex.hits
                dr.eval(radiance, throughput, hits, seen)  # or all bounces would become one kernel
        dr.eval(radiance, seen)
        return chunk.mean(mi, radiance).view(-1, 3), chunk.mean(mi, mi.Float(seen))

    def backward(
        self, chunk: FilmChunk, grad_image: Float[Tensor, "pixels 3"], accumulator: GradientAccumulator
    ) -> None:
        """Adds the gradient of sum(image * grad_image) over the chunk's pixels.

        A first walk from the camera notes the hits and the gradient at each vertex. A second one from the last vertex
        back shades each vertex again, with the light that arrives there along the path.
        """
        samples = CameraSamples.of(self.tracer.mi, chunk)
        walked = self._walk(samples, chunk.mean_vjp(self.tracer.mi, grad_image))
        arriving = self.tracer.mi.Color3f(0.0)
        for depth in range(self.bounces, 0, -1):
            hits, grad = walked[depth - 1]
            vertex = self._vertex(hits, samples, depth)
            # A graph of this vertex alone, even where the caller suspends gradients or has a graph pending.
            with dr.isolate_grad(), dr.resume_grad():
                leaves = _leaves(vertex.values, accumulator)
                gathered, onward = self.tracer.shade(vertex, leaves)
                leaving = gathered + onward * arriving
                if dr.grad_enabled(leaving):
                    dr.set_grad(leaving, grad)
                    dr.enqueue(dr.ADMode.Backward, leaving)
                    dr.traverse(dr.ADMode.Backward)
                arriving = dr.detach(leaving)
                if depth > 1:
                    dr.schedule(arriving)
                _accumulate(accumulator, vertex, leaves)
        dr.sync_thread()

    def transport(self, chunk: FilmChunk) -> TransportSamples:
        """The camera samples of the chunk that hit the surface, under direct light."""
        direct = self.trace_direct(chunk)
        index = tensor(direct.found).nonzero().squeeze(1)
        return TransportSamples(
            pixel=index // chunk.spp + chunk.first,
            part=tensor(self.tracer.mi.Int32(direct.part))[index].long(),
            uv=torch.stack([tensor(channel)[index] for channel in direct.uv], dim=1),
            weight=torch.stack([tensor(channel)[index] for channel in direct.weight], dim=1) / chunk.spp,
        )

    def _walk(self, samples: CameraSamples, grad: Any) -> list[tuple[Hits, Any]]:
        """The hits at each depth, and the gradient of the light that leaves them towards the camera."""
        walked = [(self.tracer.camera_hits(samples), grad)]
        for depth in range(1, self.bounces):
            hits, grad = walked[-1]
            vertex = self._vertex(hits, samples, depth)
            onward = self.tracer.shade(vertex, vertex.values)[1]
            assert vertex.hits is not None
            walked.append((vertex.hits, grad * onward))
            dr.eval(walked[-1])
        return walked

    def _color_taps(self, direct: DirectSamples) -> Taps:
        return self.tracer.maps.base_color.taps(self.tracer.mi, direct.part, direct.uv, direct.found)[0]

    def _vertex(self, hits: Hits, samples: CameraSamples, depth: int) -> Vertex:
        return self.tracer.vertex(hits, samples, depth, last=depth == self.bounces)


def _leaves(values: VertexValues, accumulator: GradientAccumulator) -> VertexValues:
    """The values, with those that are differentiated as leaves of a new graph."""
    environment = accumulator.environment is not None
    return VertexValues(
        {name: _leaf(value, name in accumulator.maps) for name, value in values.maps.items()},
        (_leaf(values.radiance[0], environment), _leaf(values.radiance[1], environment)),
    )


def _leaf(value: Any, wanted: bool) -> Any:
    if not wanted:
        return value
    detached = dr.detach(value)
    dr.enable_grad(detached)
    return detached


def _accumulate(accumulator: GradientAccumulator, vertex: Vertex, leaves: VertexValues) -> None:
    """Adds the gradients of the leaves to the sums of the texels that they were read from."""
    for name, sums in accumulator.maps.items():
        grad = dr.grad(leaves.maps[name])
        vertex.lookups[name].taps.scatter(sums, list(grad) if CHANNELS[name] > 1 else [grad])
    if accumulator.environment is not None:
        for taps, radiance in zip(vertex.radiance_taps, leaves.radiance, strict=True):
            taps.scatter(accumulator.environment, list(dr.grad(radiance)))
    dr.eval(accumulator.maps, accumulator.environment)
