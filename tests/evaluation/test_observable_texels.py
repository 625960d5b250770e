"""Where a map can be observed: where its true values matter to pictures, and nowhere else."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import pytest
import torch
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.evaluation import observable_texels
from svbrdfgan.evaluation.observable_texels import Observation
from svbrdfgan.protocols import Renderer
from svbrdfgan.rendering.render_layer import RenderLayer
from svbrdfgan.scene.description import Scene
from svbrdfgan.training.config import ScenesConfig
from svbrdfgan.training.online_rendering import OnlineRendering
from svbrdfgan.training.perturb import Perturbation
from svbrdfgan.types import Environment, Material, Materials, View

MAPS = {"roughness", "metallic", "normal"}
Masks = dict[str, Tensor]


@dataclass(frozen=True)
class Lights:
    """Loads views whose environment is changed."""

    loader: Any
    change: Callable[[Tensor], Tensor]

    def view(self, scene: Scene) -> View:
        view = self.loader.view(scene)
        return replace(view, environment=Environment(self.change(view.environment.radiance), 0.0))


@dataclass(frozen=True)
class Blind:
    """A renderer whose pictures do not show a map."""

    renderer: Any
    name: str
    flat: tuple[float, ...]
    device = torch.device("cpu")

    def prepare(self, surface: Any) -> Any:
        return self.renderer.prepare(surface)

    def render(self, prepared: Any, materials: Materials, view: View, **how: Any) -> Any:
        parts = [Material({**p.maps, self.name: torch.tensor(self.flat)}) for p in materials.parts]
        return self.renderer.render(prepared, Materials(tuple(parts)), view, **how)

    def render_vjp(self, *what: Any, **how: Any) -> Any:
        return self.renderer.render_vjp(*what, **how)


@pytest.fixture(scope="module")
def renderer(cpu_renderer: Renderer[Any]) -> Renderer[Any]:
    return cpu_renderer


def nothing(done: int) -> None:
    """Shows no progress."""


@pytest.fixture(scope="module")
def masks(glossy_exemplars: Exemplars, renderer: Renderer[Any]) -> Masks:
    return Observation(glossy_exemplars, renderer, nothing)(0)


def test_maps_are_observed_on_what_pictures_show(
    glossy_exemplars: Exemplars, renderer: Renderer[Any], masks: Masks
) -> None:
    """With the samples of the masks, all that they hold is seen."""
    perturbation = Perturbation(ScenesConfig(), None)  # type: ignore[arg-type]  # it draws nothing
    spp = observable_texels._SAMPLES * glossy_exemplars.scenes[0].spp
    online = OnlineRendering(glossy_exemplars, perturbation, RenderLayer(renderer, spp))
    seen = torch.stack([online.seen(view) > 0 for view in glossy_exemplars.views_of(0)]).any(dim=0)
    assert masks.keys() == MAPS
    for mask in masks.values():
        assert mask.dtype == torch.bool
        assert mask.sum() > 0.2 * seen.sum()
        assert not (mask & ~seen).any()
    assert not torch.equal(masks["roughness"], masks["normal"])


def test_the_same_truth_gives_the_same_masks(
    glossy_exemplars: Exemplars, renderer: Renderer[Any], masks: Masks
) -> None:
    again = Observation(glossy_exemplars, renderer, nothing)(0)
    assert all(torch.equal(again[name], masks[name]) for name in MAPS)


def test_no_change_is_no_observation(
    glossy_exemplars: Exemplars, renderer: Renderer[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(observable_texels, "CHANGE", 0.0)
    monkeypatch.setattr(observable_texels, "DEGREES", 0.0)
    assert not any(mask.any() for mask in Observation(glossy_exemplars, renderer, nothing)(0).values())


def test_in_the_dark_nothing_can_be_observed(glossy_exemplars: Exemplars, renderer: Renderer[Any]) -> None:
    dark = replace(glossy_exemplars, loader=Lights(glossy_exemplars.loader, torch.zeros_like))  # type: ignore[arg-type]
    assert not any(mask.any() for mask in Observation(dark, renderer, nothing)(0).values())


@pytest.mark.parametrize(("name", "flat"), [("roughness", (0.5,)), ("normal", (0.0, 0.0, 1.0))])
def test_a_map_that_no_picture_shows_is_observed_nowhere(
    name: str, flat: tuple[float, ...], glossy_exemplars: Exemplars, renderer: Renderer[Any]
) -> None:
    blind: Any = Blind(renderer, name, flat)
    found = Observation(glossy_exemplars, blind, nothing)(0)
    assert not found[name].any()
    assert all(found[other].any() for other in MAPS - {name})


def test_changes_go_inside_and_leave_other_parts_alone() -> None:
    rough, normal = torch.tensor([0.0, 0.45, 0.5, 1.0]).reshape(2, 2, 1), torch.tensor([0.0, 0.0, 1.0])
    part = Material({"base_color": torch.ones(3), "roughness": rough, "normal": normal})
    (one,) = observable_texels._changes(Materials((part, part)), "roughness", (1,))
    torch.testing.assert_close(one[1].maps["roughness"].flatten(), torch.tensor([0.1, 0.55, 0.4, 0.9]))
    assert one[0] is part
    tilts = [
        changed[1].maps["normal"] for changed in observable_texels._changes(Materials((part, part)), "normal", (1,))
    ]
    assert len(tilts) == 2
    assert float(tilts[0] @ normal) == pytest.approx(float(tilts[1] @ normal)) == pytest.approx(0.98481, abs=1e-4)


def test_every_picture_of_a_subject_counts(glossy_exemplars: Exemplars, renderer: Renderer[Any], masks: Masks) -> None:
    first = replace(glossy_exemplars, subject_of=torch.tensor([0, 1, 1, 1]))
    done: list[int] = []
    alone = Observation(first, renderer, done.append)(0)
    assert done == [1]
    for name in MAPS:
        assert not (alone[name] & ~masks[name]).any()
        assert (masks[name] & ~alone[name]).any()
