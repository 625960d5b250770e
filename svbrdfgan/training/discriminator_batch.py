"""Pictures for the discriminator: exemplars and fakes, composited over a background and tone-mapped."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.data.exemplar_files import BRIGHTEST
from svbrdfgan.rendering.compositing import over
from svbrdfgan.utils.copy_async import copy_async

Pictures = Float[Tensor, "batch channels height width"]

_CONTRAST = 10.0
_STEEPNESS = 8.0
"""Detail has about an eighth of a layer's contrast."""


@dataclass(frozen=True, eq=False)
class ImageBatch:
    """A batch of images and what is known of each pixel.

    Attributes:
        image: linear and premultiplied: radiance, or reflectance where the light was divided out.
        coverage: share of each pixel that shows the surface.
        gbuffer: position and normal that each pixel shows, premultiplied; None where the discriminator is not shown it.
        light_buffer: how the scene lights reference materials there (`svbrdfgan.training.reference_pictures`), linear
            and premultiplied; None likewise.
        clean: pictures of the same scenes without the layer, linear and premultiplied; None likewise.
        labels: what is known of the layer that each image shows (`Conditions`); None if nothing is.
        pixel_size: how large a pixel is (`pixel_sizes`), about -1 to 1; None where the discriminator is not shown it.
    """

    image: Float[Tensor, "batch height width 3"]
    coverage: Float[Tensor, "batch height width"]
    gbuffer: Float[Tensor, "batch height width 6"] | None = None
    light_buffer: Float[Tensor, "batch height width 9"] | None = None
    clean: Float[Tensor, "batch height width 3"] | None = None
    labels: Float[Tensor, "batch labels"] | None = None
    pixel_size: Float[Tensor, "batch 1"] | None = None

    def __len__(self) -> int:
        return len(self.image)

    def pick(self, indices: Sequence[int], device: torch.device | None = None) -> ImageBatch:
        """The images at these indices, on a device, by default their own. Nothing waits for copies from the CPU."""
        picked, device = copy_async(torch.as_tensor(indices), self.image.device), device or self.image.device
        return ImageBatch(**{name: copy_async(values[picked], device) for name, values in self._known().items()})

    @property
    def nbytes(self) -> int:
        return sum(values.nbytes for values in self._known().values())

    def _known(self) -> dict[str, Tensor]:
        return {name: values for name, values in vars(self).items() if values is not None}

    def to(self, device: torch.device) -> ImageBatch:
        """The same on a device."""
        return ImageBatch(**{name: values.to(device) for name, values in self._known().items()})

    @classmethod
    def cat(cls, batches: Sequence[ImageBatch]) -> ImageBatch:
        """Joins the images to one batch, in half precision, as exemplars are stored, without labels and pixel sizes.

        The batches have the same buffers.
        """
        image = torch.cat([batch.image.clamp(max=BRIGHTEST).half() for batch in batches])
        coverage = torch.cat([batch.coverage.half() for batch in batches])
        buffers = []
        for each in zip(*((batch.gbuffer, batch.light_buffer, batch.clean) for batch in batches), strict=True):
            known = [buffer.half() for buffer in each if buffer is not None]
            buffers.append(torch.cat(known) if known else None)
        return cls(image, coverage, *buffers)

    def tone_mapped(self, background: Float[Tensor, "batch 3"], octaves: int = 0) -> Pictures:
        """The images over a plain background, in about [-1, 1], and six channels of G-buffer and nine of light buffer.

        Three more are the difference between the images and the clean ones, both tone-mapped, and three more each of
        its `octaves_of`, at eight times its contrast. The size of a pixel and each label are one more channel, the
        same everywhere. None has no channels. The light buffer is over black, and has the images' tone curve.

        The tone curve is log(1 + 10 x) / log 11 * 2 - 1. The curve maps 0 to -1 and 1 to 1, and is never flat:
        highlights keep a gradient.
        """
        picture = over(self.image.float(), self.coverage.float(), background[:, None, None, :])
        shown = tone_curve(picture)
        channels = [shown]
        if self.gbuffer is not None:
            channels.append(self.gbuffer.float())
        if self.light_buffer is not None:
            channels.append(tone_curve(self.light_buffer.float()))
        if self.clean is not None:
            clean = over(self.clean.float(), self.coverage.float(), background[:, None, None, :])
            difference = shown - tone_curve(clean)
            channels += [difference, *(_STEEPNESS * octave for octave in octaves_of(difference, octaves))]
        even = (self.pixel_size, self.labels)
        channels += [known[:, None, None, :].expand(*self.coverage.shape, -1) for known in even if known is not None]
        return torch.cat(channels, dim=-1).permute(0, 3, 1, 2)


@dataclass(frozen=True, eq=False)
class DiscriminatorBatch:
    """A batch of exemplars and as many fakes, ready for the discriminator."""

    real: Pictures
    fake: Pictures


def composite_pair(
    real: ImageBatch,
    fake: ImageBatch,
    rng: np.random.Generator,
    augmented: Float[Tensor, ""] | None = None,
    octaves: int = 0,
) -> DiscriminatorBatch:
    """Tone-maps both sides over random plain backgrounds.

    An exemplar and its fake share a background, so that the background does not tell them apart.

    Args:
        augmented: the share of pairs that are mirrored and turned at random. An exemplar and its fake are turned alike,
            so the generator learns nothing of it.
        octaves: how many octaves of the difference to the clean picture the discriminator is shown (`octaves_of`).
    """
    background = _random(rng.random((len(real), 3), dtype=np.float32), real)
    shown = [each.tone_mapped(background, octaves) for each in (real, fake)]
    if augmented is not None:
        chosen = _random(rng.random((len(real), 1), dtype=np.float32), real) < augmented
        turns = chosen & _random(rng.random((len(real), 3)) < 0.5, real)
        shown = [_turned(each, turns) for each in shown]
    return DiscriminatorBatch(*shown)


def octaves_of(
    images: Float[Tensor, "batch height width channels"], count: int
) -> list[Float[Tensor, "batch height width channels"]]:
    """The octaves of pictures from the second finest on, each at the full size (Burt and Adelson 1983).

    The finest is left out: there fakes have the most noise, by which they would be told apart.
    """
    size, found = images.shape[1:3], []
    rest = _halved(images.permute(0, 3, 1, 2))
    for _ in range(count):
        coarser = _halved(rest)
        octave = rest - _sized(coarser, rest.shape[2:])
        found.append(_sized(octave, size).permute(0, 2, 3, 1))
        rest = coarser
    return found


def _halved(images: Pictures) -> Pictures:
    return F.avg_pool2d(images, 2, ceil_mode=True, count_include_pad=False)


def _sized(images: Pictures, size: Sequence[int]) -> Pictures:
    return F.interpolate(images, tuple(size), mode="bilinear", align_corners=False)


def _random(values: ndarray, batch: ImageBatch) -> Tensor:
    return copy_async(torch.from_numpy(values), batch.image.device)


def _turned(pictures: Pictures, turns: Bool[Tensor, "batch 3"]) -> Pictures:
    """The pictures mirrored top to bottom, left to right, and about a diagonal, where `turns` says so.

    Pictures that are not square are not mirrored about a diagonal.
    """
    vertical, horizontal, diagonal = turns[:, :, None, None, None].unbind(dim=1)
    pictures = torch.where(vertical, pictures.flip(-2), pictures)
    pictures = torch.where(horizontal, pictures.flip(-1), pictures)
    if pictures.shape[-1] == pictures.shape[-2]:
        pictures = torch.where(diagonal, pictures.transpose(-1, -2), pictures)
    return pictures


def tone_curve(radiance: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """log(1 + 10 x) / log 11 * 2 - 1 of linear values; see `ImageBatch.tone_mapped`."""
    return torch.log1p(_CONTRAST * radiance.clamp(min=0)) * (2 / math.log1p(_CONTRAST)) - 1
