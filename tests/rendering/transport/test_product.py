"""Every implementation of the product against the dense matrix, in float64."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import pytest
import torch

from svbrdfgan.rendering.transport.csr import CsrProduct
from svbrdfgan.rendering.transport.light_transport import LightTransport
from svbrdfgan.rendering.transport.product import Product, ReferenceProduct, TransportBatch

CUDA = torch.cuda.is_available()
INTERPRETED = os.environ.get("TRITON_INTERPRET") == "1"  # Triton's own interpreter runs kernels on the CPU
PRODUCTS: dict[str, tuple[str, Callable[..., Product]]] = {
    "csr": ("cpu", CsrProduct),
    "reference": ("cpu", ReferenceProduct),
}
if CUDA:
    PRODUCTS["reference on CUDA"] = ("cuda", ReferenceProduct)
if (CUDA or INTERPRETED) and importlib.util.find_spec("triton"):
    from svbrdfgan.rendering.transport import kernels as triton_kernels

    def kernels(transports: tuple[LightTransport, ...], channels: int) -> Product:
        """Gradients summed in three or four channels; the latter also where no instruction adds four at once."""
        return replace(triton_kernels.TritonProduct.of(transports), channels=channels)

    for channels in (3, 4):
        place = "cuda" if CUDA and not INTERPRETED else "cpu"
        PRODUCTS[f"kernels, {channels} channels"] = (place, partial(kernels, channels=channels))

Make = Callable[..., LightTransport]


def dense(transport: LightTransport) -> torch.Tensor:
    """T, as (channel, pixel, texel)."""
    matrix = torch.zeros(3, len(transport.start) - 1, transport.texels, dtype=torch.float64)
    for pixel, (first, last) in enumerate(zip(transport.start[:-1], transport.start[1:], strict=True)):
        texel = transport.texel[first:last].long()
        matrix[:, pixel, texel] = transport.weight[first:last].double().T * transport.scale.double()
    return matrix


def expected(transports: list[LightTransport], texels: torch.Tensor) -> torch.Tensor:
    own = texels.double().split([t.texels for t in transports])
    products = [torch.einsum("cpt,tc->pc", dense(t), x) for t, x in zip(transports, own, strict=True)]
    return torch.cat([t.background.double().reshape(-1, 3) + p for t, p in zip(transports, products, strict=True)])


def expected_transposed(transports: list[LightTransport], grad: torch.Tensor) -> torch.Tensor:
    own = grad.double().chunk(len(transports))
    return torch.cat([torch.einsum("cpt,pc->tc", dense(t), g) for t, g in zip(transports, own, strict=True)])


def several(make: Make, precision: str) -> list[LightTransport]:
    """Views of one, three and no textures, and one of the first's texture again, dimmer."""
    made = [make(0, parts=1), make(1, parts=3), make(2, parts=0), make(3, parts=1, scale=1e-3)]
    if precision == "single":
        return made
    return [t.half() if precision == "half" or n % 2 else t for n, t in enumerate(made)]


@pytest.mark.parametrize("precision", ["single", "half", "mixed"])
@pytest.mark.parametrize("name", PRODUCTS)
def test_product_and_transpose_are_those_of_the_dense_matrix(make_transport: Make, name: str, precision: str) -> None:
    device, make_product = PRODUCTS[name]
    transports = several(make_transport, precision)
    computed = make_product(tuple(t.to(device) for t in transports))
    rng = torch.Generator().manual_seed(5)
    texels = torch.rand(sum(t.texels for t in transports), 3, generator=rng)
    grad = torch.randn(sum(t.coverage.numel() for t in transports), 3, generator=rng)
    pictures, gradient = computed.picture(texels.to(device)), computed.transposed(grad.to(device))
    alone = expected([replace(t, background=torch.zeros_like(t.background)) for t in transports], texels)
    torch.testing.assert_close(pictures.cpu(), expected(transports, texels).float(), rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(computed.linear(texels.to(device)).cpu(), alone.float(), rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(gradient.cpu(), expected_transposed(transports, grad).float(), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("name", [name for name in PRODUCTS if name.startswith("kernels")])
def test_a_program_takes_any_number_of_pixels_and_entries(
    make_transport: Make, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Rows that end with a program's pixels or not, and fill its lanes many times."""
    device, make_product = PRODUCTS[name]
    transports = [make_transport(n, parts=3, longest=140) for n in range(2)]
    rng = torch.Generator().manual_seed(6)
    texels, grad = torch.rand(288, 3, generator=rng), torch.randn(126, 3, generator=rng)
    picture, gradient = expected(transports, texels).float(), expected_transposed(transports, grad).float()
    computed = make_product(tuple(t.to(device) for t in transports))
    for pixels, entries in ((1, 64), (4, 16), (64, 64)):
        tile = {"HALVINGS": pixels.bit_length() - 1, "ENTRIES": entries, "num_warps": 2}
        monkeypatch.setattr(triton_kernels, "TRANSPOSED", tile)
        monkeypatch.setattr(triton_kernels, "PICTURE", {"ROWS": pixels, "LANES": entries // 8, "num_warps": 2})
        torch.testing.assert_close(computed.picture(texels.to(device)).cpu(), picture, rtol=1e-5, atol=1e-5)
        torch.testing.assert_close(computed.transposed(grad.to(device)).cpu(), gradient, rtol=1e-5, atol=1e-5)


DEVICES = ("cpu", "cuda") if CUDA else ("cpu",)


@pytest.fixture(params=DEVICES)
def device(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def batch_of(make: Make, device: str, count: int = 2) -> tuple[list[LightTransport], TransportBatch]:
    transports = [make(n, parts=2) for n in range(count)]
    return transports, TransportBatch.stack([t.to(device) for t in transports])


def test_render_differentiates_in_textures_of_any_layout_and_precision(make_transport: Make, device: str) -> None:
    transports, batch = batch_of(make_transport, device)
    textures = torch.rand(4, 3, 6, 8, generator=torch.Generator().manual_seed(1)).to(device, torch.bfloat16)
    textures.requires_grad_()
    shown = batch.render(textures.permute(0, 2, 3, 1))
    texels = textures.detach().cpu().permute(0, 2, 3, 1).reshape(-1, 3)
    torch.testing.assert_close(shown.detach().cpu().reshape(-1, 3), expected(transports, texels).float())
    cotangent = torch.randn(shown.shape, generator=torch.Generator().manual_seed(2))
    shown.backward(cotangent.to(device))
    gradient = expected_transposed(transports, cotangent.reshape(-1, 3)).reshape(4, 6, 8, 3).permute(0, 3, 1, 2)
    assert textures.grad is not None
    torch.testing.assert_close(textures.grad.cpu(), gradient.bfloat16(), rtol=0.02, atol=1e-6)


def test_render_does_not_differentiate_twice(make_transport: Make, device: str) -> None:
    _, batch = batch_of(make_transport, device)
    textures = torch.rand(4, 6, 8, 3, device=device, requires_grad=True)
    (gradient,) = torch.autograd.grad((batch.render(textures) ** 2).sum(), textures, create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        gradient.sum().backward()


def test_a_batch_knows_what_its_views_show(make_transport: Make, device: str) -> None:
    transports = [make_transport(0, parts=2), make_transport(1, parts=3).half()]
    batch = TransportBatch.stack([t.to(device) for t in transports])
    assert batch.owner.tolist() == [0, 0, 1, 1, 1]
    for name in ("coverage", "gbuffer"):
        shown = getattr(batch, name).cpu()
        assert shown.dtype == torch.float32
        assert torch.equal(shown, torch.stack([getattr(t, name).float() for t in transports]))


def test_textures_of_another_shape_are_refused(make_transport: Make) -> None:
    _, batch = batch_of(make_transport, "cpu")
    for shape in ((3, 6, 8, 3), (4, 8, 6, 3), (4, 6, 8, 4)):
        with pytest.raises(ValueError, match=r"the batch needs \(4, 6, 8, 3\)"):
            batch.render(torch.zeros(shape))


def test_views_of_different_sizes_are_no_batch(make_transport: Make) -> None:
    transport = make_transport(0)
    for changed in ({"coverage": torch.zeros(9, 7)}, {"texture_shape": (8, 6)}):
        with pytest.raises(ValueError, match="one film size and one texture size"):
            TransportBatch.stack([transport, replace(transport, **changed)])  # type: ignore[arg-type]


@pytest.mark.skipif(not CUDA, reason="there is no CUDA device")
def test_deterministic_algorithms_give_the_same_bits(make_transport: Make) -> None:
    before = torch.are_deterministic_algorithms_enabled()
    torch.use_deterministic_algorithms(True)
    try:
        _, batch = batch_of(make_transport, "cuda", 16)
        assert isinstance(batch.product, ReferenceProduct)
        grad = torch.randn(16 * 63, 3, device="cuda")
        first, *others = [batch.product.transposed(grad) for _ in range(5)]
        assert all(torch.equal(first, other) for other in others)
    finally:
        torch.use_deterministic_algorithms(before)
