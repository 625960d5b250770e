"""Gradients of pictures in every map and the light are the derivatives of the same samples.

For the base colour that is the derivative of `render`'s picture. Other maps decide where samples are drawn; there paths
are traced with the maps as they are, and shaded with moved ones.
"""

from collections.abc import Callable, Mapping

import gltf
import numpy as np
import pytest
import torch
from svbrdfgan_numpy import NumpyRenderer, renderer
from svbrdfgan_numpy.bsdf import Bsdf
from svbrdfgan_numpy.environment import pixels_of, prepare_emitter
from svbrdfgan_numpy.normal_map import Frame
from svbrdfgan_numpy.shading import radiance, shade
from svbrdfgan_numpy.surface import PreparedSurface
from torch import Tensor

from svbrdfgan.testing import scenes
from svbrdfgan.types import Camera, Environment, Material, Materials, View

WRT = frozenset({"base_color", "roughness", "metallic", "normal", "environment"})
SPP, SEED = 4, 3


@pytest.fixture(autouse=True)
def _pictures_in_double(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rounding results to float32 would be larger than the finite differences."""
    monkeypatch.setattr(renderer, "_tensor", torch.from_numpy)


def _random(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed)).double()


def _relief(rows: int, cols: int, seed: int) -> Tensor:
    """A normal map so steep that some normals must be bent."""
    return scenes.random_texture(rows, cols, seed) * torch.tensor([2.0, 2.0, 0.3]) + torch.tensor([-1.0, -1.0, 0.3])


def _corner(max_bounces: int) -> tuple[NumpyRenderer, PreparedSurface, View, list[dict[str, Tensor]]]:
    """Parts that see one another: with all maps as textures, Lambertian with a normal map, and constants."""
    maps = [
        {
            "base_color": scenes.random_texture(6, 5),
            "roughness": scenes.random_texture(3, 7, seed=2)[..., :1],
            "metallic": scenes.random_texture(4, 4, seed=3)[..., :1],
            "normal": _relief(5, 3, seed=4),
        },
        {"base_color": torch.tensor([0.9, 0.5, 0.2]), "normal": _relief(2, 6, seed=5)},
        {"base_color": scenes.random_texture(3, 4, seed=1), "roughness": torch.tensor([0.25])},
    ]
    tracer, view = NumpyRenderer(max_bounces), scenes.corner_view(scenes.random_light())
    maps = [{name: value.double() for name, value in part.items()} for part in maps]
    return tracer, tracer.prepare(scenes.corner_box()), view, maps


def _materials(maps: list[dict[str, Tensor]]) -> Materials:
    return Materials(tuple(Material(part) for part in maps))


def _slope(loss: Callable[[float], float], step: float) -> float:
    """The derivative at 0 by central differences, extrapolated: the error is of fourth order."""
    narrow, wide = ((loss(s) - loss(-s)) / (2.0 * s) for s in (step, 2.0 * step))
    return (4.0 * narrow - wide) / 3.0


def _moved(maps: list[dict[str, Tensor]], part: int, name: str, by: Tensor) -> Materials:
    return _materials([*maps[:part], {**maps[part], name: maps[part][name] + by}, *maps[part + 1 :]])


@pytest.mark.parametrize("max_bounces", [1, 3])
@pytest.mark.parametrize("part", [0, 1, 2])
def test_base_color_against_finite_differences(part: int, max_bounces: int) -> None:
    tracer, prepared, view, maps = _corner(max_bounces)
    cotangent, along = _random(view.height, view.width, 3), _random(*maps[part]["base_color"].shape, seed=part + 1)

    def loss(step: float) -> float:
        materials = _moved(maps, part, "base_color", step * along)
        return float((tracer.render(prepared, materials, view, spp=SPP, seed=SEED).image * cotangent).sum())

    gradients = tracer.render_vjp(prepared, _materials(maps), view, cotangent, wrt=WRT, spp=SPP, seed=SEED)
    gradient = gradients.materials[part]["base_color"]
    slope = float((gradient.double() * along).sum())
    assert (gradient.dtype, gradient.shape) == (torch.float32, maps[part]["base_color"].shape)
    assert abs(slope) > 1e-3
    assert _slope(loss, 1e-3) == pytest.approx(slope, rel=1e-5)


def _image_of_paths(
    tracer: NumpyRenderer, prepared: PreparedSurface, view: View, maps: list[dict[str, Tensor]]
) -> Callable[[Materials], Tensor]:
    """The picture of other materials on the paths that are traced with these maps."""

    def textures(materials: Materials) -> Mapping[str, renderer.Texture]:
        return renderer._textures(materials, prepared.surface)

    samples = view.height * view.width * SPP
    paths = renderer._tracer(prepared, view, textures(_materials(maps)))
    bounces = list(paths.trace(range(samples), spp=SPP, seed=SEED, max_bounces=tracer.max_bounces))

    def image(materials: Materials) -> Tensor:
        shadings = [shade(bounce, textures(materials), pixels_of(view.environment)) for bounce in bounces]
        mean = radiance(samples, bounces, shadings).reshape(-1, SPP, 3).mean(axis=1)
        return torch.from_numpy(mean.reshape(view.height, view.width, 3))

    return image


@pytest.mark.parametrize("max_bounces", [1, 3])
@pytest.mark.parametrize(
    ("part", "name"), [(0, "roughness"), (2, "roughness"), (0, "metallic"), (0, "normal"), (1, "normal")]
)
def test_other_maps_against_finite_differences_on_the_same_paths(part: int, name: str, max_bounces: int) -> None:
    tracer, prepared, view, maps = _corner(max_bounces)
    cotangent, along = _random(view.height, view.width, 3), _random(*maps[part][name].shape, seed=part + 1)
    image = _image_of_paths(tracer, prepared, view, maps)
    rendered = tracer.render(prepared, _materials(maps), view, spp=SPP, seed=SEED).image
    assert torch.allclose(image(_materials(maps)), rendered, rtol=1e-12)

    gradients = tracer.render_vjp(prepared, _materials(maps), view, cotangent, wrt=WRT, spp=SPP, seed=SEED)
    gradient = gradients.materials[part][name]
    slope = float((gradient.double() * along).sum())
    found = _slope(lambda step: float((image(_moved(maps, part, name, step * along)) * cotangent).sum()), 1e-6)
    assert (gradient.dtype, gradient.shape) == (torch.float32, maps[part][name].shape)
    assert abs(slope) > 1e-3
    assert found == pytest.approx(slope, rel=1e-5)


@pytest.mark.parametrize("texel", [(0.3, -0.2, 0.7), (-0.2, -0.34, 0.23)])
def test_gradients_are_unbiased_though_maps_move_the_paths(texel: tuple[float, float, float]) -> None:
    """They are the derivatives of sums over a grid of directions, which knows nothing of sampling.

    The plane faces +Z, and so does the grid, whose edge is the horizon. The second normal is bent.
    """
    direction = np.array([1.9, 0.6, 1.3]) / np.linalg.norm([1.9, 0.6, 1.3])
    view = View(Camera(tuple(direction), vertical_fov=1e-4), scenes.random_light(6, 12), 8, 8)
    maps = {"base_color": 3 * (0.5,), "roughness": (0.45,), "metallic": (0.5,), "normal": texel}
    values = {name: np.array(value) for name, value in maps.items()}
    truth = _slopes_by_grid(view, direction, values)
    materials = Materials((Material({name: torch.from_numpy(value) for name, value in values.items()}),))
    tracer, ones = NumpyRenderer(), torch.ones(8, 8, 3) / 192.0
    prepared, wrt = tracer.prepare(scenes.plane()), frozenset(maps)
    runs = [
        tracer.render_vjp(prepared, materials, view, ones, wrt=wrt, spp=256, seed=seed).materials[0]
        for seed in range(16)
    ]
    for name in ("roughness", "metallic", "normal"):
        found = np.stack([run[name].double().numpy() for run in runs])
        error = found.std(axis=0, ddof=1) / 4.0
        assert (np.abs(found.mean(axis=0) - truth[name]) < 5.0 * error).all()
        assert np.linalg.norm(error) < 0.03 * max(0.1, float(np.linalg.norm(truth[name])))


def _slopes_by_grid(view: View, outgoing: np.ndarray, values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The derivatives of the mean radiance that leaves a plane which faces +Z, by central differences."""
    height, azimuth = (a.ravel() for a in np.meshgrid(*2 * [(np.arange(300) + 0.5) / 300.0]))
    sine, azimuth = np.sqrt(1.0 - height**2), 2.0 * np.pi * azimuth
    incoming = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), height], axis=-1)
    light = prepare_emitter(view.environment).taps(incoming).apply(pixels_of(view.environment)).mean(axis=1)
    count, seen = len(height), np.broadcast_to(outgoing, incoming.shape)

    def radiance_of(moved: Mapping[str, np.ndarray]) -> float:
        normal = Frame(np.eye(3)[None], outgoing[None]).tilted(moved["normal"][None])
        bsdf = Bsdf(
            np.arange(count),
            np.broadcast_to(moved["base_color"], (count, 3)),
            np.repeat(moved["roughness"], count),
            np.repeat(moved["metallic"], count),
            np.broadcast_to(normal, (count, 3)),
            np.arange(count),
        )
        return float((bsdf.evaluate(seen, incoming)[:, 0] * light).mean() * 2.0 * np.pi)

    def slope(name: str, step: np.ndarray) -> float:
        there, back = (radiance_of({**values, name: values[name] + sign * step}) for sign in (1.0, -1.0))
        return (there - back) / (2.0 * float(np.abs(step).max()))

    return {name: np.array([slope(name, step) for step in 1e-4 * np.eye(len(value))]) for name, value in values.items()}


@pytest.mark.parametrize("max_bounces", [1, 3])
def test_environment_against_finite_differences(max_bounces: int) -> None:
    """Light is moved between channels: sampling depends on their mean, so the samples stay the same."""
    tracer, prepared, view, maps = _corner(max_bounces)
    cotangent, radiance = _random(view.height, view.width, 3), view.environment.radiance.double() + 0.5
    along = _random(*radiance.shape, seed=5)
    along -= along.mean(dim=-1, keepdim=True)

    def picture(light: Tensor) -> float:
        lit = View(view.camera, Environment(light), view.width, view.height)
        return float((tracer.render(prepared, _materials(maps), lit, spp=SPP, seed=SEED).image * cotangent).sum())

    lit = View(view.camera, Environment(radiance), view.width, view.height)
    gradients = tracer.render_vjp(prepared, _materials(maps), lit, cotangent, wrt=WRT, spp=SPP, seed=SEED)
    assert gradients.environment is not None
    slope = float((gradients.environment * along).sum())
    assert abs(slope) > 1e-2
    assert _slope(lambda step: picture(radiance + step * along), 0.02) == pytest.approx(slope, rel=1e-5)
    assert float((gradients.environment * radiance).sum()) == pytest.approx(picture(radiance), rel=1e-9)


def test_parts_have_gradients_of_their_maps_and_only_if_asked() -> None:
    tracer, prepared, view, maps = _corner(1)
    ones = torch.ones(view.height, view.width, 3)

    def named(wrt: set[str]) -> list[set[str]]:
        gradients = tracer.render_vjp(prepared, _materials(maps), view, ones, wrt=frozenset(wrt), spp=1, seed=0)
        assert (gradients.environment is not None) == ("environment" in wrt)
        return [set(part) for part in gradients.materials]

    assert named(set(WRT)) == [
        {"base_color", "roughness", "metallic", "normal"},
        {"base_color", "normal"},
        {"base_color", "roughness"},
    ]
    assert named({"roughness"}) == [{"roughness"}, set(), {"roughness"}]
    assert named({"metallic", "environment"}) == [{"metallic"}, set(), set()]
    assert named({"normal"}) == [{"normal"}, {"normal"}, set()]
    assert named({"base_color"}) == 3 * [{"base_color"}]


def test_unseen_texels_and_unseen_parts_have_exactly_no_gradient() -> None:
    behind = scenes.quad((-1.0, -1.0, -1.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0))
    rough = [torch.full((8, 8, 1), 0.3), torch.full((4, 4, 1), 0.3)]
    materials = Materials(tuple(gltf.glossy((0.0, 0.0, 0.0), r) for r in rough))
    tracer, view = NumpyRenderer(), scenes.front_view(scenes.random_light(), 1.0, vertical_fov=0.8)
    prepared = tracer.prepare(scenes.joined(scenes.plane(2.0), behind))
    gradients = tracer.render_vjp(prepared, materials, view, torch.ones(16, 16, 3), wrt=WRT, spp=4, seed=0).materials
    seen = gradients[0]["roughness"][..., 0]
    assert (gradients[1]["roughness"] == 0.0).all()
    assert (seen[[0, -1]] == 0.0).all()
    assert (seen[:, [0, -1]] == 0.0).all()
    assert (seen[2:6, 2:6] != 0.0).all()


def test_roughness_below_the_bound_has_exactly_no_gradient() -> None:
    tracer, view = NumpyRenderer(), scenes.front_view(scenes.random_light(), vertical_fov=0.2)
    prepared = tracer.prepare(scenes.plane())
    below, above = (
        tracer.render_vjp(
            prepared,
            Materials((gltf.glossy((0.5, 0.5, 0.5), roughness),)),
            view,
            torch.ones(16, 16, 3),
            wrt=WRT,
            spp=4,
            seed=0,
        ).materials[0]["roughness"]
        for roughness in (0.049, 0.051)
    )
    assert (below == 0.0).all()
    assert (above != 0.0).all()
