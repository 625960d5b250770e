"""How pairs are dealt, judged and spoken of, without a renderer."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from svbrdfgan.config.models import validate
from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.data.index import Dataset
from svbrdfgan.errors import ConfigError
from svbrdfgan.evaluation.leakage import classifier
from svbrdfgan.evaluation.leakage.classifier import Roles, Trial
from svbrdfgan.evaluation.leakage.confounders import CONFOUNDERS, REMEDIES, find_confounders, scenes_with
from svbrdfgan.evaluation.leakage.report import Finding, LeakageReport, Share
from svbrdfgan.plugins.registry import load_renderer
from svbrdfgan.training.config import ScenesConfig, TrainConfig, train_config
from svbrdfgan.training.discriminator_batch import ImageBatch
from svbrdfgan.training.resolve import ResolvedRun


def config(compares: str = "radiance", **changes: object) -> TrainConfig:
    return train_config(
        {"dataset": "d", "discriminator": {"width": 8, "layers": 1, "gbuffer": False, "compares": compares}, **changes},
        "here",
    )


def noise(count: int, seed: int, mean: float = 0.5) -> ImageBatch:
    image = mean + 0.1 * torch.randn(count, 16, 16, 3, generator=torch.Generator().manual_seed(seed))
    return ImageBatch.cat([ImageBatch(image, torch.ones(count, 16, 16), None)])


def test_no_mesh_has_two_roles() -> None:
    meshes = [name for name in "abcdefghijkl" for _ in range(4)]
    roles = Roles.deal(meshes, seed=0)
    dealt = [{meshes[place] for place in role} for role in (roles.learn, roles.choose, roles.judge)]
    assert [len(each) for each in dealt] == [5, 2, 5]
    assert set.union(*dealt) == set(meshes)
    assert sorted([*roles.learn, *roles.choose, *roles.judge]) == list(range(48))
    assert roles != Roles.deal(meshes, seed=1)


def test_few_meshes_are_dealt_by_picture() -> None:
    roles = Roles.deal(["a"] * 6 + ["b"] * 4, seed=0)
    assert [len(role) for role in (roles.learn, roles.choose, roles.judge)] == [4, 2, 4]
    with pytest.raises(ConfigError, match="has 4 exemplars to train on; a probe needs 5"):
        Roles.deal(list("abcd"), seed=0)


def test_judged_pairs_teach_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever some of them hold, the probe that judges the others is the same."""
    monkeypatch.setattr(classifier, "_PROBES", 1)
    roles = Roles(learn=range(20), choose=range(20, 30), judge=range(30, 50))
    real, fake = noise(50, 0, 0.6), noise(50, 1)
    altered = ImageBatch(real.image.clone(), real.coverage, None)
    altered.image[40:] = 9.0
    before, after = (Trial(config(), side, fake, roles).judge() for side in (real, altered))
    assert torch.equal(before[:10], after[:10])
    assert not torch.equal(before[10:], after[10:])


@pytest.mark.full
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_equal_distributions_are_chance_and_others_are_told(seed: int) -> None:
    roles = Roles.deal(list(map(str, range(250))), seed)
    fakes = noise(250, 3), noise(250, 3, 0.52)
    matched, other = (Share.of(Trial(config(seed=seed), noise(250, 2), fake, roles).judge()) for fake in fakes)
    assert not matched.leaks
    assert other.value > 0.95


def test_the_interval_is_wilsons() -> None:
    """Its ends are where the picks lie 2.5758 deviations away."""
    share = Share.of(torch.tensor([1.0] * 70 + [-1.0] * 30))
    assert share.value == pytest.approx(0.7)
    for end in (share.low, share.high):
        assert abs(share.value - end) == pytest.approx(2.5758 * math.sqrt(end * (1 - end) / 100))
    assert Share.of(torch.zeros(10)).value == 0.5
    assert Share.of(torch.ones(7)).leaks
    assert not Share.of(torch.ones(6)).leaks


def test_the_interval_holds_as_often_as_it_says() -> None:
    picks = np.random.default_rng(0).normal(size=(4000, 64))
    shares = [Share.of(torch.from_numpy(row)) for row in picks]
    missed = np.mean([not share.low <= 0.5 <= share.high for share in shares])
    assert 0.004 < missed < 0.018
    assert np.mean([share.leaks for share in shares]) < 0.01


def test_what_differs_is_said(dataset_data: Callable[..., dict[str, object]]) -> None:
    matt, glossy = (
        Dataset(Path(), SimpleNamespace(config=validate(DatasetConfig, dataset_data(maps=maps), "here")))  # type: ignore[arg-type]
        for maps in ({}, {"roughness": 0.5})
    )
    one, two = load_renderer("numpy"), load_renderer("numpy", {"max_bounces": 3})

    def said(compares: str = "radiance", dataset: Dataset = matt, **changes: object) -> dict[str, str]:
        run = ResolvedRun(config(compares, **changes), dataset)
        return dict(find_confounders(run, two if changes.get("seed") else one, one))

    assert said(spp=8) == {}
    assert said(spp=9) == {"noise": "8 samples per pixel in exemplars, 9 in fakes"}
    assert said(spp=8, hits=4) == {}  # there is no stored light of which to keep less
    assert said(spp=8, hits=4, dataset=glossy) == {"noise": "8 samples per pixel in exemplars, 4 in fakes"}
    assert said(spp=8, hits=4, dataset=glossy, rendering="online") == {}
    assert said("reflectance", spp=8) == {"noise": "8 samples per pixel in exemplars, no noise in fakes"}
    assert said(spp=8, seed=1) == {"renderer": "numpy with 3 bounces for exemplars, numpy with 1 bounce for fakes"}
    assert said(spp=8, scenes={"camera_noise_degrees": 2.5}) == {"pose": "fakes' cameras are off by up to 2.5 degrees"}
    assert said(spp=8, scenes={"camera": {}, "environment": "redrawn"}) == {
        "pose": "fakes' cameras are drawn from another distribution",
        "light": "fakes' lights are drawn again from the exemplars' distribution",
    }
    assert said(spp=8, scenes={"environment": {"procedural": {"count": 1}}}).keys() == {"light"}


def test_confounders_are_taken_away_one_by_one() -> None:
    scenes = validate(
        ScenesConfig, {"camera_noise_degrees": 3.0, "camera": {}, "environment": "redrawn", "pool": 2}, "here"
    )
    assert scenes_with(scenes, frozenset(CONFOUNDERS)) == scenes
    assert scenes_with(scenes, frozenset({"noise"})).matched
    pose, light = (scenes_with(scenes, frozenset({name})) for name in ("pose", "light"))
    assert (pose.environment, pose.camera, pose.camera_noise_degrees) == ("same", scenes.camera, 3.0)
    assert (light.environment, light.camera, light.camera_noise_degrees) == ("redrawn", None, 0.0)


def test_what_is_told_comes_with_a_remedy() -> None:
    sure, unsure = torch.ones(50), torch.tensor([1.0, -1.0] * 25)
    alone = {name: Finding(differs="") for name in CONFOUNDERS}
    alone["pose"] = Finding.of("off", sure, REMEDIES["pose"])
    alone["light"] = Finding.of("redrawn", unsure, REMEDIES["light"])
    times = {"pictures_seconds": 1.0, "learning_seconds": 1.0}

    def lines(together: torch.Tensor, alone: dict[str, Finding]) -> list[str]:
        found = Finding.of("both", together)
        return LeakageReport(dataset="d", seed=0, exemplars=9, judged=5, together=found, alone=alone, **times).lines()

    assert alone["light"].verdict == "no leak: 50%"
    assert lines(sure, alone) == [f"pose leaks: 100%. {REMEDIES['pose']}"]
    alone["pose"] = alone["light"]
    assert lines(sure, alone) == ["All together tell 100% of pairs, though none leaks alone: match more of them."]
    assert lines(unsure, alone) == ["No shortcut was found that tells more than 67% of pairs."]
