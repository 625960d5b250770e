"""Deferred shading: pictures of several views from their stored light, for any maps, and gradients back to the maps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import Any

import numpy as np
import torch
import warp as wp
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan.types import CHANNELS
from svbrdfgan_warp import deferred_kernels
from svbrdfgan_warp.deferred_kernels import REDRAWS
from svbrdfgan_warp.device import in_order, launch, upload
from svbrdfgan_warp.stored_light import StoredLight


@dataclass(frozen=True, eq=False)
class ShadingPass:
    """One picture of each view of a batch, forward to pixels and backward to textures.

    On CUDA each kernel is launched once for all views. On the CPU a launch has one thread, so views have launches of
    their own.

    Attributes:
        lights: of the views.
        values: of the textures.
        maps: what the channels of the textures are, base_color first.
        visit: decides the light samples.
        seed: of the rays.
    """

    lights: tuple[StoredLight, ...]
    values: Float[Tensor, "textures rows cols channels"]
    maps: tuple[str, ...]
    visit: int
    seed: int

    @property
    def device(self) -> torch.device:
        return self.values.device

    def forward(self) -> Float[Tensor, "views height width 3"]:
        """The pictures of the learnable parts."""
        self._draw_light()
        height, width = self.lights[0].film
        images = torch.empty(len(self.lights), height * width, 3, dtype=torch.float32, device=self.device)
        pixels = wp.from_torch(images, dtype=wp.vec3)
        radiance = wp.from_torch(torch.empty(self._hits, 3, dtype=torch.float32, device=self.device), dtype=wp.vec3)
        views, places = self._views, wp.from_torch(self._places, dtype=wp.vec2i)
        seeds = wp.uint32(self.seed & 0xFFFFFFFF), wp.uint32((self.seed >> 32) & 0xFFFFFFFF)

        def shade(first: int, count: int, hits: int) -> None:
            at, maps = (views, places, first), self._textures
            launch(deferred_kernels.draw_rays, (count, hits), (*at, maps, *seeds, self._rays), self.device)
            launch(deferred_kernels.trace_rays, (count, hits), (*at, *seeds, self._rays), self.device)
            launch(deferred_kernels.shade, (count, hits), (*at, maps, self.visit, self._rays, radiance), self.device)
            launch(deferred_kernels.average, (count, height * width), (*at, radiance, pixels), self.device)

        self._for_views(shade)
        return images.view(len(self.lights), height, width, 3)

    def backward(
        self, grad_images: Float[Tensor, "views height width 3"]
    ) -> Float[Tensor, "textures rows cols channels"]:
        """The gradient of sum(images * grad_images) for the textures, on the same samples."""
        self._draw_light()
        gradient = torch.zeros_like(self.values)
        given = grad_images.detach().to(self.device, torch.float32).reshape(len(self.lights), -1, 3).contiguous()
        arrays = wp.from_torch(given, dtype=wp.vec3), wp.from_torch(gradient.view(-1))
        views, places = self._views, wp.from_torch(self._places, dtype=wp.vec2i)

        def differentiate(first: int, count: int, hits: int) -> None:
            arguments = (views, places, first, self._textures, self.visit, self._rays, *arrays)
            launch(deferred_kernels.shade_vjp, (count, hits), arguments, self.device)

        self._for_views(differentiate)
        return gradient

    @cached_property
    def _hits(self) -> int:
        return sum(len(light.hits) for light in self.lights)

    @cached_property
    def _records(self) -> Int[Tensor, "views bytes"]:
        return torch.stack([light.record for light in self.lights])

    @property
    def _views(self) -> Any:
        """The views as kernels take them."""
        records, device = self._records, wp.device_from_torch(self.device)
        return wp.array(ptr=records.data_ptr(), dtype=deferred_kernels.StoredView, shape=len(records), device=device)

    @cached_property
    def _places(self) -> Int[Tensor, "views 2"]:
        """The first hit and the first texture of each view."""
        counts = [(len(light.hits), light.textures) for light in self.lights]
        first = np.cumsum([(0, 0), *counts[:-1]], axis=0, dtype=np.int32)
        return upload(torch.from_numpy(first), self.device)

    @cached_property
    def _textures(self) -> deferred_kernels.Textures:
        result: Any = deferred_kernels.Textures()
        _, result.rows, result.cols, result.channels = self.values.shape
        result.values = wp.from_torch(self.values.view(-1))
        result.roughness = result.metallic = result.normal = -1
        first = accumulate((CHANNELS[name] for name in self.maps), initial=0)
        for name, channel in list(zip(self.maps, first, strict=False))[1:]:
            setattr(result, name, channel)
        return result

    @cached_property
    def _rays(self) -> Any:
        """Drawn by `forward`, and read by `backward`."""
        rays = torch.empty(self._hits, 2, dtype=torch.float32, device=self.device)
        return wp.from_torch(rays, dtype=wp.vec2)

    def _draw_light(self) -> None:
        """Brings the light samples to the visit: a share of them is drawn again for each visit since the last one.

        The samples then depend on the visit alone. After a later visit, all of them are drawn again.
        """
        for light in self.lights:
            if light.visit > self.visit:
                light.visit = self.visit - REDRAWS
        for drawn in range(self.visit - REDRAWS + 1, self.visit + 1):
            due = [n for n, light in enumerate(self.lights) if light.visit < drawn]
            if due:
                self._draw(due, drawn)
        for light in self.lights:
            light.visit = self.visit

    def _draw(self, due: Sequence[int], visit: int) -> None:
        """Draws the light samples of one visit for some of the views."""
        views, group = self._views, visit % REDRAWS

        def redraw(first: int, count: int, hits: int) -> None:
            launch(deferred_kernels.draw_light, (count, hits), (views, first, group, visit), self.device)

        if len(due) == len(self.lights):
            self._for_views(redraw)
        else:
            for view in due:
                redraw(view, 1, len(self.lights[view].hits))

    def _for_views(self, job: Any) -> None:
        """Calls `job` with the first of the views, their number, and the most hits of any."""
        counts = [len(light.hits) for light in self.lights]
        if self.device.type == "cuda":
            job(0, len(counts), max(counts))
        else:
            list(in_order(lambda view: job(view, 1, counts[view]), range(len(counts)), self.device))
