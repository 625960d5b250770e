"""The arithmetic of whole materials in float32, against the formulas of `docs/conventions.md` in float64."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import pytest
import torch
import warp as wp
from svbrdfgan_warp import WarpRenderer, bsdf
from svbrdfgan_warp.bsdf import SurfaceMaterial
from svbrdfgan_warp.device import choose_device, launch
from svbrdfgan_warp.frame import Frame, bent_normal, bent_normal_vjp
from svbrdfgan_warp.light_records import LightRecords
from svbrdfgan_warp.material_pass import MaterialPass
from svbrdfgan_warp.materials import PackedMaps
from torch import Tensor

from svbrdfgan.testing import scenes
from svbrdfgan.types import Camera, Material, Materials, View

COUNT = 4096
ALL = frozenset({"base_color", "roughness", "metallic", "normal"})


@wp.struct
class Points:
    """Materials in the frame of the axes, and random numbers, one for each point."""

    normal: wp.array(dtype=wp.vec3)
    outgoing: wp.array(dtype=wp.vec3)
    maps: wp.array(dtype=wp.vec3)  # roughness, metallic, and whether it is glossy
    base_color: wp.array(dtype=wp.vec3)
    random: wp.array(dtype=wp.vec2)


@wp.func
def material_of(points: Points, i: int):
    material = SurfaceMaterial()
    material.normal = points.normal[i]
    material.base_color = points.base_color[i]
    if points.maps[i][2] > 0.0:
        material.alpha2 = bsdf.alpha2_of(points.maps[i][0])
        material.metallic = points.maps[i][1]
    return material


@wp.kernel
def sampled(points: Points, incoming: wp.array(dtype=wp.vec3)):
    i = wp.tid()
    incoming[i] = bsdf.sample(material_of(points, i), points.outgoing[i], points.random[i][0], points.random[i][1])


@wp.kernel
def evaluated(
    points: Points,
    incoming: wp.array(dtype=wp.vec3),
    grad: wp.array(dtype=wp.vec3),
    value: wp.array(dtype=wp.vec3),
    density: wp.array(dtype=wp.float32),
    gradient: wp.array2d(dtype=wp.vec3),
):
    i = wp.tid()
    material = material_of(points, i)
    value[i] = bsdf.value(material, points.outgoing[i], incoming[i])
    density[i] = bsdf.density(material, points.outgoing[i], incoming[i])
    g = bsdf.value_vjp(material, points.outgoing[i], incoming[i], grad[i])
    gradient[i, 0] = g.normal
    gradient[i, 1] = g.base_color
    gradient[i, 2] = wp.vec3(g.alpha2 * bsdf.alpha2_slope(points.maps[i][0]), g.metallic, 0.0)


@wp.kernel
def bent(
    outgoing: wp.array(dtype=wp.vec3),
    mapped: wp.array(dtype=wp.vec3),
    grad: wp.array(dtype=wp.vec3),
    normal: wp.array(dtype=wp.vec3),
    gradient: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    frame = Frame()
    frame.tangent = wp.vec3(1.0, 0.0, 0.0)
    frame.bitangent = wp.vec3(0.0, 1.0, 0.0)
    frame.normal = wp.vec3(0.0, 0.0, 1.0)
    frame.outgoing = outgoing[i]
    normal[i] = bent_normal(frame, mapped[i])
    gradient[i] = bent_normal_vjp(frame, mapped[i], grad[i])


def unit(vectors: Tensor) -> Tensor:
    return vectors / vectors.norm(dim=-1, keepdim=True)


def upper(count: int, least: float, generator: torch.Generator) -> Tensor:
    """Unit vectors whose z is uniform from `least` to 1."""
    z = least + (1.0 - least) * torch.rand(count, generator=generator)
    angle = 2.0 * math.pi * torch.rand(count, generator=generator)
    radius = (1.0 - z * z).clamp_min(0.0).sqrt()
    return torch.stack([radius * angle.cos(), radius * angle.sin(), z], dim=-1)


def normal_of(mapped: Tensor, outgoing: Tensor) -> Tensor:
    """The bent normal where N is +Z, in any precision."""
    n, north = unit(mapped), torch.tensor([0.0, 0.0, 1.0], dtype=mapped.dtype)
    a, b, c = n[:, 2], outgoing[:, 2], (n * outgoing).sum(dim=-1)
    excess = (b - 2.0 * a * c).clamp_min(0.0)
    k = excess / (a + (a * a + b * excess).sqrt())
    assert north.dtype == mapped.dtype
    return unit(n + k[:, None] * outgoing)


def value_of(n: Tensor, base_color: Tensor, maps: Tensor, outgoing: Tensor, incoming: Tensor) -> Tensor:
    """The BSDF times the cosine, from the formulas as the conventions write them."""
    roughness, metallic, glossy = maps.unbind(dim=-1)
    alpha = roughness.clamp_min(0.05) ** 2
    h = unit(outgoing + incoming)
    cosine_i, cosine_o, cosine_h = ((n * d).sum(dim=-1) for d in (incoming, outgoing, h))
    p = (1.0 - (outgoing * h).sum(dim=-1)) ** 5
    distribution = alpha**2 / (math.pi * (cosine_h**2 * (alpha**2 - 1.0) + 1.0) ** 2)
    g = [2.0 * c / (c + (alpha**2 + (1.0 - alpha**2) * c**2).sqrt()) for c in (cosine_i, cosine_o)]
    s = distribution * g[0] * g[1] / (4.0 * cosine_i * cosine_o)
    f_d = 0.04 + 0.96 * p
    f_m = base_color + (1.0 - base_color) * p[:, None]
    mixed = ((1.0 - f_d)[:, None] * base_color / math.pi + (f_d * s)[:, None]) * (1.0 - metallic)[:, None]
    mixed = mixed + f_m * (metallic * s)[:, None]
    return torch.where(glossy[:, None] > 0.0, mixed, base_color / math.pi) * cosine_i[:, None]


class Case:
    """Points with random directions, most of them in the gloss's lobe, and what the kernels say of them."""

    def __init__(self, device: str, roughness: float | None, metallic: float = 0.3, outgoing: Tensor | None = None):
        generator = torch.Generator().manual_seed(3)
        self.device = choose_device(device)
        count = COUNT if outgoing is None else len(outgoing)
        self.outgoing = upper(count, 0.05, generator) if outgoing is None else outgoing
        self.mapped = torch.tensor([0.0, 0.0, 1.0]) + 0.2 * torch.randn((count, 3), generator=generator)
        self.normal = normal_of(self.mapped.double(), self.outgoing.double()).float()
        if outgoing is not None:
            self.normal = torch.tensor([0.0, 0.0, 1.0]).repeat(count, 1)
        self.base_color = torch.rand((count, 3), generator=generator)
        glossy = 0.0 if roughness is None else 1.0
        self.maps = torch.tensor([roughness or 0.0, metallic, glossy]).repeat(count, 1)
        self.random = torch.rand((count, 2), generator=generator)
        self.grad = torch.randn((count, 3), generator=generator)
        self.incoming = self._run(sampled, torch.empty(count, 3))[0]

    def evaluate(self, incoming: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Value, density, and the gradients for (normal, base colour, (roughness, metallic, -))."""
        count = len(incoming)
        given = (self._array(incoming), self._array(self.grad[:count]))
        results = torch.empty(count, 3), torch.empty(count), torch.empty(count, 3, 3)
        value, density, gradient = self._run(evaluated, *results, given=given)
        return value, density, gradient

    def _run(self, kernel: Any, *results: Tensor, given: tuple[Any, ...] = ()) -> list[Tensor]:
        points: Any = Points()
        for name in ("normal", "outgoing", "maps", "base_color"):
            setattr(points, name, self._array(getattr(self, name)))
        points.random = wp.from_torch(self.random.to(self.device), wp.vec2)
        held = [result.to(self.device) for result in results]
        arrays = [wp.from_torch(h) if h.ndim == 1 else wp.from_torch(h, wp.vec3) for h in held]
        launch(kernel, len(held[0]), (points, *given, *arrays), self.device)
        return [h.cpu() for h in held]

    def _array(self, values: Tensor) -> Any:
        return wp.from_torch(values.to(self.device).contiguous(), wp.vec3)

    def in_front(self) -> Tensor:
        """The points whose drawn direction lies in front of the surface."""
        return (self.normal * self.incoming).sum(dim=-1) > 1e-3


KINDS = [(None, 0.0), (0.05, 0.3), (0.05, 1.0), (0.2, 0.5), (0.6, 0.0), (1.0, 1.0), (0.0, 0.5)]


@pytest.mark.parametrize(("roughness", "metallic"), KINDS)
def test_values_and_derivatives_are_those_of_the_formulas(device: str, roughness: float, metallic: float) -> None:
    case = Case(device, roughness, metallic)
    value, _, gradient = case.evaluate(case.incoming)
    use = case.in_front()
    assert use.float().mean() > 0.5
    normal, base_color, maps = (t.double().requires_grad_() for t in (case.normal, case.base_color, case.maps))
    directions = unit(case.outgoing.double()), unit(case.incoming.double())
    wanted = value_of(unit(normal), base_color, maps, *directions)
    (wanted * case.grad.double())[use].sum().backward()
    error = (value - wanted).abs()[use] / (wanted.abs()[use] + 1e-4)
    assert error.max() < 3e-3  # at alpha 0.0025, the rounding of the directions themselves
    assert error.mean() < 1e-4
    assert normal.grad is not None
    assert base_color.grad is not None
    assert maps.grad is not None
    found = gradient[:, 0].double()
    found = found - case.normal.double() * (found * case.normal.double()).sum(dim=-1, keepdim=True)
    for mine, true in ((found, normal.grad), (gradient[:, 1], base_color.grad), (gradient[:, 2], maps.grad)):
        for channel in range(3 if true is not maps.grad else 2):
            a, b = mine[use, channel].double(), true[use, channel]
            assert (a - b).abs().mean() <= 3e-4 * b.abs().mean() + 1e-9


@pytest.mark.parametrize(("roughness", "metallic"), [(None, 0.0), (0.3, 0.0), (0.6, 1.0), (1.0, 0.5)])
@pytest.mark.parametrize("cosine", [0.95, 0.4, 0.1])
def test_directions_are_drawn_with_their_density(
    device: str, roughness: float | None, metallic: float, cosine: float
) -> None:
    """The share of directions in each of 8 by 8 bins, beside the integral of the density by the midpoint rule."""
    count, bins, fine = 2**18, 8, 128
    outgoing = torch.tensor([math.sqrt(1.0 - cosine**2), 0.0, cosine])
    case = Case(device, roughness, metallic, outgoing.repeat(count, 1))
    z, angle = case.incoming[:, 2], torch.atan2(case.incoming[:, 1], case.incoming[:, 0])
    place = (z.clamp(0.0, 1.0 - 1e-6) * bins).long() * bins
    place = place + ((angle / (2.0 * math.pi) + 0.5).clamp(0.0, 1.0 - 1e-6) * bins).long()
    seen = torch.bincount(place[z > 0.0], minlength=bins * bins).double() / count
    centre = (torch.arange(bins * fine) + 0.5) / (bins * fine)
    height, turn = (t.reshape(-1) for t in torch.meshgrid(centre, (centre - 0.5) * 2.0 * math.pi, indexing="ij"))
    radius = (1.0 - height**2).sqrt()
    directions = torch.stack([radius * turn.cos(), radius * turn.sin(), height], dim=-1)
    density = torch.cat([case.evaluate(piece)[1] for piece in directions.split(count)])
    steps = density.double().view(bins, fine, bins, fine).sum(dim=(1, 3)) * 2.0 * math.pi / (bins * fine) ** 2
    wanted = steps.reshape(-1)
    error = (wanted * (1.0 - wanted) / count).sqrt()
    assert wanted.sum() <= 1.0 + 1e-3
    assert ((seen - wanted).abs() < 4.5 * error + 1e-3 * wanted + 1e-5).all()


def test_normals_are_bent_until_no_mirror_direction_is_below_the_surface(device: str) -> None:
    generator, where = torch.Generator().manual_seed(1), choose_device(device)
    outgoing = upper(COUNT, 0.0, generator)
    mapped = torch.tensor([0.0, 0.0, 1.0]) + 1.5 * torch.randn((COUNT, 3), generator=generator)
    mapped[:, 2] = mapped[:, 2].abs() + 0.05
    grad = torch.randn((COUNT, 3), generator=generator)
    results = [torch.empty(COUNT, 3, device=where) for _ in range(2)]
    arrays = [wp.from_torch(t.to(where), wp.vec3) for t in (outgoing, mapped, grad)]
    launch(bent, COUNT, (*arrays, *(wp.from_torch(t, wp.vec3) for t in results)), where)
    normal, gradient = (t.cpu().double() for t in results)
    exact = mapped.double().requires_grad_()
    wanted = normal_of(exact, outgoing.double())
    (wanted * grad).sum().backward()
    assert exact.grad is not None
    assert (normal - wanted).abs().max() < 1e-4
    cosine = (normal * outgoing).sum(dim=-1)
    mirrored = 2.0 * cosine * normal[:, 2] - outgoing[:, 2]
    assert mirrored.min() > -1e-5
    assert (mirrored.abs() < 1e-5).float().mean() > 0.2  # many are bent
    assert (gradient - exact.grad).abs().mean() < 1e-4 * exact.grad.abs().mean()


@dataclasses.dataclass(frozen=True)
class Replay:
    """In place of a tracer: the records that were kept, whatever the maps."""

    tracer: Any
    kept: dict[Any, LightRecords]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.tracer, name)

    def __call__(self, chunk: Any, _: Any) -> LightRecords:
        return self.kept[chunk]


def textured() -> Materials:
    """A whole textured material, a constant metal, and rough relief without gloss."""
    generator = torch.Generator().manual_seed(4)

    def random(*shape: int) -> Tensor:
        return 0.25 + 0.5 * torch.rand(shape, generator=generator)

    relief = torch.cat([random(3, 4, 2) - 0.5, torch.ones(3, 4, 1)], dim=-1)
    whole = {"base_color": random(4, 5, 3), "roughness": random(5, 3, 1), "metallic": random(2, 3, 1), "normal": relief}
    metal = {"base_color": random(3), "roughness": torch.tensor([0.4]), "metallic": torch.tensor([1.0])}
    matt = {"base_color": random(2, 2, 3), "normal": torch.tensor([0.2, -0.3, 0.9])}
    return Materials(tuple(Material(maps) for maps in (whole, metal, matt)))


@pytest.fixture
def view() -> View:
    return View(Camera((1.5, 1.2, 1.4), (0.4, 0.4, 0.4)), scenes.random_light(rotation=0.3), 11, 9)


@pytest.mark.parametrize("name", sorted(ALL))
@pytest.mark.parametrize("part", [0, 1, 2])
def test_gradients_are_those_of_finite_differences_on_the_same_light_samples(
    device: str, view: View, name: str, part: int
) -> None:
    materials, renderer = textured(), WarpRenderer(device)
    if name not in materials[part].maps or (name == "metallic" and part == 1):  # a metal of 1 has no step upward
        name, part = "roughness", 1
    kept = renderer._render_pass(renderer.prepare(scenes.corner_box()), materials, view, ALL, 16, 6)
    assert isinstance(kept, MaterialPass)
    kept.forward(keep=True)
    grad_image = torch.randn((9, 11, 3), generator=torch.Generator().manual_seed(1))
    gradient = kept.backward(grad_image, {name}).materials[part][name].double().cpu()
    step = torch.randn(gradient.shape, generator=torch.Generator().manual_seed(7)).double()

    def loss(length: float) -> float:
        parts = [dict(material.maps) for material in materials.parts]
        parts[part][name] = (parts[part][name].double() + length * step).float()
        maps = PackedMaps.of(Materials(tuple(map(Material, parts))), (False, False), renderer.device)
        again = dataclasses.replace(kept, tracer=Replay(kept.tracer, kept.kept), maps=maps)
        return float((again.forward().image.cpu().double() * grad_image).sum())

    slope = (8.0 * (loss(0.01) - loss(-0.01)) - (loss(0.02) - loss(-0.02))) / 0.12
    assert float((gradient * step).sum()) == pytest.approx(slope, rel=2e-3, abs=2e-3)
    assert abs(slope) > 0.02


def test_the_gradient_of_light_and_colour_is_the_picture_s_transpose(device: str, view: View) -> None:
    """The picture is linear in the environment's radiance on the same directions."""
    renderer, materials = WarpRenderer(device), textured()
    prepared, ones = renderer.prepare(scenes.corner_box()), torch.ones(9, 11, 3)
    image, pullback = renderer.render_pullback(prepared, materials, view, wrt=ALL | {"environment"}, spp=16, seed=5)
    kept, traced = (
        pullback(ones),
        renderer.render_vjp(prepared, materials, view, ones, wrt=ALL | {"environment"}, spp=16, seed=5),
    )
    assert kept.environment is not None
    assert traced.environment is not None
    through = (kept.environment.cpu().double() * view.environment.radiance).sum()
    assert float(through) == pytest.approx(float(image.image.double().sum()), rel=1e-5)
    assert torch.allclose(kept.environment, traced.environment, rtol=1e-6)
    for one, other in zip(kept.materials, traced.materials, strict=True):
        assert one.keys() == other.keys()
        assert all(torch.allclose(one[name], other[name], rtol=1e-5, atol=1e-6) for name in one)


def test_gradients_have_the_shapes_of_the_maps_that_there_are(device: str, view: View) -> None:
    renderer, materials = WarpRenderer(device), textured()
    args = (renderer.prepare(scenes.corner_box()), materials, view, torch.ones(9, 11, 3))
    gradients = renderer.render_vjp(*args, wrt=ALL, spp=1, seed=0)
    for part, material in zip(gradients.materials, materials.parts, strict=True):
        assert {name: value.shape for name, value in part.items()} == {n: m.shape for n, m in material.maps.items()}
    lambertian = renderer.render_vjp(args[0], scenes.lambertian(*[scenes.RED] * 3), *args[2:], wrt=ALL, spp=1, seed=0)
    assert [part.keys() for part in lambertian.materials] == [{"base_color"}] * 3


Change = Callable[[dict[str, Tensor]], dict[str, Tensor]]


@pytest.mark.parametrize(
    "change",
    [
        lambda maps: maps | {"normal": torch.tensor([0.0, 0.0, 0.5])},
        lambda maps: maps | {"metallic": torch.zeros(1)},
        lambda maps: maps | {"roughness": torch.zeros(1), "metallic": torch.full((2, 2, 1), -1.0)},
    ],
    ids=["flat", "no metal", "bounded"],
)
def test_neutral_maps_change_nothing(device: str, view: View, change: Change) -> None:
    renderer, plain = WarpRenderer(device), {"base_color": torch.tensor([0.3, 0.5, 0.7]), "roughness": torch.zeros(1)}
    prepared = renderer.prepare(scenes.corner_box())
    one, other = (
        renderer.render(prepared, Materials((Material(maps),) * 3), view, spp=64, seed=2).image
        for maps in (plain, change(plain))
    )
    assert torch.allclose(one, other, rtol=1e-4, atol=1e-5)


def test_a_lambertian_part_beside_gloss_is_what_it_is_alone(device: str, view: View) -> None:
    """The kernels of whole materials draw the same directions for it as those of base colours."""
    renderer, prepared = WarpRenderer(device), WarpRenderer(device).prepare(scenes.corner_box())
    matt = Material.lambertian(scenes.random_texture(5, 7))
    alone = renderer.render(prepared, Materials((matt,) * 3), view, spp=16, seed=2).image
    flat = Material({**matt.maps, "normal": torch.tensor([0.0, 0.0, 1.0])})
    beside = renderer.render(prepared, Materials((matt, flat, matt)), view, spp=16, seed=2).image
    assert torch.allclose(alone, beside, rtol=1e-4, atol=1e-5)


def test_threads_change_nothing_of_whole_materials(view: View) -> None:
    before, renderer, results = torch.get_num_threads(), WarpRenderer("cpu"), []
    prepared, materials, ones = renderer.prepare(scenes.corner_box()), textured(), torch.ones(9, 11, 3)
    try:
        for threads in (1, 3):
            torch.set_num_threads(threads)
            image = renderer.render(prepared, materials, view, spp=1024, seed=1).image
            grad = renderer.render_vjp(prepared, materials, view, ones, wrt=ALL | {"environment"}, spp=1024, seed=1)
            results.append([image, grad.environment, *(m for part in grad.materials for m in part.values())])
    finally:
        torch.set_num_threads(before)
    assert all(torch.equal(one, three) for one, three in zip(*results, strict=True))
