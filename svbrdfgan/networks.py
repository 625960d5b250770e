"""The generator and the discriminator of thesis 4.3.1."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn

from svbrdfgan.compositing import RGBA

GEOMETRY_CHANNELS = 6

Norm = Literal["instance", "group", "none"]
Upsampling = Literal["nearest", "strided"]


class Generator(nn.Module):
    """Johnson et al.'s ResNet (2016): a geometry buffer in, a layer out, at the same size.

    One 7x7 convolution, two strided ones, residual blocks, two upsampling convolutions, one 7x7.

    Args:
        width: channels after the first convolution; four times as many in the blocks. The thesis's is 64.
        blocks: residual blocks; the thesis has six.
        norm: "instance" is the thesis's.
        upsampling: "strided" convolutions, fractionally, are the thesis's, and leave a pattern of four texels in what
            they paint; "nearest" doubles the features and convolves (Odena et al. 2016), and does not.
        channels: of the layer: RGBA, and those of further maps (`layer_channels`).
    """

    def __init__(
        self,
        width: int = 64,
        blocks: int = 6,
        norm: Norm = "instance",
        upsampling: Upsampling = "nearest",
        channels: int = RGBA,
    ) -> None:
        super().__init__()
        self.channels = channels
        layers: list[nn.Module] = [*_conv(GEOMETRY_CHANNELS, width, 7, norm)]
        layers += _conv(width, 2 * width, 3, norm, stride=2)
        layers += _conv(2 * width, 4 * width, 3, norm, stride=2)
        layers += [ResidualBlock(4 * width, norm) for _ in range(blocks)]
        layers += _upconv(4 * width, 2 * width, norm, upsampling)
        layers += _upconv(2 * width, width, norm, upsampling)
        layers += [nn.Conv2d(width, channels, 7, padding=3, padding_mode="reflect")]
        self.layers = nn.Sequential(*layers)

    def forward(self, geometry: Float[Tensor, "batch 6 rows cols"]) -> Float[Tensor, "batch rows cols channels"]:
        """Straight-alpha linear values in (0, 1). Rows and columns must be multiples of four, and at least 16."""
        return torch.sigmoid(self.layers(geometry).float()).permute(0, 2, 3, 1)


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions beside the identity (He et al. 2016)."""

    def __init__(self, channels: int, norm: Norm) -> None:
        super().__init__()
        second = nn.Conv2d(channels, channels, 3, padding=1, padding_mode="reflect")
        self.layers = nn.Sequential(*_conv(channels, channels, 3, norm), second, _normalise(channels, norm))

    def forward(self, features: Float[Tensor, "batch channels h w"]) -> Float[Tensor, "batch channels h w"]:
        return features + self.layers(features)


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
            blocks += [nn.Conv2d(now, wider, 4, stride, 1), _normalise(wider, norm), _leaky()]
            now = wider
        self.layers = nn.Sequential(*blocks, nn.Conv2d(now, 1, 4, 1, 1))

    def forward(self, picture: Float[Tensor, "batch channels height width"]) -> Float[Tensor, "batch h w"]:
        return self.layers(picture).squeeze(1).float()


def initialise(network: nn.Module, generator: torch.Generator) -> None:
    """Weights from N(0, 0.02), biases zero: the thesis's code base, where it does not say otherwise."""
    for module in network.modules():
        if isinstance(module, nn.Conv2d | nn.ConvTranspose2d):
            nn.init.normal_(module.weight, 0.0, 0.02, generator=generator)
            if module.bias is not None:
                nn.init.zeros_(module.bias)


def _conv(inputs: int, outputs: int, size: int, norm: Norm, stride: int = 1) -> list[nn.Module]:
    conv = nn.Conv2d(inputs, outputs, size, stride, padding=size // 2, padding_mode="reflect")
    return [conv, _normalise(outputs, norm), nn.ReLU(inplace=True)]


def _upconv(inputs: int, outputs: int, norm: Norm, upsampling: Upsampling) -> list[nn.Module]:
    if upsampling == "nearest":
        return [nn.Upsample(scale_factor=2), *_conv(inputs, outputs, 3, norm)]
    conv = nn.ConvTranspose2d(inputs, outputs, 3, stride=2, padding=1, output_padding=1)
    return [conv, _normalise(outputs, norm), nn.ReLU(inplace=True)]


def _leaky() -> nn.Module:
    return nn.LeakyReLU(0.2, inplace=True)


def _normalise(channels: int, norm: Norm) -> nn.Module:
    makers: dict[str, Callable[[], nn.Module]] = {
        "instance": lambda: nn.InstanceNorm2d(channels),
        "group": lambda: nn.GroupNorm(min(8, channels), channels),
        "none": nn.Identity,
    }
    return makers[norm]()
