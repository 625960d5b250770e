"""A picture, its gradient and its transport, all from the very same paths.

Not by Mitsuba's `prb` integrator, which agrees with this one (tests/backends/mitsuba/test_prb.py) and was tried here.
It replays paths by dividing through what their vertices reflect, so that black texels get no gradient of what they
would pass on; and it calls every BSDF, shape and emitter that is alive in the process, the caller's and ours, so that
kernels are compiled anew as scenes come and go. Vertices are kept instead, which takes memory for each bounce.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.types import TransportSamples
from svbrdfgan_mitsuba.film import Run
from svbrdfgan_mitsuba.gradient_accumulation import Sums, leaf
from svbrdfgan_mitsuba.interop import tensor
from svbrdfgan_mitsuba.jit import dr
from svbrdfgan_mitsuba.textures import Taps
from svbrdfgan_mitsuba.vertex import Hits, Samples, Tracer, Values, Vertex


@dataclass(frozen=True, eq=False)
class Direct:
    """The samples of a run where pictures are linear in the base colour: direct light, and no gloss.

    Attributes:
        found: whether a sample met the surface.
        part, uv: where.
        weight: the radiance that a white surface sends.
    """

    found: Any
    part: Any
    uv: Any
    weight: Any


@dataclass(frozen=True, eq=False)
class Paths:
    """A view of a surface, under light that meets it up to `bounces` times."""

    tracer: Tracer
    bounces: int

    @property
    def linear(self) -> bool:
        """Whether pictures are linear in the base colour."""
        return self.bounces == 1 and self.tracer.maps.rough is None

    def direct(self, run: Run) -> Direct:
        """The samples of the run, 25 bytes each, where the picture is linear."""
        mi, samples = self.tracer.mi, Samples.of(self.tracer.mi, run)
        vertex = self._meet(self.tracer.start(samples), samples, 1)
        white = replace(vertex.values, base_color=mi.Color3f(1.0))
        direct = Direct(vertex.found, vertex.part, vertex.uv, self.tracer.shade(vertex, white)[0])
        dr.eval(direct.found, direct.part, direct.uv, direct.weight)
        return direct

    def develop_direct(self, run: Run, direct: Direct) -> tuple[Float[Tensor, "pixels 3"], Float[Tensor, " pixels"]]:
        """What `develop` gives, of samples that are there."""
        mi, color = self.tracer.mi, self.tracer.maps.color
        radiance = direct.weight * self._texels(direct).read(mi.Color3f, color.texels)
        return run.mean(mi, radiance).view(-1, 3), run.mean(mi, mi.Float(direct.found))

    def backpropagate_direct(self, run: Run, direct: Direct, grad_image: Float[Tensor, "pixels 3"], sums: Sums) -> None:
        """Likewise what `backpropagate` adds for the base colour."""
        grad = direct.weight * run.spread(self.tracer.mi, grad_image)
        self._texels(direct).add(sums.base_color, list(grad))
        dr.eval(sums.base_color)
        dr.sync_thread()

    def develop(self, run: Run) -> tuple[Float[Tensor, "pixels 3"], Float[Tensor, " pixels"]]:
        """The mean radiance of each pixel of the run, and its coverage."""
        mi = self.tracer.mi
        samples = Samples.of(mi, run)
        hits = self.tracer.start(samples)
        seen = hits.found
        radiance, share = mi.Color3f(0.0), mi.Color3f(1.0)
        for depth in range(1, self.bounces + 1):
            vertex = self._meet(hits, samples, depth)
            gathered, onward = self.tracer.shade(vertex, vertex.values)
            radiance, share = radiance + share * gathered, share * onward
            if vertex.hits:
                hits = vertex.hits
                dr.eval(radiance, share, hits, seen)
        dr.eval(radiance, seen)
        return run.mean(mi, radiance).view(-1, 3), run.mean(mi, mi.Float(seen))

    def backpropagate(self, run: Run, grad_image: Float[Tensor, "pixels 3"], sums: Sums) -> None:
        """Add the gradient of sum(image * grad_image) over the run's pixels.

        The paths are walked to their ends once, noting what each vertex sends on, and then back, each vertex shaded
        anew.
        """
        samples = Samples.of(self.tracer.mi, run)
        walked = self._walk(samples, run.spread(self.tracer.mi, grad_image))
        arriving = self.tracer.mi.Color3f(0.0)
        for depth in range(self.bounces, 0, -1):
            hits, grad = walked[depth - 1]
            vertex = self._meet(hits, samples, depth)
            with dr.isolate_grad(), dr.resume_grad():
                leaves = _leaves(vertex.values, sums)
                gathered, onward = self.tracer.shade(vertex, leaves)
                leaving = gathered + onward * arriving
                if dr.grad_enabled(leaving):
                    dr.set_grad(leaving, grad)
                    dr.enqueue(dr.ADMode.Backward, leaving)
                    dr.traverse(dr.ADMode.Backward)
                arriving = dr.detach(leaving)
                if depth > 1:
                    dr.schedule(arriving)
                _add(sums, vertex, leaves)
        dr.sync_thread()

    def record(self, run: Run) -> TransportSamples:
        """The camera samples of the run that met the surface, under direct light."""
        direct = self.direct(run)
        index = tensor(direct.found).nonzero().squeeze(1)
        return TransportSamples(
            pixel=index // run.spp + run.first,
            part=tensor(self.tracer.mi.Int32(direct.part))[index].long(),
            uv=torch.stack([tensor(channel)[index] for channel in direct.uv], dim=1),
            weight=torch.stack([tensor(channel)[index] for channel in direct.weight], dim=1) / run.spp,
        )

    def _walk(self, samples: Samples, grad: Any) -> list[tuple[Hits, Any]]:
        """For each depth the hits there, and the gradient of what leaves them towards the camera."""
        walked = [(self.tracer.start(samples), grad)]
        for depth in range(1, self.bounces):
            hits, grad = walked[-1]
            vertex = self._meet(hits, samples, depth)
            onward = self.tracer.shade(vertex, vertex.values)[1]
            assert vertex.hits is not None
            walked.append((vertex.hits, grad * onward))
            dr.eval(walked[-1])
        return walked

    def _texels(self, direct: Direct) -> Taps:
        return self.tracer.maps.color.taps(self.tracer.mi, direct.part, direct.uv, direct.found)[0]

    def _meet(self, hits: Hits, samples: Samples, depth: int) -> Vertex:
        return self.tracer.meet(hits, samples, depth, last=depth == self.bounces)


def _leaves(values: Values, sums: Sums) -> Values:
    """The values, those differentiated as leaves of a new graph."""
    light = sums.environment is not None
    return Values(
        leaf(values.base_color, sums.base_color is not None),
        leaf(values.roughness, sums.roughness is not None),
        (leaf(values.radiance[0], light), leaf(values.radiance[1], light)),
    )


def _add(sums: Sums, vertex: Vertex, leaves: Values) -> None:
    """What the gradients at the leaves amount to at the texels."""
    if sums.base_color is not None:
        vertex.color.add(sums.base_color, list(dr.grad(leaves.base_color)))
    if sums.roughness is not None and vertex.rough:
        vertex.rough.add(sums.roughness, [dr.grad(leaves.roughness)])
    if sums.environment is not None:
        for taps, radiance in zip(vertex.lights, leaves.radiance, strict=True):
            taps.add(sums.environment, list(dr.grad(radiance)))
    dr.eval(sums.base_color, sums.roughness, sums.environment)
