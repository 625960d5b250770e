"""The perceived difference of two images: NVIDIA's FLIP (Andersson et al. 2020), by its authors' package."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

from svbrdfgan.io.image import srgb_from_linear
from svbrdfgan.rendering.compositing import over

Picture = Float[Tensor, "height width 3"]


def display(
    picture: Picture, background: float = 0.5, coverage: Float[Tensor, "height width"] | None = None
) -> Picture:
    """A linear image as sRGB in [0, 1]; over a grey background if its coverage is given."""
    if coverage is not None:
        picture = over(picture, coverage, picture.new_tensor(background))
    return srgb_from_linear(picture.float().clamp(0, 1))


def flip(truth: Picture, picture: Picture) -> float:
    """The mean FLIP error between two sRGB images, in [0, 1], at 67 pixels per degree; 0 for equal images."""
    import flip_evaluator

    pair = [image.detach().cpu().float().contiguous().numpy() for image in (truth, picture)]
    _, mean, _ = flip_evaluator.evaluate(pair[0], pair[1], "LDR", applyMagma=False)
    return float(mean)
