"""Johnson et al.'s ResNet (2016); norm, activation and padding between its convolutions are one fused operation."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Literal

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor, nn

from svbrdfgan.networks.fused import Affine, Features, NormActPad, norm_act_pad
from svbrdfgan.networks.inputs import Inputs, window_of
from svbrdfgan.networks.layers import Norm, make_norm
from svbrdfgan.networks.modulation import Modulation
from svbrdfgan.networks.random_fields import random_fields, random_numbers
from svbrdfgan.networks.relief import FINE_REACH, fine_relief, relief_normals
from svbrdfgan.types import channel_slices, layer_channels

GEOMETRY_CHANNELS = 6
"""Position and normal."""
NORMAL = slice(3, 6)
"""The normal's channels."""
MESH_MAPS = 5
"""Visibility, curvature, and nearness to convex edges, creases and borders."""

_NO_METAL = -3.0
"""What is added to metallic before the sigmoid. Without it training starts half metallic, and few things are."""

_HEIGHT = 2e-4
"""Height of the relief, in units of half a vehicle length, where the last convolution gives 1. So training starts with
normals that lean by a few degrees, as those of relief do."""
_LEAST_SLANT = 0.1
"""Least z of a refined normal, so that its slopes are bounded."""
_LEAST = 1e-3
"""What a refined layer's values keep from 0 and 1 before their logit is taken, which is that of a faint layer."""

_NUMBERS = 16
"""Random numbers of a seed that modulate the features: what distinguishes draws as wholes, where fields do locally."""

Upsampling = Literal["nearest", "strided"]
Residual = Float[Tensor, "batch channels rows cols"] | None


class Generator(nn.Module):
    """Johnson et al.'s ResNet (2016), from a geometry buffer to a layer of the same size.

    It has one convolution, strided ones that each halve the resolution and double the channels, residual blocks, as
    many upsampling convolutions, and a last one.

    With random fields, a layer is a function of the geometry and a seed: fields of object space are read next to the
    geometry, and random numbers modulate the features. Labels of the layer modulate them, too.

    With skips, features on the way down are added to those of the same resolution on the way up, and a convolution
    there mixes both (U-Net; Ronneberger et al. 2015). So coarse features decide where the finest random fields show,
    which else would have to pass the blocks.

    Args:
        width: channels after the first convolution. The thesis uses 64, and so 256 in the blocks.
        blocks: residual blocks; the thesis uses six.
        downsamplings: how often the resolution is halved before the blocks; the thesis uses two. One more for twice the
            texels, with half the width, keeps the blocks' resolution, their channels and what they see of the surface,
            and most of the cost.
        norm: the thesis uses "instance". Windows need one of `LOCAL_NORMS`.
        upsampling: "strided" is the thesis's transposed convolution, which leaves a checkerboard of period four in
            the layer; "nearest" doubles the features and convolves (Odena et al. 2016), which does not.
        kernel: side of the first and the last convolution, odd; the thesis uses 7. With skips 3 is enough, and cheaper.
        skips: whether features skip the blocks at each resolution; the thesis has no skips.
        mesh_maps: whether it reads mesh maps besides position and normal (`MeshMaps`).
        maps: further maps that the layer paints besides base_color, in the order of `FURTHER_MAPS`.
        random_fields: how many random fields it reads, one for each octave; 0: it reads none.
        labels: numbers that say which layer is wanted, such as its amount; about -1 to 1.
        refined: a trained generator of whole maps, which stays as it is. This one refines its layers in windows: it
            reads them next to the geometry, and adds to their logits and slopes, nothing before training
            (`start_refining`), and to slopes only those of fine relief (`fine_relief`): the broad ones are known, and
            pictures of windows hardly show them. Both have the same maps, labels and mesh maps.
    """

    def __init__(
        self,
        width: int = 64,
        blocks: int = 6,
        downsamplings: int = 2,
        norm: Norm = "instance",
        upsampling: Upsampling = "nearest",
        kernel: int = 7,
        skips: bool = False,
        maps: tuple[str, ...] = (),
        mesh_maps: bool = False,
        random_fields: int = 0,
        labels: int = 0,
        refined: Generator | None = None,
    ) -> None:
        super().__init__()
        self.refined = None if refined is None else refined.eval().requires_grad_(False)
        values = layer_channels(maps) - (2 if "normal" in maps else 0)  # a height instead of normals
        self.mesh_maps, self.random_fields, self.labels = mesh_maps, random_fields, labels
        self.maps, self.channels = maps, channel_slices(maps)
        read = self.inputs + random_fields + (0 if refined is None else layer_channels(maps))
        self.first = nn.Conv2d(read, width, kernel, bias=_biased(norm))
        widths = [width << depth for depth in range(downsamplings + 1)]
        steps = list(itertools.pairwise(widths))
        self.down = nn.Sequential(*(_conv(coarse, deep, 3, norm, stride=2) for coarse, deep in steps))
        self.blocks = nn.ModuleList(ResidualBlock(widths[-1], norm) for _ in range(blocks))
        self.up = nn.ModuleList(_up(deep, coarse, norm, upsampling) for coarse, deep in reversed(steps))
        self.mix = nn.ModuleList(_conv(coarse, coarse, 3, norm) for coarse, _ in reversed(steps)) if skips else None
        self.last = PreActConv(nn.Conv2d(width, values, kernel), norm, pad=kernel // 2)
        code = labels + (_NUMBERS if random_fields else 0)
        # of the blocks, of each `up` and the `mix` that follows it, and of `last`, in their order
        inputs = widths[-1:] * (2 * blocks + 1)
        for coarse in reversed(widths[:-1]):
            inputs += (2 if skips else 1) * [coarse]
        self.modulation = Modulation(code, inputs) if code else None

    @property
    def inputs(self) -> int:
        """Channels of the geometry that it reads."""
        return GEOMETRY_CHANNELS + MESH_MAPS * self.mesh_maps

    @property
    def multiple(self) -> int:
        """What the rows and the columns of its input are multiples of."""
        return 1 << len(self.down)

    @property
    def reach(self) -> int:
        """How many texels away the input may change the layer, under local norms."""
        ends = self.first.kernel_size[0] // 2 + self.last.pad
        halved = self.multiple - 1  # the sum of a texel of each resolution but the blocks'
        relief = 1 + (0 if self.refined is None else FINE_REACH)
        # each is convolved on the way down, once or twice on the way up, and aligned to the next on both ways
        return ends + 5 * halved + 2 * len(self.blocks) * self.multiple + relief

    @property
    def varies(self) -> bool:
        """Whether it paints different layers on one geometry."""
        return self.modulation is not None

    def start_refining(self) -> None:
        """Makes the layer that of the refined generator."""
        nn.init.zeros_(self.last.convolve.weight)
        if self.last.convolve.bias is not None:
            nn.init.zeros_(self.last.convolve.bias)

    def paint(
        self,
        inputs: Inputs,
        seeds: Int[Tensor, " batch"] | None = None,
        labels: Float[Tensor, "batch labels"] | None = None,
    ) -> Float[Tensor, "batch rows cols channels"]:
        """The layers on the surfaces of a batch; see `forward`.

        Args:
            inputs: with wholes if it refines layers.
        """
        beneath = None
        if self.refined is not None:
            assert inputs.wholes is not None
            whole = self.refined_layers(inputs.wholes.geometry[inputs.wholes.of], seeds, labels)
            beneath = window_of(whole, inputs.wholes.place, *inputs.geometry.shape[2:])
        return self(inputs.geometry, seeds, labels, beneath=beneath)

    def refined_layers(
        self,
        geometry: Float[Tensor, "batch inputs rows cols"],
        seeds: Int[Tensor, " batch"] | None,
        labels: Float[Tensor, "batch labels"] | None,
    ) -> Float[Tensor, "batch rows cols channels"]:
        """The layers on whole maps that this generator refines, of the same seeds and labels; without gradients."""
        assert self.refined is not None
        with torch.no_grad():
            layers: Tensor = self.refined(geometry, seeds, labels)
        return layers.float()

    def forward(
        self,
        geometry: Float[Tensor, "batch inputs rows cols"],
        seeds: Int[Tensor, " batch"] | None = None,
        labels: Float[Tensor, "batch labels"] | None = None,
        factor: int = 1,
        side: int | None = None,
        beneath: Float[Tensor, "batch rows cols channels"] | None = None,
    ) -> Float[Tensor, "batch fine_rows fine_cols channels"]:
        """The values of layers (`Layer`) that paint `maps`: in (0, 1), but normals, which are unit vectors.

        Rows and columns must be multiples of `multiple`, and at least four times that. Where the last convolution gives
        0, metallic is 0.05. Normals are those of a height that it gives (`relief_normals`).

        Args:
            geometry: position and normal (`GeometryBuffer.network_input`), then mesh maps if it reads them.
            seeds: of each layer's random fields, at least 0; needed if there are any.
            labels: of each layer; needed if there are any.
            factor: the layer has this many times the rows and columns of the geometry, and patterns of the same scale
                (`PreActConv.finer`). Only the last convolution runs at that resolution, so memory hardly grows.
            side: rows of the geometries that it was trained on, if these are others; normals go by it.
            beneath: what it refines, at the geometry's texels; needed if it refines layers.
        """
        affine, position = self._affine(seeds, labels), geometry[:, :3]
        if self.random_fields:
            assert seeds is not None
            geometry = torch.cat([geometry, random_fields(position, seeds, self.random_fields)], dim=1)
        if beneath is not None:
            geometry = torch.cat([geometry, beneath.permute(0, 3, 1, 2)], dim=1)
        x: Tensor = self.first(norm_act_pad(geometry, NormActPad(pad=self.first.kernel_size[0] // 2)).padded)
        passed = []
        for down in self.down:
            passed.append(x)
            x = down(x)
        residual: Residual = None
        for block in self.blocks:
            x, residual = block(x, residual, (next(affine), next(affine)))
        for number, up in enumerate(self.up):
            x, residual = up(x, residual, next(affine)), None
            if self.mix is not None:
                x = self.mix[number](x + passed.pop(), None, next(affine))
        # `finer` with a factor of 1 gives the same, but not as one fused operation
        x = self.last(x, None, next(affine)) if factor == 1 else self.last.finer(x, factor, next(affine))
        x = x.float()
        normal = self.channels.get("normal")
        if beneath is not None:
            beneath = F.interpolate(beneath.permute(0, 3, 1, 2), scale_factor=factor, mode="bilinear")
            plain = x.shape[1] if normal is None else normal.start
            x = torch.cat([x[:, :plain] + torch.logit(beneath[:, :plain], _LEAST), x[:, plain:]], dim=1)
        elif (metallic := self.channels.get("metallic")) is not None:
            start = x.new_zeros(x.shape[1], 1, 1)
            start[metallic] = _NO_METAL
            x = x + start
        layer = torch.sigmoid(x).permute(0, 2, 3, 1)
        if normal is None:
            return layer
        fine = position if factor == 1 else F.interpolate(position, scale_factor=factor, mode="bilinear")
        texels = factor * (side or max(geometry.shape[2:]))
        height = _HEIGHT * x[:, normal.start]
        normals = relief_normals(height if beneath is None else fine_relief(height, factor), fine, texels)
        if beneath is not None:
            normals = _with_slopes_of(normals, beneath[:, normal].permute(0, 2, 3, 1))
        return torch.cat([layer[..., : normal.start], normals], dim=-1)

    def _affine(self, seeds: Tensor | None, labels: Tensor | None) -> Iterator[Affine | None]:
        """The modulation of each modulated convolution, in order; None without end if there is none."""
        if self.modulation is None:
            return itertools.repeat(None)
        code = []
        if self.labels:
            assert labels is not None
            code.append(labels)
        if self.random_fields:
            assert seeds is not None
            code.append(random_numbers(seeds, _NUMBERS))
        return iter(self.modulation(torch.cat(code, dim=1)))


class PreActConv(nn.Module):
    """A convolution that first normalises, activates, upsamples and pads its input, as `NormActPad` says.

    The norm belongs to the convolution that reads, not to the one that writes, so that it fuses with the padding.

    Args:
        convolve: the convolution itself, without padding.
        norm: of the input.
    """

    def __init__(self, convolve: nn.Conv2d | nn.ConvTranspose2d, norm: Norm, pad: int = 0, upsample: int = 1) -> None:
        super().__init__()
        self.pad, self.upsample, self.fused = pad, upsample, norm == "instance"
        self.norm = nn.Identity() if self.fused else make_norm(convolve.in_channels, norm)
        self.convolve = convolve

    def forward(
        self, x: Float[Tensor, "batch inputs rows cols"], residual: Residual = None, affine: Affine | None = None
    ) -> Tensor:
        convolved: Tensor = self.convolve(self.activate(x, residual, affine).padded)
        return convolved

    def finer(
        self, x: Float[Tensor, "batch inputs rows cols"], factor: int, affine: Affine | None = None
    ) -> Float[Tensor, "batch outputs fine_rows fine_cols"]:
        """The result of `forward` at `factor` times the resolution and with the scale of `x`; without upsampling.

        The normalised input is interpolated, then rectified and convolved with taps that stay a texel of `x` apart. So
        edges, which the activation and the layer's range make, are sharper than those of an interpolated result. At the
        centres of `x`'s texels the result is that of `forward`. All other features keep their resolution, because
        strided convolutions and doubling do not commute with shifts of a part of a texel: computed for each such shift
        alone, layers show a grid with the period of a texel.
        """
        padded = norm_act_pad(self.norm(x), NormActPad(norm=self.fused, pad=self.pad + 1), affine=affine).padded
        shifts = [(2 * place + 1 - factor) / (2 * factor) for place in range(factor)]
        phases = []  # one at a time, so that wide features are never held at the finer resolution
        for down in shifts:
            rows = _shifted(padded, down, dim=2)
            for right in shifts:
                phases.append(self.convolve(F.relu(_shifted(rows, right, dim=3))))
        return F.pixel_shuffle(torch.stack(phases, dim=2).flatten(1, 2), factor)

    def activate(
        self, x: Float[Tensor, "batch inputs rows cols"], residual: Residual = None, affine: Affine | None = None
    ) -> Features:
        """The convolution's input. A sum with a residual is not rectified (He et al. 2016)."""
        spec = NormActPad(norm=self.fused, relu=residual is None, upsample=self.upsample, pad=self.pad)
        return norm_act_pad(self.norm(x), spec, residual, affine)


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions (He et al. 2016). The consumer applies the norm and adds the skip connection."""

    def __init__(self, channels: int, norm: Norm) -> None:
        super().__init__()
        self.first = _conv(channels, channels, 3, norm)
        self.second = _conv(channels, channels, 3, norm)

    def forward(
        self,
        x: Float[Tensor, "batch channels h w"],
        residual: Residual,
        affine: tuple[Affine | None, Affine | None] = (None, None),
    ) -> tuple[Float[Tensor, "batch channels h w"], Residual]:
        """The output of the second convolution, and the skip connection to add to its norm.

        Args:
            affine: what modulates the input of each convolution.
        """
        padded, features = self.first.activate(x, residual, affine[0])
        return self.second(self.first.convolve(padded), None, affine[1]), features


def _with_slopes_of(normals: Float[Tensor, "*shape 3"], others: Float[Tensor, "*shape 3"]) -> Float[Tensor, "*shape 3"]:
    """Unit normals of a surface whose height is the sum of both."""
    slopes = normals[..., :2] / normals[..., 2:] + others[..., :2] / others[..., 2:].clamp(min=_LEAST_SLANT)
    return F.normalize(torch.cat([slopes, torch.ones_like(slopes[..., :1])], dim=-1), dim=-1)


def _shifted(x: Float[Tensor, "*shape"], shift: float, dim: int) -> Float[Tensor, "*shape"]:
    """Linear interpolation `shift` texels (-1 to 1) further along an axis; the axis loses a texel at both ends."""
    inner = x.shape[dim] - 2
    return torch.lerp(x.narrow(dim, 1, inner), x.narrow(dim, 2 if shift > 0 else 0, inner), abs(shift))


def _conv(inputs: int, outputs: int, size: int, norm: Norm, stride: int = 1, upsample: int = 1) -> PreActConv:
    convolve = nn.Conv2d(inputs, outputs, size, stride, bias=_biased(norm))
    return PreActConv(convolve, norm, pad=size // 2, upsample=upsample)


def _up(inputs: int, outputs: int, norm: Norm, upsampling: Upsampling) -> PreActConv:
    if upsampling == "nearest":
        return _conv(inputs, outputs, 3, norm, upsample=2)
    convolve = nn.ConvTranspose2d(inputs, outputs, 3, stride=2, padding=1, output_padding=1, bias=_biased(norm))
    return PreActConv(convolve, norm)


def _biased(norm: Norm) -> bool:
    return norm != "instance"  # an instance norm subtracts any bias again
