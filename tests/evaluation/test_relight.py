"""Relit FLIP: noise alone for the truth, more for what is further from it, in scenes that training never had."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.data.index import Dataset
from svbrdfgan.errors import ConfigError
from svbrdfgan.evaluation.evaluated import by_subject
from svbrdfgan.evaluation.relight import Relight, Relighter, Relit
from svbrdfgan.io.environment import save_environment
from svbrdfgan.protocols import Renderer
from svbrdfgan.utils.display import SilentDisplay


@pytest.fixture(scope="module")
def renderer(cpu_renderer: Renderer[Any]) -> Renderer[Any]:
    return cpu_renderer


@pytest.fixture(scope="module")
def layers(glossy_exemplars: Exemplars) -> dict[str, Tensor]:
    """The truth, and layers at growing distances from it."""
    truths = [glossy_exemplars.layers[glossy_exemplars.views_of(n)[0]] for n in range(2)]
    truth = torch.stack([layer.values for layer in truths if layer is not None])
    wrong = torch.tensor([0.9, 0.1, 0.8, 1.0, 0.1, 0.9, 0.3, 0.0, 0.95]).expand_as(truth)
    return {"near": truth, "further": truth + 0.3 * (wrong - truth), "far": wrong}


def relight(
    exemplars: Exemplars, folder: Path, renderer: Renderer[Any], layers: dict[str, Tensor], **how: Any
) -> Relit:
    index = Dataset.open(folder).index
    relighter = Relighter.make(Relight(**how), index)
    return relighter.relit(exemplars, index.sampler("train"), renderer, by_subject(exemplars, layers), SilentDisplay())


@pytest.fixture(scope="module")
def found(
    glossy_exemplars: Exemplars, glossy_dataset: Path, renderer: Renderer[Any], layers: dict[str, Tensor]
) -> Relit:
    return relight(glossy_exemplars, glossy_dataset, renderer, layers)


def test_the_truth_differs_by_noise_alone_and_errors_add_to_it(found: Relit) -> None:
    flips = found.flips
    assert flips["near"] == flips["truth"] > 0
    assert flips["truth"] < flips["further"] < flips["far"]


def test_two_scenes_for_each_vehicle_that_training_never_had(
    found: Relit, glossy_exemplars: Exemplars, glossy_dataset: Path
) -> None:
    trained = {light.asset.sha256 for light in Dataset.open(glossy_dataset).index.environments["train"]}
    assert len(found.scenes) == 4
    assert [scene.scene.mesh for scene in found.scenes] == [s.mesh for s in glossy_exemplars.scenes]
    for own, shown in zip(glossy_exemplars.scenes, found.scenes, strict=True):
        scene = shown.scene
        assert scene.environment.asset.sha256 not in trained
        assert scene.camera.azimuth_degrees != own.camera.azimuth_degrees
        assert (scene.spp, scene.weathering, scene.materials) == (own.spp, own.weathering, own.materials)
        assert set(shown.pictures) == {"near", "further", "far", "truth"}
        assert not torch.equal(shown.reference, shown.pictures["truth"])
    assert len({scene.scene.environment.asset.path for scene in found.scenes}) > 1


def test_the_mean_is_that_of_the_scenes(found: Relit) -> None:
    for name, value in found.flips.items():
        assert value == pytest.approx(sum(scene.flips()[name] for scene in found.scenes) / 4)


def test_scenes_do_not_depend_on_what_is_relit(
    found: Relit, glossy_exemplars: Exemplars, glossy_dataset: Path, renderer: Renderer[Any], layers: dict[str, Tensor]
) -> None:
    again = relight(glossy_exemplars, glossy_dataset, renderer, {"far": layers["far"]}, scenes=1)
    assert [scene.scene for scene in again.scenes] == [scene.scene for scene in found.scenes[::2]]
    assert again.scenes[0].flips()["far"] == found.scenes[0].flips()["far"]


def test_files_light_the_scenes(
    glossy_exemplars: Exemplars,
    glossy_dataset: Path,
    renderer: Renderer[Any],
    layers: dict[str, Tensor],
    tmp_path: Path,
) -> None:
    """Red light makes red pictures."""
    save_environment(tmp_path / "red.exr", torch.tensor([1.0, 0.0, 0.0]).expand(8, 16, 3))
    only = {"near": layers["near"]}
    found = relight(glossy_exemplars, glossy_dataset, renderer, only, files=(str(tmp_path / "*.exr"),), scenes=1)
    for scene in found.scenes:
        assert Path(scene.scene.environment.asset.path).stem == "red"
        covered = scene.pictures["near"][scene.coverage == 1]
        assert covered[:, 0].mean() > 0.1
        assert covered[:, 1:].max() < 1e-3


def test_lights_of_training_are_refused(
    glossy_exemplars: Exemplars, glossy_dataset: Path, renderer: Renderer[Any], tmp_path: Path
) -> None:
    trained = Dataset.open(glossy_dataset).index.environments["train"][0].asset.path
    shutil.copy(glossy_dataset / trained, tmp_path / "noon.exr")
    with pytest.raises(ConfigError, match="training used noon: name other environment maps") as caught:
        relight(glossy_exemplars, glossy_dataset, renderer, {}, files=(str(tmp_path / "n*.exr"),))
    assert len(str(caught.value).splitlines()) == 1
    with pytest.raises(ConfigError, match="no file matches"):
        relight(glossy_exemplars, glossy_dataset, renderer, {}, files=(str(tmp_path / "*.hdr"),))


def test_what_is_not_weathered_is_left_out(
    glossy_exemplars: Exemplars, glossy_dataset: Path, renderer: Renderer[Any]
) -> None:
    scenes = [
        s.model_copy(update={"weathering": "unknown"} if n < 2 else {}) for n, s in enumerate(glossy_exemplars.scenes)
    ]
    half = replace(glossy_exemplars, scenes=tuple(scenes))
    found = relight(half, glossy_dataset, renderer, {}, scenes=1)
    assert [scene.scene.mesh for scene in found.scenes] == [scenes[2].mesh]
