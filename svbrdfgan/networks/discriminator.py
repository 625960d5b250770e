"""PatchGAN: a judge of patches."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor, nn

from svbrdfgan.networks.norm import Norm, make_norm


class Discriminator(nn.Module):
    """PatchGAN (Isola et al. 2017): one logit, positive for real, for each overlapping patch of a picture.

    Args:
        channels: of the picture: 3, or 9 where position and normal are shown beside it.
        width: channels after the first convolution, doubled by each of the first three layers.
        layers: strided convolutions; 3 sees patches of 70 pixels, 2 of 34, 1 of 16.
        norm: of all but the first. A gradient penalty needs "none" or "group": it is defined for one sample at a time.
    """

    def __init__(self, channels: int = 3, width: int = 64, layers: int = 3, norm: Norm = "none") -> None:
        super().__init__()
        blocks: list[nn.Module] = [nn.Conv2d(channels, width, 4, 2, 1), _leaky()]
        now = width
        for depth in range(1, layers + 1):
            stride = 2 if depth < layers else 1
            wider = width * min(2**depth, 8)
            blocks += [nn.Conv2d(now, wider, 4, stride, 1), make_norm(wider, norm), _leaky()]
            now = wider
        self.layers = nn.Sequential(*blocks, nn.Conv2d(now, 1, 4, 1, 1))

    def forward(self, picture: Float[Tensor, "batch channels height width"]) -> Float[Tensor, "batch h w"]:
        return self.layers(picture).squeeze(1).float()


def _leaky() -> nn.Module:
    return nn.LeakyReLU(0.2, inplace=True)
