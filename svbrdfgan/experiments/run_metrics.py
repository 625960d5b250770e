"""Further measures of a run, which some experiments show in their tables."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import cache

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from svbrdfgan.errors import AssetError
from svbrdfgan.evaluation.evaluated import Evaluated
from svbrdfgan.experiments.definition import Measure
from svbrdfgan.metrics.recovered import SeenTexels, make_targets, mean_error, shown_texels
from svbrdfgan.report.vehicles import choose_views
from svbrdfgan.training.batches import BatchSource
from svbrdfgan.training.config import ScenesConfig

_VIEWS = 4  # scenes over which gradient noise is summed
_DRAWS = 16  # gradients of each scene


def measure(evaluated: Evaluated) -> dict[Measure, float]:
    """All measures that a run can have. Gradient noise needs online rendering, since cached renderings have none."""
    found: dict[Measure, float] = {}
    if (seen := seen_by_training(evaluated)) is not None:
        with suppress(AssetError):
            found["shown"] = recovered_where(evaluated, seen, lambda shown: shown)
        with suppress(AssetError):  # raised if the pictures show all texels
            found["unseen"] = recovered_where(evaluated, seen, lambda shown: ~shown)
    if (as_trained := evaluated.source.fake_scenes.resampled(evaluated.config.train.spp)) is not None:
        source = replace(evaluated.source, fake_scenes=as_trained)
        found["gradient_noise"] = gradient_noise(source, evaluated.layers["generated"])
    return found


def seen_by_training(evaluated: Evaluated) -> SeenTexels | None:
    """The texels of the scored split that cameras of the training split's distribution would see.

    None if the scored split has cameras of another distribution and no light transport of its scenes is stored: then
    only the texels that its own exemplars show are known.
    """
    source, declared = evaluated.source, evaluated.config.dataset
    camera = declared.camera_of("train")
    if camera == declared.camera_of(evaluated.evaluation.split):
        return source.seen
    return source.own_scenes.seen_in(ScenesConfig(camera=camera))


def recovered_where(evaluated: Evaluated, seen: SeenTexels, chosen: Callable[[Bool[Tensor, "*size"]], Tensor]) -> float:
    """`recovered` on the texels that `chosen` picks, given which texels any picture of the subject shows.

    Raises:
        AssetError: `chosen` picks no texel.
    """
    source, layers = evaluated.source, evaluated.layers
    exemplars = source.exemplars

    @cache
    def picked(subject: int) -> Float[Tensor, "rows cols"]:
        return chosen(shown_texels(exemplars, seen, subject)).float()

    targets, _ = make_targets(exemplars, lambda view: picked(int(exemplars.subject_of[view])), source.device)
    return 1.0 - mean_error(targets, layers["generated"]) / mean_error(targets, layers["constant"])


def gradient_noise(source: BatchSource, layers: Float[Tensor, "subjects rows cols channels"]) -> float:
    """The variance of a layer's gradient over samples, relative to the squared gradient; both summed over a few scenes.

    The gradient is that of half the squared difference between an exemplar and the render of its scene with the layer.
    """
    noise, signal = 0.0, 0.0
    for index in choose_views(source.exemplars, _VIEWS):
        layer = layers[int(source.exemplars.subject_of[index])].unsqueeze(0)
        with torch.no_grad():
            made, _ = source.scenes([index], np.random.default_rng(0)).render(layer)
        difference = made - source.pictures([index]).image.float()
        draws = torch.stack([_gradient(source, index, layer, difference, draw) for draw in range(1, _DRAWS + 1)])
        variance = float(draws.var(dim=0).sum())
        noise += variance
        signal += float(draws.mean(dim=0).square().sum()) - variance / _DRAWS  # less the mean's own noise
    return noise / max(signal, 1e-30)  # few draws may leave no signal, or less


def _gradient(source: BatchSource, index: int, layer: Tensor, difference: Tensor, draw: int) -> Tensor:
    learned = layer.detach().clone().requires_grad_(True)
    made, _ = source.scenes([index], np.random.default_rng(draw)).render(learned)
    made.backward(difference)
    assert learned.grad is not None
    return learned.grad
