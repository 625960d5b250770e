"""Results of renderers. Torch, float32, on the renderer's device."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from jaxtyping import Float, Int
from torch import Tensor


@dataclass(frozen=True, eq=False)
class Rendering:
    """A picture of the surface alone, premultiplied by coverage, for compositing over any background.

    Attributes:
        image: linear radiance of the surface times coverage, so zero where the surface is not seen. The environment
            lights the surface but is not in the image; `image + (1 - coverage) * background` adds a background.
        coverage: share of each pixel that shows the surface, in [0, 1].
    """

    image: Float[Tensor, "height width 3"]
    coverage: Float[Tensor, "height width"]


@dataclass(frozen=True, eq=False)
class Gradients:
    """The gradient of sum(image * grad_image) for the inputs named in `wrt`.

    Attributes:
        materials: per part, the gradient of each differentiated map, shaped like that map.
        environment: gradient of the environment's radiance, (rows, cols, 3); None if "environment" was not named.
    """

    materials: tuple[Mapping[str, Tensor], ...]
    environment: Tensor | None = None


@dataclass(frozen=True, eq=False)
class TransportSamples:
    """Camera samples that hit the surface: `image[pixel]` is the sum of `weight * base_color(part, uv)` over them.

    There is exactly one record for each camera sample that hit the surface, with zero weight where no light arrives.
    So a pixel's records divided by its samples are its coverage.

    Attributes:
        pixel: row * width + column.
        part: index into `Surface.parts`.
        uv: texture coordinates of the hit, in [0, 1].
        weight: linear RGB, already divided by the samples per pixel.
    """

    pixel: Int[Tensor, " samples"]
    part: Int[Tensor, " samples"]
    uv: Float[Tensor, "samples 2"]
    weight: Float[Tensor, "samples 3"]
