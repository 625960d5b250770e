"""The PatchGAN discriminator."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor, nn

from svbrdfgan.networks.layers import Norm, make_norm


class Discriminator(nn.Module):
    """PatchGAN (Isola et al. 2017): one logit, positive for real, for each overlapping patch of an image.

    Args:
        channels: of the image: 3, or 9 with the six of the G-buffer.
        width: channels after the first convolution, doubled by each of the first three layers.
        layers: convolutions between the first and the last; 3 gives patches of 70 pixels, 2 of 34, 1 of 16.
        norm: after every convolution but the first and the last. A gradient penalty is defined for one sample at a
            time, which "instance" is not.
    """

    def __init__(self, channels: int = 3, width: int = 64, layers: int = 3, norm: Norm = "none") -> None:
        super().__init__()
        blocks: list[nn.Module] = [nn.Conv2d(channels, width, 4, 2, 1), _leaky_relu()]
        inputs = width
        for depth in range(1, layers + 1):
            stride = 2 if depth < layers else 1
            outputs = width * min(2**depth, 8)
            blocks += [nn.Conv2d(inputs, outputs, 4, stride, 1), make_norm(outputs, norm), _leaky_relu()]
            inputs = outputs
        self.layers = nn.Sequential(*blocks, nn.Conv2d(inputs, 1, 4, 1, 1))

    def forward(self, image: Float[Tensor, "batch channels height width"]) -> Float[Tensor, "batch h w"]:
        return self.layers(image).squeeze(1).float()  # losses are taken in single precision


def _leaky_relu() -> nn.Module:
    return nn.LeakyReLU(0.2, inplace=True)
