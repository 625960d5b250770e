"""What some experiments measure beside the verdict, and the strip of pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from svbrdfgan.config.models import validate
from svbrdfgan.data.config import CameraDistribution
from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.evaluation.evaluate import evaluate
from svbrdfgan.evaluation.evaluated import Evaluated
from svbrdfgan.experiments import run_metrics
from svbrdfgan.experiments.contact_strip import write_contact_strip
from svbrdfgan.experiments.run_metrics import gradient_noise, measure, recovered_where, seen_by_training
from svbrdfgan.plugins.select import resolve_renderer
from svbrdfgan.training.batches import make_batch_source
from svbrdfgan.training.config import train_config
from svbrdfgan.training.resolve import resolve_run
from svbrdfgan.training.trainer import train

Data = Callable[..., dict[str, Any]]


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory: pytest.TempPathFactory, training_data: Data) -> Evaluated:
    folder = tmp_path_factory.mktemp("run") / "run"
    train(train_config(training_data(steps=1), "here"), folder)
    return evaluate(folder, split="validation", device="cpu", oracle=False)


def test_only_what_no_picture_shows_counts_as_unseen(evaluated: Evaluated) -> None:
    exemplars = evaluated.source.exemplars
    shown = torch.stack([evaluated.source.seen(view) > 0 for view in exemplars.views_of(0)]).any(dim=0)
    truth = exemplars.layers[0]
    assert truth is not None
    assert (shown & exemplars.subjects[0].learnable_texels).any()
    constant = evaluated.layers["constant"][0]
    hidden_right = torch.where(shown[..., None], constant, truth.values)
    shown_right = torch.where(shown[..., None], truth.values, constant)

    def score(layer: torch.Tensor) -> dict[str, float]:
        return measure(replace(evaluated, layers={**evaluated.layers, "generated": layer.unsqueeze(0)}))  # type: ignore[return-value]

    assert score(hidden_right) == pytest.approx({"shown": 0.0, "unseen": 1.0}, abs=1e-6)
    assert score(shown_right) == pytest.approx({"shown": 1.0, "unseen": 0.0}, abs=1e-6)


def test_what_training_could_see_is_seen_by_its_cameras(evaluated: Evaluated) -> None:
    """All training pictures are taken from the right: what faces left is unseen, though test pictures show it."""
    dataset = evaluated.config.dataset
    right = {"azimuth_degrees": {"fixed": 90.0}, "elevation_degrees": {"fixed": 0.0}}
    train = dataset.splits["train"].model_copy(update={"camera": validate(CameraDistribution, right, "here")})
    changed = dataset.model_copy(update={"splits": {**dataset.splits, "train": train}})
    one_sided = replace(evaluated, config=evaluated.config.model_copy(update={"dataset": changed}))
    assert seen_by_training(evaluated) == evaluated.source.seen
    seen = seen_by_training(one_sided)
    exemplars = evaluated.source.exemplars
    shown = torch.stack([seen(view) > 0 for view in exemplars.views_of(0)]).any(dim=0)
    facing = exemplars.subjects[0].geometry[3]  # the normal's x
    assert shown.any()
    assert not shown[facing < -0.2].any()
    assert recovered_where(one_sided, seen, lambda shown: shown) != measure(evaluated)["shown"]


def test_stored_gradients_have_no_noise_to_measure(evaluated: Evaluated) -> None:
    assert set(measure(evaluated)) == {"shown", "unseen"}


@pytest.mark.parametrize("spread", [0.1, 1.0])
def test_the_noise_of_a_gradient_is_its_relative_variance(spread: float, tiny_exemplars: Exemplars) -> None:
    """A renderer that multiplies the layer by samples of mean 1: so the gradient's noise is theirs."""

    def scenes(indices: list[int], rng: np.random.Generator) -> SimpleNamespace:
        samples = torch.from_numpy(1 + spread * rng.standard_normal((1, 32, 32, 4)))
        return SimpleNamespace(render=lambda layers: (layers * samples, None))

    real = SimpleNamespace(image=torch.zeros(1, 32, 32, 4))
    source = SimpleNamespace(exemplars=tiny_exemplars, scenes=scenes, pictures=lambda _: real)
    noise = gradient_noise(source, torch.full((2, 32, 32, 4), 0.5))  # type: ignore[arg-type]
    assert noise == pytest.approx(spread**2, rel=0.15)


def test_gradients_of_fresh_renders_are_noisy(
    tiny_dataset: Path, training_data: Data, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_metrics, "_DRAWS", 2)
    online = {"rendering": "online", "discriminator": {"gbuffer": False}, "spp": 1, "spp_grad": 1}
    config = train_config(training_data(**online), "here")
    renderer, _ = resolve_renderer(config.renderer)
    source = make_batch_source(resolve_run(config), "validation", renderer, torch.device("cpu"))
    assert gradient_noise(source, torch.full((1, 32, 32, 4), 0.5)) > 0.01


def test_the_strip(evaluated: Evaluated, tmp_path: Path) -> None:
    write_contact_strip(tmp_path / "strip.png", evaluated)
    with Image.open(tmp_path / "strip.png") as image:
        assert image.size == (1656, 160)
        pixels = np.asarray(image.convert("RGB")).astype(float)
    truth, learned = pixels[:, :240], pixels[:, 248:488]
    assert np.abs(truth - learned).mean() > 0.5
    assert np.abs(pixels[:, 496:656] - pixels[:, 664:824]).mean() > 0.5  # the layers
    assert (pixels[:, 832:] == 255).all()  # there is one vehicle alone
