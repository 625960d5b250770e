"""What renderers give back. Torch, float32, on the renderer's device."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from jaxtyping import Float, Int
from torch import Tensor


@dataclass(frozen=True, eq=False)
class Rendering:
    """A picture of the surface alone, to lay over any background.

    Attributes:
        image: linear radiance leaving the surface, zero where it is not seen: already multiplied by coverage.
            The environment lights it but is not in it; `image + (1 - coverage) * background` puts one behind.
        coverage: share of each pixel that shows the surface, in [0, 1].
    """

    image: Float[Tensor, "height width 3"]
    coverage: Float[Tensor, "height width"]


@dataclass(frozen=True, eq=False)
class Gradients:
    """The gradient of sum(image * grad_image), for the inputs named in `wrt`.

    Attributes:
        materials: per part, the gradient of each differentiated map, shaped as that map.
        environment: gradient of the environment's radiance (rows, cols, 3), where "environment" was named.
    """

    materials: tuple[Mapping[str, Tensor], ...]
    environment: Tensor | None = None


@dataclass(frozen=True, eq=False)
class TransportSamples:
    """Camera samples that met the surface: `image[pixel] += weight * base_color(part, uv)`, summed over all samples.

    Exactly one record for each camera sample that met the surface, of zero weight where no light arrives,
    so that records per pixel over samples per pixel is the coverage.

    Attributes:
        pixel: row * width + column.
        part: index into `Surface.parts`.
        uv: where the surface was met, in [0, 1].
        weight: linear RGB, the division by the sample count included.
    """

    pixel: Int[Tensor, " samples"]
    part: Int[Tensor, " samples"]
    uv: Float[Tensor, "samples 2"]
    weight: Float[Tensor, "samples 3"]
