"""How much memory a run takes while it trains or is scored."""

from __future__ import annotations

import math

import torch

from svbrdfgan.data.config import Split
from svbrdfgan.data.memory import exemplar_bytes
from svbrdfgan.scene.window import WHOLE
from svbrdfgan.training.config import TrainConfig
from svbrdfgan.training.refined_layers import kept_bytes
from svbrdfgan.training.resolve import ResolvedRun
from svbrdfgan.types import layer_channels
from svbrdfgan.utils.memory import PROGRAM, most_that_fits, require_memory

_RENDERER = 130 << 20  # bytes of a renderer's libraries and kernels
_TEXEL = 400  # bytes of a texel of a layer, of its gradients, and of what the generator reads
_FEATURE = 100  # bytes of a texel for each channel of the generator's width, without its blocks
_BLOCK_FEATURE = 32  # bytes of a texel of the coarsest features, for each channel of the width and block
_PATCH_FEATURE = 12  # bytes of a pixel for each channel of the discriminator's width
_WHOLE = 88  # bytes of a texel of a whole map that generators of windows read: as it was read, and on the device
_COPIES = 5  # of a generator's weight in float32: itself, its gradient, Adam's two means, and the average


def run_bytes(run: ResolvedRun, splits: tuple[Split, ...], device: torch.device, *, learns: bool = True) -> int:
    """What the process holds at most in main memory, without what takes what is left of its share.

    That is stored light, and on a CPU the inputs of windows that are not read anew.

    On a GPU, features and weights are not in main memory. Fitted to the peaks of processes that train generators of 16
    to 64 channels and 6 to 16 blocks on batches of 1 and 4 at 64 and 256 texels, on a CPU; what windows hold, and
    scoring, is estimated.

    Args:
        splits: whose exemplars are held.
        learns: whether gradients are taken; without, a batch is one layer.
    """
    config, index = run.config, run.dataset.index
    shown = config.discriminator
    channels = 6 * shown.gbuffer + 9 * shown.light_buffer + 3 * shown.clean_picture
    held = sum(
        exemplar_bytes(
            index.config,
            len(index.sampler(split)),
            len(index.meshes[split]),
            channels,
            scored=not learns or split != "train",
        )
        for split in splits
        if split in index.config.splits
    )
    if config.generator.refined is not None:
        held += _WHOLE * len(index.meshes["train"]) * min(index.config.texture, WHOLE) ** 2
    if device.type == "cuda":
        return config.devices * (PROGRAM + _RENDERER + held)
    networks = _network_bytes(config, index.config.image, run.layer_texels, learns)
    refined = _refined_bytes(run) if learns and config.generator.refined is not None else 0
    return config.devices * (PROGRAM + _RENDERER + held + refined) + networks


def require_run(run: ResolvedRun, splits: tuple[Split, ...], device: torch.device, *, learns: bool = True) -> int:
    """The bytes of `run_bytes`, if they may be taken.

    Raises:
        ConfigError: more are needed than are allowed; it says which batch would fit.
    """

    def needed(batch: int) -> int:
        return run_bytes(run.with_config(batch_size=batch), splits, device, learns=learns)

    def fitting(allowed: int) -> str | None:
        fits = most_that_fits(needed, run.config.batch_size, allowed) if learns else None
        return None if fits is None else f"batch_size={fits}"

    exemplars = sum(len(run.dataset.index.sampler(split)) for split in splits if split in run.dataset.config.splits)
    doing = f"training on batches of {run.config.batch_size} with" if learns else "scoring"
    instead = "allow more by --memory, or make a data set with fewer or smaller pictures"
    return require_memory(
        f"{doing} {exemplars} exemplars needs", needed(run.config.batch_size), fitting, instead=instead
    )


def _refined_bytes(run: ResolvedRun) -> int:
    """Of the layers that a generator refines."""
    index = run.dataset.index
    share = run.layer_texels / index.config.texture
    side = math.ceil(share * min(index.config.texture, WHOLE))
    return kept_bytes(len(index.sampler("train")), side, layer_channels(tuple(index.config.maps)))


def _network_bytes(config: TrainConfig, image: tuple[int, int], texels: int, learns: bool) -> int:
    """Of features and weights."""
    generator, discriminator = config.generator, config.discriminator
    deep = generator.width << generator.downsamplings
    weights = 4 * 9 * (2 * generator.blocks + 2) * deep**2
    if not learns:
        return weights + texels**2 * (_TEXEL + _FEATURE * generator.width)
    blocks = _BLOCK_FEATURE * generator.blocks / 2**generator.downsamplings
    features = texels**2 * (_TEXEL + generator.width * (_FEATURE + blocks))
    patches = image[0] * image[1] * discriminator.width * _PATCH_FEATURE
    return round(config.batch_size * (features + patches)) + _COPIES * weights
