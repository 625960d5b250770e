"""What some experiments measure beside the verdict."""

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
from svbrdfgan.evaluation.evaluate import Evaluated
from svbrdfgan.experiments.definition import Measure
from svbrdfgan.metrics.recovered import SeenTexels, make_targets, mean_error
from svbrdfgan.report.vehicles import choose_views
from svbrdfgan.training.batches import Feed
from svbrdfgan.training.cached_rendering import Transports
from svbrdfgan.training.config import ScenesConfig
from svbrdfgan.training.online_rendering import FreshRenders
from svbrdfgan.training.perturb import Perturbation

_VIEWS, _DRAWS = 4, 16


def measure(evaluated: Evaluated) -> dict[Measure, float]:
    """All that can be measured of a run: gradients have noise only where pictures are rendered anew."""
    found: dict[Measure, float] = {}
    if (seen := seen_by_training(evaluated)) is not None:
        with suppress(AssetError):
            found["shown"] = recovered_where(evaluated, seen, lambda shown: shown)
        with suppress(AssetError):  # the pictures show everything
            found["unseen"] = recovered_where(evaluated, seen, lambda shown: ~shown)
    stages = evaluated.feed.stages
    if isinstance(stages, FreshRenders):
        trained = replace(stages.layer, spp=evaluated.config.train.spp or stages.layer.spp)
        feed = replace(evaluated.feed, stages=replace(stages, layer=trained))
        found["gradient_noise"] = gradient_noise(feed, evaluated.layers["generated"])
    return found


def seen_by_training(evaluated: Evaluated) -> SeenTexels | None:
    """What pictures would show, were those of the split taken from where those of the training split were.

    None where they were not, and scenes are rendered anew: those know what exemplars show, and of no other cameras.
    """
    feed, declared = evaluated.feed, evaluated.config.dataset
    camera, own = declared.camera_of("train"), feed.own
    if camera == declared.camera_of(evaluated.evaluation.split):
        return feed.seen
    if not isinstance(own, Transports):
        return None
    moved = Perturbation(ScenesConfig(camera=camera), own.perturbation.sampler)
    return Transports(own.exemplars, moved, own.renderer, own.spp, 1, torch.device("cpu"), own.seed, own.options).seen


def recovered_where(evaluated: Evaluated, seen: SeenTexels, chosen: Callable[[Bool[Tensor, "*size"]], Tensor]) -> float:
    """`recovered` on that part of the learnable area that is chosen by whether any picture of the subject shows it.

    Raises:
        AssetError: there is no such part.
    """
    feed, layers = evaluated.feed, evaluated.layers
    exemplars = feed.exemplars

    @cache
    def picked(subject: int) -> Float[Tensor, "rows cols"]:
        shown = torch.stack([seen(view).cpu() > 0 for view in exemplars.views_of(subject)]).any(dim=0)
        return chosen(shown).float()

    targets, _ = make_targets(exemplars, lambda view: picked(int(exemplars.subject_of[view])), feed.buffers.device)
    return 1.0 - mean_error(targets, layers["generated"]) / mean_error(targets, layers["constant"])


def gradient_noise(feed: Feed, layers: Float[Tensor, "subjects rows cols channels"]) -> float:
    """The variance of a layer's gradient over samples, relative to the gradient's square; summed over a few scenes.

    The gradient is that of half the squared difference between an exemplar and its scene under the layer.
    """
    noise, signal = 0.0, 0.0
    for index in choose_views(feed.exemplars, _VIEWS):
        layer = layers[int(feed.exemplars.subject_of[index])].unsqueeze(0)
        with torch.no_grad():
            made, _ = feed.stage([index], np.random.default_rng(0)).render(layer)
        difference = made - feed.real([index])[0].float()
        draws = torch.stack([_gradient(feed, index, layer, difference, draw) for draw in range(1, _DRAWS + 1)])
        variance = float(draws.var(dim=0).sum())
        noise += variance
        signal += float(draws.mean(dim=0).square().sum()) - variance / _DRAWS  # the mean's own noise, taken out
    return noise / max(signal, 1e-30)


def _gradient(feed: Feed, index: int, layer: Tensor, difference: Tensor, draw: int) -> Tensor:
    learned = layer.detach().clone().requires_grad_(True)
    made, _ = feed.stage([index], np.random.default_rng(draw)).render(learned)
    made.backward(difference)
    assert learned.grad is not None
    return learned.grad
