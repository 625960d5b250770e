"""One picture of whole materials, forward from light samples to pixels, and backward to maps and light."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Set
from dataclasses import dataclass, field
from typing import Any

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.types import Gradients, Materials, Rendering, View
from svbrdfgan_warp import material_kernels
from svbrdfgan_warp.device import argument, in_order, launch, quiet
from svbrdfgan_warp.light_records import LightRecords, LightTracer
from svbrdfgan_warp.materials import PackedMaps, as_array, vector_type
from svbrdfgan_warp.prepared_scene import FilmChunk
from svbrdfgan_warp.render_pass import KEPT


@dataclass(frozen=True, eq=False)
class MaterialPass:
    """The inputs of one picture with any materials, and the records kept for its gradient.

    Attributes:
        chunks: makes those of the film, which together cover it.
        maps: copied when the pass was made.
        kept: records that the backward pass need not trace again.
    """

    tracer: LightTracer
    view: View
    chunks: Callable[[], Iterator[FilmChunk]]
    maps: PackedMaps
    kept: dict[FilmChunk, LightRecords] = field(default_factory=dict)

    @classmethod
    def of(
        cls, tracer: LightTracer, view: View, chunks: Callable[[], Iterator[FilmChunk]], materials: Materials
    ) -> MaterialPass:
        """The pass that renders these materials. The first in a process loads or compiles the kernels."""
        surface = tracer.surface
        with quiet():
            wp.load_module(material_kernels, device=wp.device_from_torch(surface.device))
        return cls(tracer, view, chunks, PackedMaps.of(materials, surface.surface.repeat, surface.device))

    def forward(self, *, keep: bool = False) -> Rendering:
        """The picture. Unless `keep`, memory holds no more than the picture, the inputs and a few chunks."""
        device, height, width = self.maps.device, self.view.height, self.view.width
        image = torch.empty(height * width, 3, dtype=torch.float32, device=device)
        coverage = torch.empty(height * width, dtype=torch.float32, device=device)
        maps, results = self.maps.argument, (argument(image, wp.vec3), argument(coverage))

        def render(chunk: FilmChunk) -> LightRecords:
            records = self.tracer(chunk, maps)
            radiance = argument(torch.empty(len(chunk), 3, dtype=torch.float32, device=device), wp.vec3)
            given = (*self.tracer.scene(), maps, records.argument, radiance)
            launch(material_kernels.shade, len(chunk), given, device)
            samples, face, _ = records.hits
            launch(material_kernels.average, chunk.pixels, (samples, face, radiance, *results), device)
            return records

        room = KEPT[device.type] if keep else 0
        for records in in_order(render, self.chunks(), device):
            room -= len(records.chunk)
            if room >= 0:
                self.kept[records.chunk] = records
        return Rendering(image.view(height, width, 3), coverage.view(height, width))

    def backward(self, grad_image: Float[Tensor, "height width 3"], wrt: Set[str]) -> Gradients:
        """The gradient of sum(image * grad_image) on the same samples, drawn directions and densities constant."""
        device, radiance = self.maps.device, self.view.environment.radiance
        given = grad_image.detach().to(device, torch.float32).reshape(-1, 3).contiguous()
        sums = {name: _zeros(self.maps.texels[name].shape, device) for name in self.maps.present(wrt)}
        light = _zeros(radiance.shape, device) if "environment" in wrt else None
        for gradients in self._gradients(given, set(sums), light is not None) if sums or light is not None else ():
            gradients.add_to(sums, light, self)
        return Gradients(self.maps.gradients(sums), None if light is None else light.float())

    def _gradients(
        self, grad_image: Float[Tensor, "pixels 3"], names: Set[str], light: bool
    ) -> Iterator[RecordGradients]:
        """Yields the gradients of one chunk after the other; on the CPU, several are computed at once."""
        maps, device = self.maps.argument, self.maps.device
        pixels = argument(grad_image, wp.vec3)

        def differentiate(chunk: FilmChunk) -> RecordGradients:
            records = self.kept.get(chunk) or self.tracer(chunk, maps)
            result = RecordGradients.empty(records, self.maps, names, light)
            given = (*self.tracer.scene(), maps, records.argument, pixels, result.argument())
            launch(material_kernels.shade_vjp, len(chunk), given, device)
            return result

        yield from in_order(differentiate, self.chunks(), device)


@dataclass(frozen=True, eq=False)
class RecordGradients:
    """The gradients for what each record looks up.

    Attributes:
        maps: by name, of the maps that are wanted; undefined where a record missed.
        radiance: for the radiance of each light sample; empty if unwanted.
    """

    records: LightRecords
    maps: Mapping[str, Float[Tensor, "*records"]]
    radiance: Float[Tensor, "kept 2 3"]

    @classmethod
    def empty(cls, records: LightRecords, maps: PackedMaps, names: Set[str], light: bool) -> RecordGradients:
        new: Callable[..., Tensor] = torch.empty
        count, options = len(records.chunk), {"dtype": torch.float32, "device": maps.device}
        values = {name: new(count, *maps.texels[name].shape[1:], **options) for name in names}
        return cls(records, values, new(count if light else 0, 2, 3, **options))

    def argument(self) -> material_kernels.RecordGradients:
        """The gradients as kernels fill them."""
        result: Any = material_kernels.RecordGradients()
        for name, values in self.maps.items():
            setattr(result, name, as_array(values))
        result.radiance = wp.from_torch(self.radiance, dtype=wp.vec3)
        return result

    def add_to(self, sums: Mapping[str, Tensor], light: Tensor | None, render_pass: MaterialPass) -> None:
        """Adds the gradients to those of texels and of the environment's pixels, in float64.

        Only one thread may add: on the CPU, Warp's atomics are plain additions, and the order decides the last bits.
        """
        records, device, maps = self.records.argument, render_pass.maps.device, render_pass.maps
        count = len(self.records.chunk)
        threads = -(-count // material_kernels.RECORDS_PER_THREAD)
        for name, values in self.maps.items():
            kernel = material_kernels.scatter_colors if values.ndim == 2 else material_kernels.scatter_numbers
            geometry = render_pass.tracer.surface.geometry
            arrays = (argument(each, vector_type(each)) for each in (values, sums[name]))
            given: tuple[Any, ...] = (geometry, maps.atlases[name], records, *arrays)
            launch(kernel, threads, given, device)
        if light is not None:
            given = (records, argument(self.radiance, wp.vec3), argument(light, wp.vec3d))
            launch(material_kernels.scatter_light, count, given, device)


def _zeros(shape: torch.Size, device: torch.device) -> Float[Tensor, "*shape"]:
    return torch.zeros(shape, dtype=torch.float64, device=device)
