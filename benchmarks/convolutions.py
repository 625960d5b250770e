"""The time of the networks' convolutions, and of the same with channels padded to multiples of eight.

    python benchmarks/convolutions.py [BATCH]

Pictures of 256x256 at the thesis's widths, by default a batch of 16, bf16, channels last: milliseconds of the forward
pass, and of forward and backward, with the rate at which that multiplies and adds.
"""

from __future__ import annotations

import sys

import torch
import torch.nn.functional as F
from torch.utils.benchmark import Timer

_DEVICE = "cuda" if torch.cuda.is_available() else "cpu"
_SHAPES = [  # inputs, outputs, kernel, stride, pixels with their padding
    ("generator, first", 6, 64, 7, 1, 262),
    ("  of 8 inputs", 8, 64, 7, 1, 262),
    ("  of 16 inputs", 16, 64, 7, 1, 262),
    ("generator, last", 64, 4, 7, 1, 262),
    ("  of 8 outputs", 64, 8, 7, 1, 262),
    ("  of 16 outputs", 64, 16, 7, 1, 262),
    ("generator, down", 64, 128, 3, 2, 257),
    ("generator, block", 256, 256, 3, 1, 66),
    ("generator, up", 256, 128, 3, 1, 130),
    ("generator, up again", 128, 64, 3, 1, 258),
    ("discriminator, first", 9, 64, 4, 2, 258),
    ("  of 16 inputs", 16, 64, 4, 2, 258),
    ("discriminator, last", 512, 1, 4, 1, 33),
    ("  of 8 outputs", 512, 8, 4, 1, 33),
]


def main(batch: int = 16) -> None:
    for name, inputs, outputs, kernel, stride, side in _SHAPES:
        image, weight = (_random(shape) for shape in ((batch, inputs, side, side), (outputs, inputs, kernel, kernel)))

        given = {"conv": F.conv2d, "grad": torch.autograd.grad, "x": image, "w": weight, "s": stride}
        given["g"] = grad = torch.randn_like(F.conv2d(image, weight, stride=stride))
        forward, backward = "conv(x, w, stride=s)", "grad(conv(x, w, stride=s), (x, w), g)"
        one, both = (1e3 * Timer(step, globals=given).blocked_autorange().median for step in (forward, backward))
        flops = 2 * grad.numel() * inputs * kernel**2
        rates = flops / one / 1e9, 3 * flops / both / 1e9
        print(f"{name:22} {one:7.3f} ms {rates[0]:5.0f} TFLOP/s {both:7.3f} ms {rates[1]:5.0f} TFLOP/s", flush=True)


def _random(shape: tuple[int, ...]) -> torch.Tensor:
    values = torch.randn(shape, device=_DEVICE, dtype=torch.bfloat16)
    return values.contiguous(memory_format=torch.channels_last).requires_grad_()


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
