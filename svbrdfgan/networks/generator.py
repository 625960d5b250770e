"""Johnson et al.'s ResNet (2016), with all that stands between two of its convolutions as one operation."""

from __future__ import annotations

from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn

from svbrdfgan.networks.fused.dispatch import prologue
from svbrdfgan.networks.fused.reference import Features, Prologue
from svbrdfgan.networks.norm import Norm, make_norm
from svbrdfgan.rendering.compositing import RGBA

GEOMETRY_CHANNELS = 6

Upsampling = Literal["nearest", "strided"]
Residual = Float[Tensor, "batch channels rows cols"] | None


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
        self.first = nn.Conv2d(GEOMETRY_CHANNELS, width, 7, bias=_biased(norm))
        self.down = nn.Sequential(
            _convolution(width, 2 * width, 3, norm, stride=2), _convolution(2 * width, 4 * width, 3, norm, stride=2)
        )
        self.blocks = nn.ModuleList(ResidualBlock(4 * width, norm) for _ in range(blocks))
        self.up = nn.ModuleList([_up(4 * width, 2 * width, norm, upsampling), _up(2 * width, width, norm, upsampling)])
        self.last = Convolution(nn.Conv2d(width, channels, 7), norm, pad=3)

    def forward(self, geometry: Float[Tensor, "batch 6 rows cols"]) -> Float[Tensor, "batch rows cols channels"]:
        """Straight-alpha linear values in (0, 1). Rows and columns must be multiples of four, and at least 16."""
        x: Tensor = self.down(self.first(prologue(geometry, Prologue(pad=3)).padded))
        residual: Residual = None
        for block in self.blocks:
            x, residual = block(x, residual)
        x = self.last(self.up[1](self.up[0](x, residual)))
        return torch.sigmoid(x.float()).permute(0, 2, 3, 1)


class Convolution(nn.Module):
    """A convolution of what another one gave, which it first normalises and so on, as `Prologue` says.

    Args:
        convolve: itself, without padding.
        norm: of what it reads.
    """

    def __init__(self, convolve: nn.Conv2d | nn.ConvTranspose2d, norm: Norm, pad: int = 0, upsample: int = 1) -> None:
        super().__init__()
        self.pad, self.upsample, self.fused = pad, upsample, norm == "instance"
        self.norm = nn.Identity() if self.fused else make_norm(convolve.in_channels, norm)
        self.convolve = convolve

    def forward(self, x: Float[Tensor, "batch inputs rows cols"], residual: Residual = None) -> Tensor:
        convolved: Tensor = self.convolve(self.read(x, residual).padded)
        return convolved

    def read(self, x: Float[Tensor, "batch inputs rows cols"], residual: Residual = None) -> Features:
        """What is convolved. No ReLU follows a sum (He et al. 2016)."""
        how = Prologue(norm=self.fused, relu=residual is None, upsample=self.upsample, pad=self.pad)
        return prologue(self.norm(x), how, residual)


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions beside the identity (He et al. 2016). Whoever reads it normalises, and adds the identity."""

    def __init__(self, channels: int, norm: Norm) -> None:
        super().__init__()
        self.first = _convolution(channels, channels, 3, norm)
        self.second = _convolution(channels, channels, 3, norm)

    def forward(
        self, x: Float[Tensor, "batch channels h w"], residual: Residual
    ) -> tuple[Float[Tensor, "batch channels h w"], Residual]:
        """Its second convolution, and what is to be added to the norm of that."""
        padded, features = self.first.read(x, residual)
        return self.second(self.first.convolve(padded)), features


def _convolution(inputs: int, outputs: int, size: int, norm: Norm, stride: int = 1, upsample: int = 1) -> Convolution:
    convolve = nn.Conv2d(inputs, outputs, size, stride, bias=_biased(norm))
    return Convolution(convolve, norm, pad=size // 2, upsample=upsample)


def _up(inputs: int, outputs: int, norm: Norm, upsampling: Upsampling) -> Convolution:
    if upsampling == "nearest":
        return _convolution(inputs, outputs, 3, norm, upsample=2)
    convolve = nn.ConvTranspose2d(inputs, outputs, 3, stride=2, padding=1, output_padding=1, bias=_biased(norm))
    return Convolution(convolve, norm)


def _biased(norm: Norm) -> bool:
    """Whether convolutions have a bias: an instance norm would take it out again."""
    return norm != "instance"
