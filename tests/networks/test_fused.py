"""Fused norm, activation, upsampling and padding: the reference is torch's modules, the kernels are the reference."""

from __future__ import annotations

import copy
import importlib.util
import os
from collections.abc import Callable
from itertools import product
from typing import Any

import pytest
import torch
from torch import Tensor, nn

from svbrdfgan.networks.fused import Affine, Features, NormActPad, norm_act_pad
from svbrdfgan.networks.fused.reference import norm_act_pad_reference as reference
from svbrdfgan.networks.generator import Generator
from svbrdfgan.networks.layers import initialise

CUDA = torch.cuda.is_available()
INTERPRETED = os.environ.get("TRITON_INTERPRET") == "1"  # Triton's own interpreter runs kernels on the CPU
KERNELS = (CUDA or INTERPRETED) and importlib.util.find_spec("triton") is not None
DEVICE = "cuda" if CUDA and not INTERPRETED else "cpu"
SPECS = [NormActPad(bool(n), bool(r), u, p) for n, r, u, p in product((0, 1), (0, 1), (1, 2), (0, 1, 3))]
needs_kernels = pytest.mark.skipif(not KERNELS, reason="there is no CUDA device with Triton")

Implementation = Callable[[Tensor, NormActPad, Tensor | None, Affine | None], Features]


def modules(x: Tensor, spec: NormActPad, residual: Tensor | None, affine: Affine | None = None) -> Features:
    """The composition of torch's own modules."""
    norm = nn.InstanceNorm2d(x.shape[1]) if spec.norm else nn.Identity()
    normed = norm(x)
    if affine is not None:
        scale, shift = affine[:, 0, :, None, None], affine[:, 1, :, None, None]
        normed = torch.addcmul(shift, normed, scale)
    rectified = nn.ReLU()(normed) if spec.relu else normed
    features = rectified if residual is None else residual + rectified
    larger = nn.Sequential(nn.Upsample(scale_factor=spec.upsample), nn.ReflectionPad2d(spec.pad))
    return Features(larger(features), features)


def kernels(x: Tensor, spec: NormActPad, residual: Tensor | None, affine: Affine | None = None) -> Features:
    from svbrdfgan.networks.fused.autograd import norm_act_pad_triton

    return norm_act_pad_triton(x, spec, residual, affine)


def values(shape: tuple[int, ...], seed: int, mean: float = 0.0) -> Tensor:
    made = mean + torch.randn(shape, generator=torch.Generator().manual_seed(seed))
    return made.to(memory_format=torch.channels_last) if len(shape) == 4 else made


def differentiated(
    implementation: Implementation,
    x: Tensor,
    spec: NormActPad,
    residual: Tensor | None,
    used: tuple[bool, bool] = (True, True),
    affine: Affine | None = None,
) -> list[Tensor]:
    """Both results and the gradients of the inputs, for fixed gradients of the results that are used."""
    given = [t if t is None else t.detach().clone().requires_grad_() for t in (x, residual, affine)]
    inputs = [t for t in given if t is not None]
    results = implementation(inputs[0], spec, *given[1:])
    slopes = [values(tuple(result.shape), 7 + n).to(result) for n, result in enumerate(results)]
    pairs = [(r, s) for r, s, is_used in zip(results, slopes, used, strict=True) if is_used]
    gradients = torch.autograd.grad([r for r, _ in pairs], inputs, [s for _, s in pairs])
    return [*(r.detach() for r in results), *gradients]


def assert_same(computed: list[Tensor], expected: list[Tensor], **tolerance: Any) -> None:
    for one, other in zip(computed, expected, strict=True):
        torch.testing.assert_close(one.cpu().double(), other.cpu().double(), **tolerance)


@pytest.mark.parametrize("modulated", [False, True])
@pytest.mark.parametrize("added", [False, True])
@pytest.mark.parametrize("spec", SPECS, ids=str)
def test_the_reference_is_the_composition_of_modules(spec: NormActPad, added: bool, modulated: bool) -> None:
    x, residual = values((2, 5, 16, 19), 1, mean=3), values((2, 5, 16, 19), 2) if added else None
    affine, kept = values((2, 2, 5), 3) if modulated else None, x.clone()
    computed, expected = (differentiated(f, x, spec, residual, affine=affine) for f in (reference, modules))
    assert_same(computed, expected, rtol=0, atol=0)
    norm_act_pad(x, spec, residual, affine)
    assert torch.equal(x, kept)


@needs_kernels
@pytest.mark.parametrize("shape", [(2, 5, 16, 19), (1, 24, 17, 9)])
@pytest.mark.parametrize("modulated", [False, True])
@pytest.mark.parametrize("added", [False, True])
@pytest.mark.parametrize("spec", SPECS, ids=str)
def test_kernels_are_the_reference_in_double_precision(
    spec: NormActPad, added: bool, modulated: bool, shape: tuple[int, ...]
) -> None:
    x, residual = values(shape, 1, mean=3), values(shape, 2) if added else None
    affine = values((shape[0], 2, shape[1]), 3) if modulated else None
    expected, computed = (
        differentiated(
            implementation,
            x.to(target),
            spec,
            None if residual is None else residual.to(target),
            affine=None if affine is None else affine.to(target),
        )
        for implementation, target in ((reference, torch.float64), (kernels, DEVICE))
    )
    assert_same(computed, expected, rtol=1e-4, atol=1e-5)


@needs_kernels
@pytest.mark.parametrize("used", [(True, False), (False, True)])
def test_either_result_may_go_unused(used: tuple[bool, bool]) -> None:
    x, residual, spec = values((2, 8, 16, 16), 1), values((2, 8, 16, 16), 2), NormActPad(True, False, 2, 1)
    expected = differentiated(reference, x.double(), spec, residual.double(), used)
    assert_same(differentiated(kernels, x.to(DEVICE), spec, residual.to(DEVICE), used), expected, rtol=1e-4, atol=1e-5)


@needs_kernels
@pytest.mark.parametrize("layout", ["rows first", "inside a padded one", "every second"])
def test_kernels_take_any_layout(layout: str) -> None:
    def laid_out(tensor: Tensor) -> Tensor:
        if layout == "rows first":
            return tensor.contiguous()
        wide = (
            nn.functional.pad(tensor, (1,) * 4)
            if layout == "inside a padded one"
            else nn.Upsample(scale_factor=2)(tensor)
        )
        wide = wide.contiguous(memory_format=torch.channels_last)
        return wide[..., 1:-1, 1:-1] if layout == "inside a padded one" else wide[..., ::2, ::2]

    x, residual = values((2, 8, 16, 16), 1).to(DEVICE), values((2, 8, 16, 16), 2).to(DEVICE)
    for spec in (NormActPad(True, True, 1, 1), NormActPad(False, True, 2, 3)):
        given, expected = kernels(laid_out(x), spec, laid_out(residual)), reference(x, spec, residual)
        assert_same(list(given), list(expected), rtol=1e-4, atol=1e-5)


@needs_kernels
def test_moments_are_safe_far_from_zero() -> None:
    """Sums of squares would lose most digits of a variance of 1 beside a mean of 1,000."""
    x = values((1, 4, 64, 48), 1, mean=1e3)
    expected = reference(x.double(), NormActPad(norm=True), None).padded
    torch.testing.assert_close(
        kernels(x.to(DEVICE), NormActPad(norm=True), None).padded.cpu().double(), expected, rtol=0, atol=1e-3
    )


@needs_kernels
def test_half_precision_is_rounded_once() -> None:
    x, residual = values((2, 8, 16, 16), 1).bfloat16(), values((2, 8, 16, 16), 2).bfloat16()
    spec = NormActPad(True, False, 1, 1)
    computed = differentiated(kernels, x.to(DEVICE), spec, residual.to(DEVICE))
    assert all(t.dtype == torch.bfloat16 for t in computed)
    expected = reference(x.double(), spec, residual.double()).padded
    unit = 2**-7 if INTERPRETED else 2**-8  # the interpreter cuts off where a device rounds
    torch.testing.assert_close(computed[0].cpu().double(), expected, rtol=unit, atol=1e-6)


@needs_kernels
def test_autocast_decides_the_precision() -> None:
    x = values((1, 8, 16, 16), 1).to(DEVICE).requires_grad_()
    with torch.autocast(DEVICE, torch.bfloat16):
        padded = kernels(x, NormActPad(True, True, 1, 1), None).padded
    assert padded.dtype == torch.bfloat16
    assert padded.is_contiguous(memory_format=torch.channels_last)
    (gradient,) = torch.autograd.grad(padded.sum(), x)
    assert gradient.dtype == torch.float32


@needs_kernels
def test_what_is_not_a_number_stays_visible() -> None:
    x = values((1, 4, 16, 16), 1)
    x[0, 1, 3, 3] = torch.nan
    for norm in (False, True):
        assert kernels(x.to(DEVICE), NormActPad(norm, True, 1, 1), None).padded[0, 1].isnan().any()


@needs_kernels
def test_kernels_do_not_differentiate_twice() -> None:
    x = values((1, 4, 16, 16), 1).to(DEVICE).requires_grad_()
    (gradient,) = torch.autograd.grad((kernels(x, NormActPad(True), None).padded ** 2).sum(), x, create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        gradient.sum().backward()


@needs_kernels
def test_kernels_give_the_same_bits_again() -> None:
    x, spec = values((2, 8, 32, 32), 1).to(DEVICE), NormActPad(True, True, 2, 1)
    first, *others = [differentiated(kernels, x, spec, None) for _ in range(3)]
    assert all(torch.equal(a, b) for other in others for a, b in zip(first, other, strict=True))


@needs_kernels
@pytest.mark.parametrize("norm", ["instance", "group", "pixel", "none"])
@pytest.mark.parametrize("upsampling", ["nearest", "strided"])
def test_a_generator_learns_the_same_by_either(norm: str, upsampling: str, monkeypatch: pytest.MonkeyPatch) -> None:
    network = Generator(width=4, blocks=2, norm=norm, upsampling=upsampling, labels=2)  # type: ignore[arg-type]
    initialise(network, torch.Generator().manual_seed(1))
    assert network.modulation is not None
    nn.init.normal_(network.modulation.weight, 0.0, 0.02, generator=torch.Generator().manual_seed(2))
    monkeypatch.setattr(torch.backends.cudnn, "allow_tf32", False)
    geometry, labels = values((2, 6, 16, 20), 1), values((2, 2), 3)
    found = []
    for implementation, made in ((kernels, network.to(DEVICE)), (reference, copy.deepcopy(network).cpu().double())):
        monkeypatch.setattr("svbrdfgan.networks.generator.norm_act_pad", with_optional_residual(implementation))
        inputs = (geometry.to(next(made.parameters())), None, labels.to(next(made.parameters())))
        layer = made.to(memory_format=torch.channels_last)(*inputs)  # type: ignore[call-overload]
        slope = values(tuple(layer.shape), 2).to(layer)
        found.append([layer.detach(), *torch.autograd.grad(layer, list(made.parameters()), slope)])
    assert_same(*found, rtol=1e-3, atol=1e-4)


def with_optional_residual(implementation: Implementation) -> Callable[..., Features]:
    return lambda x, spec, residual=None, affine=None: implementation(x, spec, residual, affine)
