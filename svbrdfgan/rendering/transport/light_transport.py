"""The light transport of one view, and its file."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan.io.tensors import save_tensors, stored_tensors
from svbrdfgan.utils.copy_async import copy_async

_FORMAT = "svbrdfgan light transport 2"
_HALF_LIMIT = 32768.0
"""The greatest weight in half precision: about half of the greatest finite number, so that nothing overflows."""


@dataclass(frozen=True, eq=False)
class LightTransport:
    """One view of one surface: `image = background + T @ textures`, with T sparse (CSR), one row for each pixel.

    The textures are those of the learnable parts, in the order of `parts`, each (rows, cols, 3) linear reflectance;
    everything else is folded into the background. Entry n of T adds `weight[n] * scale` times the value of texel
    `texel[n]` of the stacked textures, (part * rows + row) * cols + col, to its pixel; the entries of pixel i are
    `start[i]` to `start[i + 1]`.

    Attributes:
        start: first entry of each pixel, row * width + col, and the count of all entries; int32.
        texel: ascending within a pixel; int32.
        weight: linear RGB, half or single precision; `half` states the error.
        scale: one factor for all weights, so that half precision holds any brightness.
        background: the image of all parts that are not learnable, premultiplied.
        coverage: share of each pixel that shows the surface.
        gbuffer: mean position and normal over a pixel's learnable samples, times their share of the pixel.
        parts: indices into `Surface.parts` of the textures.
        texture_shape: (rows, cols) of each texture.
    """

    start: Int[Tensor, " pixels+1"]
    texel: Int[Tensor, " entries"]
    weight: Float[Tensor, "entries 3"]
    scale: Float[Tensor, ""]
    background: Float[Tensor, "height width 3"]
    coverage: Float[Tensor, "height width"]
    gbuffer: Float[Tensor, "height width 6"]
    parts: tuple[int, ...]
    texture_shape: tuple[int, int]

    @property
    def texels(self) -> int:
        """Columns of T: the texels of all its textures."""
        return len(self.parts) * self.texture_shape[0] * self.texture_shape[1]

    def seen_texels(self) -> Float[Tensor, "parts rows cols"]:
        """Each texel's mean RGB weight in the image; zero for one that is not seen or not lit."""
        seen = torch.zeros(self.texels, device=self.texel.device)
        seen.index_add_(0, self.texel.long(), self.weight.float().mean(dim=1) * self.scale)
        return seen.reshape(len(self.parts), *self.texture_shape)

    def half(self) -> LightTransport:
        """The same with weights and G-buffer in half precision, which takes half the bytes.

        A weight's error is at most 2^-11 of itself, or 2^-40 of the largest weight where that is more. That also bounds
        the relative error of an image of non-negative reflectances, since all weights are positive; 4e-4 at most was
        measured (`docs/lab/performance.md`).
        """
        largest = (self.weight.float().abs().max() if len(self.weight) else self.scale.new_ones(())) * self.scale
        scale = (largest / _HALF_LIMIT).clamp(min=torch.finfo(torch.float32).tiny)
        weight = (self.weight.float() * (self.scale / scale)).half()
        background, gbuffer = self.background.float(), self.gbuffer.half()
        return replace(self, weight=weight, scale=scale, background=background, gbuffer=gbuffer)

    @property
    def device(self) -> torch.device:
        return self.texel.device

    @property
    def nbytes(self) -> int:
        """Bytes of its tensors."""
        return sum(tensor.nbytes for tensor in self.tensors().values())

    def to(self, device: torch.device | str) -> LightTransport:
        """The same on another device. A copy from the CPU to CUDA is queued there; the caller goes on."""
        moved: dict[str, Any] = {name: copy_async(tensor, device) for name, tensor in self.tensors().items()}
        return replace(self, **moved)

    def record_stream(self, stream: torch.cuda.Stream) -> None:
        """Keeps torch from reusing its memory before the work queued on this stream is done."""
        for tensor in self.tensors().values():
            tensor.record_stream(stream)

    def save(self, path: Path) -> None:
        """Writes one safetensors file, atomically."""
        words = {"parts": self.parts, "texture_shape": self.texture_shape}
        save_tensors(path, _FORMAT, self.tensors(), {name: ",".join(map(str, of)) for name, of in words.items()})

    @classmethod
    def load(cls, path: Path) -> LightTransport:
        """Reads what `save` wrote.

        Raises:
            AssetError: the file is missing, damaged, or not a light transport.
        """
        with stored_tensors(path, _FORMAT, "delete it to have it traced again") as (tensors, words):
            rows, cols = (int(n) for n in words["texture_shape"].split(","))
            parts = tuple(int(n) for n in words["parts"].split(",") if n)
            transport = cls(**tensors, parts=parts, texture_shape=(rows, cols))
            transport._require_consistent()
        return transport

    def _require_consistent(self) -> None:
        """Raises ValueError if shapes, types or indices do not fit together: products do not check indices."""
        (height, width), entries, half_or_single = self.coverage.shape, len(self.texel), (torch.half, torch.float)
        wanted = {
            "start": ((height * width + 1,), (torch.int32,)),
            "texel": ((entries,), (torch.int32,)),
            "weight": ((entries, 3), half_or_single),
            "scale": ((), (torch.float,)),
            "background": ((height, width, 3), (torch.float,)),
            "gbuffer": ((height, width, 6), half_or_single),
        }
        for name, (shape, types) in wanted.items():
            tensor = getattr(self, name)
            if tensor.shape != shape or tensor.dtype not in types:
                raise ValueError(f"{name} is {tensor.dtype} of shape {tuple(tensor.shape)}; wanted {types[0]}, {shape}")
        if self.start[0] != 0 or self.start[-1] != entries or (self.start[1:] < self.start[:-1]).any():
            raise ValueError("start does not ascend from 0 to the count of entries")
        if entries and not 0 <= self.texel.min() <= self.texel.max() < self.texels:
            raise ValueError("texel names texels that the textures do not have")

    def tensors(self) -> dict[str, Tensor]:
        """The tensors, by the name of the attribute."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in values.items() if isinstance(value, Tensor)}
