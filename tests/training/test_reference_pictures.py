"""What stands beside a picture: how its scene lights reference materials, and which point each pixel shows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.errors import ConfigError
from svbrdfgan.plugins.registry import load_renderer
from svbrdfgan.protocols import Renderer, RendererCapabilities
from svbrdfgan.rendering.transport.build import build_transport
from svbrdfgan.scene.description import Scene
from svbrdfgan.scene.subject import Subject
from svbrdfgan.training import reference_pictures
from svbrdfgan.training.reference_pictures import LIGHT_CHANNELS, ReferencePictures, require_reference_materials
from svbrdfgan.types import Layer, View

SPP = 8


@dataclass(frozen=True, eq=False)
class Setting:
    renderer: Renderer[Any]
    exemplars: Exemplars
    index: int = 0

    @property
    def scene(self) -> Scene:
        return self.exemplars.scenes[self.index]

    @property
    def subject(self) -> Subject:
        return self.exemplars.subject(self.index)

    @property
    def view(self) -> View:
        return self.exemplars.loader.view(self.scene)

    def pictures(self, **changes: Any) -> ReferencePictures:
        prepared = self.renderer.prepare(self.subject.surface)
        return replace(
            ReferencePictures(self.renderer, prepared, self.subject, self.scene, self.view, SPP),
            **changes,
        )


@pytest.fixture(scope="module")
def setting(cpu_renderer: Renderer[Any], tiny_exemplars: Exemplars) -> Setting:
    return Setting(cpu_renderer, tiny_exemplars)


def painted(setting: Setting, color: tuple[float, float, float], roughness: float) -> Scene:
    """The scene with another material on every learnable part."""
    names = [setting.subject.surface.parts[part].name for part in setting.subject.learnable]
    return setting.scene.model_copy(
        update={"materials": dict.fromkeys(names, color), "maps": {"roughness": roughness, "metallic": 0.3}}
    )


def test_the_light_buffer_does_not_depend_on_the_learnable_material(setting: Setting) -> None:
    red = setting.pictures(scene=painted(setting, (0.8, 0.1, 0.1), 0.2)).light_buffer()
    grey = setting.pictures(scene=painted(setting, (0.3, 0.3, 0.3), 0.7)).light_buffer()
    assert torch.equal(red, grey)
    assert red.shape == (32, 32, LIGHT_CHANNELS)
    assert red.dtype == torch.float16
    assert red.max() > 0.1


def test_it_shows_the_parts_that_are_not_learned_as_they_are(setting: Setting) -> None:
    glass = next(
        part.name for n, part in enumerate(setting.subject.surface.parts) if n not in setting.subject.learnable
    )
    lit = setting.scene.model_copy(update={"materials": {**setting.scene.materials, glass: (1.0, 0.0, 0.0)}})
    assert not torch.equal(setting.pictures(scene=lit).light_buffer(), setting.pictures().light_buffer())


def test_it_changes_with_the_light(setting: Setting) -> None:
    """Twice the light is twice the buffer; light from elsewhere is another one."""
    environment = setting.view.environment
    own = setting.pictures().light_buffer().float()
    twice = replace(setting.view, environment=replace(environment, radiance=2 * environment.radiance))
    torch.testing.assert_close(setting.pictures(view=twice).light_buffer().float(), 2 * own, rtol=2e-3, atol=1e-4)
    turned = replace(setting.view, environment=replace(environment, rotation=environment.rotation + 2.0))
    other = setting.pictures(view=turned).light_buffer().float()
    assert (other - own).abs().mean() > 0.1 * own.mean()


def test_a_clean_picture_is_the_scene_without_its_layer(setting: Setting) -> None:
    bare = setting.subject.materials(None, setting.scene.maps, base_colors=setting.scene.materials)
    prepared = setting.renderer.prepare(setting.subject.surface)
    wanted = setting.renderer.render(prepared, bare, setting.view, spp=256, seed=3).image
    clean = setting.pictures(spp=64).clean()
    assert clean.dtype == torch.float16
    assert (clean.float() - wanted).abs().mean() < 0.08 * wanted.mean()  # the noise of 256 samples, twice
    red = setting.pictures(scene=painted(setting, (0.8, 0.1, 0.1), 0.5)).clean().float()
    assert (red - wanted).abs().mean() > 0.16 * wanted.mean()


def test_it_has_irradiance_and_two_reflections(setting: Setting) -> None:
    """Under uniform light white matt parts without occlusion are as bright as the light; metals lose little."""
    uniform = replace(setting.view.environment, radiance=torch.ones(4, 8, 3))
    buffer = setting.pictures(view=replace(setting.view, environment=uniform), spp=32).light_buffer().float()
    whole = setting.pictures().gbuffer()[..., 3:].norm(dim=-1) > 0.95
    for picture in buffer.split(3, dim=-1):
        assert 0.7 < picture[whole].mean() < 1.02
    matt, sharp, blurred = buffer.split(3, dim=-1)
    assert (sharp - blurred).abs().mean() > 1e-3
    assert (matt - sharp).abs().mean() > 1e-3


def test_its_noise_is_not_that_of_the_picture(setting: Setting) -> None:
    """With the scene's own seed, white pixels would be the same in both."""
    pictures, subject = setting.pictures(), setting.subject
    white = torch.ones(*subject.buffer.part.shape, 4)
    materials = subject.materials(Layer(white), base_colors=setting.scene.materials)
    same = setting.renderer.render(pictures.prepared, materials, setting.view, spp=SPP, seed=setting.scene.seed).image
    matt = pictures.light_buffer().float()[..., :3]
    whole = pictures.gbuffer()[..., 3:].norm(dim=-1) > 0.95
    assert whole.sum() > 20
    assert (matt - same)[whole].abs().mean() > 0.01 * same[whole].mean()
    torch.testing.assert_close(matt[whole].mean(), same[whole].mean(), rtol=0.1, atol=0.0)


def test_the_gbuffer_is_that_of_stored_transport(setting: Setting) -> None:
    """But for noise and for the weights of samples within a pixel."""
    spp = 64
    subject, view = setting.subject, setting.view
    prepared = setting.renderer.prepare(subject.surface)
    stored = build_transport(
        setting.renderer.transport(prepared, view, spp=spp, seed=5),  # type: ignore[attr-defined]
        materials=subject.materials(),
        learnable=subject.learnable,
        gbuffer=subject.geometry.permute(1, 2, 0),
        view=view,
        spp=spp,
        repeat=subject.surface.repeat,
    ).gbuffer.float()
    made = setting.pictures(spp=spp).gbuffer()
    assert (made - stored).abs().mean() < 0.06 * stored.abs().mean()
    assert (made - stored.flip(1)).abs().mean() > 0.3 * stored.abs().mean()
    inside = stored[..., 3:].norm(dim=-1) > 0.98
    assert inside.sum() > 20
    assert (made - stored)[inside].abs().median() < 0.02


def test_light_that_is_scattered_twice_does_not_blur_the_gbuffer(
    setting: Setting, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Parts are painted so dark that painting them a hundred times darker changes nothing."""
    several = replace(setting, renderer=load_renderer("numpy", {"max_bounces": 2}))
    made = several.pictures().gbuffer()
    monkeypatch.setattr(reference_pictures, "_DARK", 1e-5)
    torch.testing.assert_close(several.pictures().gbuffer(), made, rtol=0.0, atol=2e-3)
    monkeypatch.setattr(reference_pictures, "_DARK", 1.0)
    assert (several.pictures().gbuffer() - made).abs().max() > 1e-2


def test_a_renderer_without_gloss_makes_a_gbuffer_and_is_told_what_a_light_buffer_needs(setting: Setting) -> None:
    plain: Any = SimpleNamespace(name="plain", capabilities=RendererCapabilities())
    with pytest.raises(ConfigError, match=r"cannot render metallic, roughness: set discriminator\.light_buffer: false"):
        require_reference_materials(plain)
    require_reference_materials(setting.renderer)
    seen: list[set[str]] = []

    class Watched(type(setting.renderer.plugin)):  # type: ignore[misc]
        def render(self, prepared: Any, materials: Any, *given: Any, **more: Any) -> Any:
            seen.extend({*material.maps} for material in materials.parts)
            return super().render(prepared, materials, *given, **more)

    replace(setting, renderer=replace(setting.renderer, plugin=Watched())).pictures().gbuffer()
    assert seen
    assert all(names == {"base_color"} for names in seen)
