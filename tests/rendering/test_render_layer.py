"""A renderer as a torch function: images and gradients are the renderer's."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import pytest
import torch
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.errors import UnsupportedError
from svbrdfgan.plugins.registry import load_renderer
from svbrdfgan.protocols import Pullback, Renderer
from svbrdfgan.rendering.checked_renderer import CheckedRenderer, PreparedSurface
from svbrdfgan.rendering.render_layer import RenderLayer
from svbrdfgan.rendering.transport.build import build_transport
from svbrdfgan.rendering.transport.product import TransportBatch
from svbrdfgan.types import Environment, Gradients, Material, Materials, Rendering, View

SPP, SEED, TEXELS = 4, 5, 32


@dataclass(frozen=True)
class Stage:
    """A car with glass, its paint textured, before a small camera."""

    renderer: CheckedRenderer
    prepared: PreparedSurface
    view: View
    colors: tuple[Tensor, ...]
    learnable: int
    gbuffer: Tensor
    repeat: tuple[bool, bool]

    def materials(self, changes: dict[int, Tensor]) -> Materials:
        colors = [changes.get(part, color) for part, color in enumerate(self.colors)]
        return Materials(tuple(Material({"base_color": color}) for color in colors))

    def lit(self, radiance: Tensor) -> View:
        return replace(self.view, environment=Environment(radiance, self.view.environment.rotation))


def make_stage(name: str, exemplars: Exemplars, width: int = 12, height: int = 10) -> Stage:
    options = {"device": "cpu"} if name == "warp" else {}
    renderer, subject = load_renderer(name, options), exemplars.subjects[0]
    view = replace(exemplars.loader.view(exemplars.scenes[0]), width=width, height=height)
    (part,) = subject.learnable
    texture = torch.rand(TEXELS, TEXELS, 3, generator=torch.Generator().manual_seed(4))
    colors = tuple(texture if n == part else color for n, color in enumerate(subject.base))
    gbuffer = subject.geometry.permute(1, 2, 0)
    return Stage(renderer, renderer.prepare(subject.surface), view, colors, part, gbuffer, subject.surface.repeat)


@pytest.fixture(scope="module")
def stage(tiny_exemplars: Exemplars) -> Stage:
    return make_stage("numpy", tiny_exemplars)


def random(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def picture(stage: Stage, changes: dict[int, Tensor], view: View | None = None, **layer: Any) -> Tensor:
    render = RenderLayer(stage.renderer, **{"spp": SPP, **layer})
    return render(stage.prepared, stage.materials(changes), view or stage.view, seed=SEED).image


@pytest.mark.parametrize("kind", ["texture", "constant"])
@pytest.mark.parametrize("cotangent_seed", [1, 2])
def test_base_color_against_finite_differences(stage: Stage, kind: str, cotangent_seed: int) -> None:
    start = stage.colors[stage.learnable] if kind == "texture" else torch.tensor([0.5, 0.4, 0.3])
    cotangent, step = random(10, 12, 3, seed=cotangent_seed), 0.05 * random(*start.shape, seed=9)
    color = start.clone().requires_grad_(True)
    picture(stage, {stage.learnable: color}).backward(cotangent)
    forward, backward = (picture(stage, {stage.learnable: start + s * step}).double() for s in (1.0, -1.0))
    slope = float(((forward - backward) * cotangent).sum()) / 2
    assert color.grad is not None
    assert abs(slope) > 1e-4
    assert float((color.grad * step).sum()) == pytest.approx(slope, rel=2e-3)


def test_all_parts_at_once_against_finite_differences(stage: Stage) -> None:
    cotangent = random(10, 12, 3)
    steps = [0.02 * random(*color.shape, seed=n) for n, color in enumerate(stage.colors)]
    leaves = {n: color.clone().requires_grad_(True) for n, color in enumerate(stage.colors)}
    picture(stage, leaves).backward(cotangent)
    moved = [picture(stage, {n: c + s * steps[n] for n, c in enumerate(stage.colors)}).double() for s in (1.0, -1.0)]
    slope = float(((moved[0] - moved[1]) * cotangent).sum()) / 2
    found = sum(float((leaf.grad * steps[n]).sum()) for n, leaf in leaves.items() if leaf.grad is not None)
    assert found == pytest.approx(slope, rel=2e-3)


def test_environment_against_finite_differences(stage: Stage) -> None:
    """Moved between channels: the light's own sampling looks at their mean and stays as it is."""
    start = stage.view.environment.radiance + 0.2
    cotangent, step = random(10, 12, 3), 0.05 * random(*start.shape, seed=5)
    step = step - step.mean(dim=-1, keepdim=True)
    radiance = start.clone().requires_grad_(True)
    picture(stage, {}, stage.lit(radiance)).backward(cotangent)
    forward, backward = (picture(stage, {}, stage.lit(start + s * step)).double() for s in (1.0, -1.0))
    slope = float(((forward - backward) * cotangent).sum()) / 2
    assert radiance.grad is not None
    assert float((radiance.grad * step).sum()) == pytest.approx(slope, rel=5e-3)


def test_gradient_is_that_of_the_picture_itself(stage: Stage) -> None:
    color, cotangent = stage.colors[stage.learnable].clone().requires_grad_(True), random(10, 12, 3)
    picture(stage, {stage.learnable: color}).backward(cotangent)
    exact = stage.renderer.render_vjp(
        stage.prepared, stage.materials({}), stage.view, cotangent,
        wrt=frozenset({"base_color"}), spp=SPP, seed=SEED,
    )  # fmt: skip
    assert torch.equal(color.grad, exact.materials[stage.learnable]["base_color"])


@pytest.mark.full
def test_gradient_of_other_samples_is_unbiased(stage: Stage) -> None:
    """The mean over many seeds lies within four standard errors of a converged gradient."""
    view, cotangent = replace(stage.view, width=4, height=4), torch.ones(4, 4, 3)
    layer, means = RenderLayer(stage.renderer, spp=1, spp_grad=8), []
    for seed in range(24):
        color = torch.full((3,), 0.5, requires_grad=True)
        layer(stage.prepared, stage.materials({stage.learnable: color}), view, seed=seed).image.backward(cotangent)
        means.append(color.grad)
    reference = stage.renderer.render_vjp(
        stage.prepared, stage.materials({stage.learnable: torch.full((3,), 0.5)}), view, cotangent,
        wrt=frozenset({"base_color"}), spp=1024, seed=99,
    ).materials[stage.learnable]["base_color"]  # fmt: skip
    drawn = torch.stack(means)
    error = drawn.std(dim=0) / 24**0.5
    assert ((drawn.mean(dim=0) - reference).abs() < 4 * error + 0.01 * reference).all()
    assert (drawn.std(dim=0) > 0).all()


def test_gradient_of_other_samples_has_its_own_seed(stage: Stage) -> None:
    gradients = []
    for spp_grad in (None, SPP):
        color = stage.colors[stage.learnable].clone().requires_grad_(True)
        picture(stage, {stage.learnable: color}, spp_grad=spp_grad).sum().backward()
        gradients.append(color.grad)
    assert not torch.equal(*gradients)


@pytest.mark.parametrize("name", ["numpy", "warp"])
def test_equals_the_light_transport(name: str, tiny_exemplars: Exemplars) -> None:
    """Image and gradient for the same seed, glass included."""
    if name == "warp":
        pytest.importorskip("warp", reason="the warp renderer needs warp-lang")
    stage = make_stage(name, tiny_exemplars, width=24, height=20)
    transport = build_transport(
        stage.renderer.transport(stage.prepared, stage.view, spp=SPP, seed=SEED),
        materials=stage.materials({}),
        learnable=(stage.learnable,),
        gbuffer=stage.gbuffer,
        view=stage.view,
        spp=SPP,
        repeat=stage.repeat,
    )
    cotangent, images, gradients = random(20, 24, 3), [], []
    for way in ("rendered", "stored"):
        color = stage.colors[stage.learnable].clone().requires_grad_(True)
        if way == "rendered":
            image = picture(stage, {stage.learnable: color})
        else:
            image = TransportBatch.stack([transport]).render(color.unsqueeze(0))[0]
        image.backward(cotangent)
        images.append(image.detach())
        gradients.append(color.grad)
    assert images[0].abs().max() > 0.05
    torch.testing.assert_close(images[1], images[0], rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(gradients[1], gradients[0], rtol=1e-4, atol=1e-4)
    rendering = stage.renderer.render(stage.prepared, stage.materials({}), stage.view, spp=SPP, seed=SEED)
    torch.testing.assert_close(transport.coverage, rendering.coverage, atol=1e-5, rtol=0)
    assert len(stage.colors) > 5
    assert 0 < float(transport.background.abs().sum()) < float(images[0].abs().sum())


@dataclass
class Watched:
    """A plugin that records its calls."""

    inner: Renderer[Any]
    asked: list[frozenset[str]] = field(default_factory=list)

    @property
    def capabilities(self) -> Any:
        return self.inner.capabilities

    @property
    def device(self) -> torch.device:
        return self.inner.device

    def prepare(self, surface: Any) -> Any:
        return self.inner.prepare(surface)

    def render(self, *args: Any, spp: int, seed: int) -> Rendering:
        return self.inner.render(*args, spp=spp, seed=seed)

    def render_vjp(self, *args: Any, wrt: frozenset[str], spp: int, seed: int) -> Gradients:
        self.asked.append(wrt)
        return self.inner.render_vjp(*args, wrt=wrt, spp=spp, seed=seed)


def seen_through(stage: Stage, plugin: Watched) -> Stage:
    """The stage with this plugin behind the core's checks, by the name of the one that prepared the surface."""
    return replace(stage, renderer=replace(stage.renderer, plugin=plugin))


def test_gradients_that_are_not_needed_are_not_requested(stage: Stage) -> None:
    watched = Watched(stage.renderer.plugin)
    under_watch = seen_through(stage, watched)
    assert not picture(under_watch, {}).requires_grad
    color = stage.colors[stage.learnable].clone().requires_grad_(True)
    picture(under_watch, {stage.learnable: color}).sum().backward()
    radiance = stage.view.environment.radiance.clone().requires_grad_(True)
    picture(under_watch, {}, stage.lit(radiance)).sum().backward()
    assert watched.asked == [frozenset({"base_color"}), frozenset({"environment"})]


def test_coverage_carries_no_gradient(stage: Stage) -> None:
    color = stage.colors[stage.learnable].clone().requires_grad_(True)
    rendering = RenderLayer(stage.renderer, SPP)(
        stage.prepared, stage.materials({stage.learnable: color}), stage.view, seed=SEED
    )
    assert rendering.image.requires_grad
    assert not rendering.coverage.requires_grad


def test_double_precision_gets_a_double_gradient(stage: Stage) -> None:
    color = stage.colors[stage.learnable].double().requires_grad_(True)
    picture(stage, {stage.learnable: color}).sum().backward()
    assert color.grad.dtype == torch.float64


@dataclass
class Seeing(Watched):
    """A renderer without gradients."""

    @property
    def capabilities(self) -> Any:
        return replace(self.inner.capabilities, differentiable=frozenset())


def test_gradients_of_maps_that_the_renderer_lacks_are_refused(stage: Stage) -> None:
    blind = seen_through(stage, Seeing(stage.renderer.plugin)).renderer
    rough = torch.tensor([0.5], requires_grad=True)
    parts = list(stage.materials({}).parts)
    parts[0] = Material({"base_color": torch.ones(3), "roughness": rough})
    with pytest.raises(UnsupportedError, match="numpy renderer: it has no gradient for roughness"):
        RenderLayer(blind, SPP)(stage.prepared, Materials(tuple(parts)), stage.view, seed=SEED)


def test_a_missing_gradient_is_refused_before_rendering(stage: Stage) -> None:
    blind = seen_through(stage, Seeing(stage.renderer.plugin))
    color = stage.colors[stage.learnable].clone().requires_grad_(True)
    with pytest.raises(UnsupportedError, match="numpy renderer: it has no gradient for base_color"):
        picture(blind, {stage.learnable: color})
    with torch.no_grad():
        assert picture(blind, {stage.learnable: color}).max() > 0


@dataclass
class Keeping(Watched):
    """A renderer that keeps its samples."""

    pulled: int = 0

    @property
    def capabilities(self) -> Any:
        return replace(self.inner.capabilities, pullback=True)

    def render_pullback(self, *args: Any, wrt: frozenset[str], spp: int, seed: int) -> tuple[Rendering, Pullback]:
        def pullback(grad_image: Tensor) -> Gradients:
            self.pulled += 1
            return self.inner.render_vjp(*args, grad_image, wrt=wrt, spp=spp, seed=seed)

        return self.inner.render(*args, spp=spp, seed=seed), pullback


def test_the_gradient_reuses_the_samples_of_the_image(stage: Stage) -> None:
    keeping, gradients = Keeping(stage.renderer.plugin), []
    for renderer in (stage.renderer, seen_through(stage, keeping).renderer):
        color = stage.colors[stage.learnable].clone().requires_grad_(True)
        picture(replace(stage, renderer=renderer), {stage.learnable: color}).backward(random(10, 12, 3))
        gradients.append(color.grad)
    assert torch.equal(*gradients)
    assert (keeping.pulled, keeping.asked) == (1, [])


def test_the_gradient_s_own_samples_are_traced(stage: Stage) -> None:
    keeping, color = Keeping(stage.renderer.plugin), stage.colors[stage.learnable].clone().requires_grad_(True)
    picture(seen_through(stage, keeping), {stage.learnable: color}, spp_grad=2).sum().backward()
    with torch.no_grad():
        picture(seen_through(stage, keeping), {stage.learnable: color})
    assert (keeping.pulled, keeping.asked) == (0, [frozenset({"base_color"})])
