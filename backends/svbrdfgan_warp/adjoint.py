"""The transpose of the picture: from the gradient of an image to those of the base colours and the environment."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.types import Gradients, Materials, View
from svbrdfgan_warp import lookup, textures
from svbrdfgan_warp.device import launch
from svbrdfgan_warp.records import Records


@dataclass(frozen=True, eq=False)
class Adjoint:
    """Gradients while they are summed, in float64: in float32 a sum stands still after some 2^24 additions.

    Records are to be added by one thread: Warp's atomics are none on a CPU, and the order decides the last bits.

    Attributes:
        atlas, texels: the base colours of all parts.
        grad_image: pixel by pixel.
        grad_texels: of the base colours; None if not wanted.
        grad_light: of the environment's radiance; None if not wanted.
    """

    atlas: lookup.Atlas
    texels: Float[Tensor, "texels 3"]
    grad_image: Float[Tensor, "pixels 3"]
    grad_texels: Float[Tensor, "texels 3"] | None
    grad_light: Float[Tensor, "rows cols 3"] | None

    @classmethod
    def of(
        cls,
        atlas: lookup.Atlas,
        texels: Float[Tensor, "texels 3"],
        view: View,
        grad_image: Float[Tensor, "height width 3"],
        wrt: Set[str],
    ) -> Adjoint:
        """Sums of nothing yet."""
        device = texels.device
        return cls(
            atlas,
            texels,
            grad_image.detach().to(device, torch.float32).reshape(-1, 3).contiguous(),
            _zeros(texels.shape, device) if "base_color" in wrt else None,
            _zeros(view.environment.radiance.shape, device) if "environment" in wrt else None,
        )

    def add(self, records: Records) -> None:
        """Adds what these records pass on."""
        device, count, grad_image = self.texels.device, len(records.run), wp.from_torch(self.grad_image, wp.vec3)
        if self.grad_texels is not None:
            sums = wp.from_torch(self.grad_texels, wp.vec3d)
            samples, *met = records.arguments()
            runs = -(-count // lookup.RUN)
            launch(lookup.scatter_texels, runs, (self.atlas, samples, count, *met, grad_image, sums), device)
        if self.grad_light is not None:
            arrivals, texels = (wp.from_torch(tensor, wp.vec3) for tensor in (records.arrivals, self.texels))
            sums, given = wp.from_torch(self.grad_light, wp.vec3d), (arrivals, texels, grad_image)
            launch(lookup.scatter_light, count, (self.atlas, *records.met(), *given, sums), device)

    def gradients(self, materials: Materials) -> Gradients:
        """The sums, each in the shape of its input."""
        light = None if self.grad_light is None else self.grad_light.float()
        if self.grad_texels is None:
            return Gradients(tuple({} for _ in materials.parts), light)
        pieces = textures.unpack(self.grad_texels.float(), materials)
        return Gradients(tuple({"base_color": piece} for piece in pieces), light)


def _zeros(shape: torch.Size, device: torch.device) -> Float[Tensor, "*shape"]:
    return torch.zeros(shape, dtype=torch.float64, device=device)
