"""How much memory it takes to make a data set, and to hold the exemplars of one."""

from __future__ import annotations

from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.geometry.layers import surface_bytes
from svbrdfgan.rendering.picture_memory import picture_bytes
from svbrdfgan.scene.loader import KEPT
from svbrdfgan.scene.window import WHOLE
from svbrdfgan.utils.large_tensors import most_in_memory
from svbrdfgan.utils.memory import most_that_fits, require_memory

_SCENE = 8192  # bytes of an exemplar's scene, and of its place in the list of what is missing
_WORKER = 200 << 20  # bytes of a process that bakes, besides the libraries that it shares
_PICTURE = 10  # bytes of an exemplar's pixel in half precision, and some for the picture that is read
_BUFFER = 3  # bytes of a pixel and channel of a buffer in half precision, and some for the one that is rendered
_BUFFERS = 3  # kinds of buffers, at most
_SUBJECT = 160  # bytes of a texel of a subject that is held


def require_dataset(config: DatasetConfig, exemplars: int, processes: int = 1, workers: int = 1) -> int:
    """The bytes that making a data set takes at most, if they may be taken.

    Each process renders one picture at a time, and each worker beside them embeds one mesh. The main process lists the
    scenes of all exemplars. Measured as the peak of processes that make data sets of pictures of 64 to 3,072 pixels a
    side and of textures of 64 to 512 texels; those of more workers, of many exemplars and of windows are estimated.

    Args:
        exemplars: in all splits.
        processes: that render.
        workers: that embed and bake, together.

    Raises:
        ConfigError: more are needed than are allowed; it says how many pixels, texels or processes would fit.
    """
    (width, height), side = config.image, _layer_texels(config)

    def needed(rows: int = height, texels: int = side, count: int = exemplars, beside: int = workers) -> int:
        one = picture_bytes(max(1, rows * width // height), rows, texels)
        baked = _WORKER + surface_bytes(texels) - surface_bytes(0)
        return processes * one + _SCENE * count + (beside - 1) * baked

    def fitting(allowed: int) -> str | None:
        if (fits := most_that_fits(lambda n: needed(beside=n), workers, allowed)) is not None:
            return f"--workers {fits}"
        if (fits := most_that_fits(lambda n: needed(rows=n, beside=1), height, allowed)) is not None:
            return f"image=[{max(1, fits * width // height)},{fits}] with --workers 1"
        fits = most_that_fits(lambda n: needed(texels=n, beside=1), side, allowed, 16)
        if fits is not None and not config.windowed:
            return f"texture={fits} with --workers 1"
        fits = most_that_fits(lambda n: needed(count=n, beside=1), exemplars, allowed)
        return None if fits is None else f"{fits} exemplars with --workers 1"

    size = f"{width} x {height} pixels and layers of {side} texels a side"
    return require_memory(f"{exemplars or 'some'} exemplars of {size} need", needed(), fitting)


def exemplar_bytes(
    config: DatasetConfig, exemplars: int, meshes: int, channels: int = 0, *, scored: bool = False
) -> int:
    """What the exemplars of a split and their subjects take in memory once they are loaded.

    Pictures and buffers of more than `most_in_memory` lie in files. Each window is a subject of its own, beside the
    whole that it was cut from. Of both, the last `KEPT` are held.

    Args:
        channels: of buffers that the discriminator is shown with each picture.
        scored: whether generators are scored on the split, which holds what is compared of all its windows.
    """
    pixels = config.image[0] * config.image[1]
    whole, wholes, windows = config.texture, meshes, exemplars
    if config.windowed:
        whole, wholes = min(config.texture, WHOLE), min(meshes, KEPT)
        windows = exemplars if scored else min(exemplars, KEPT)
    subjects = _SUBJECT * (wholes * whole**2 + windows * (config.window or 0) ** 2)
    pictures, buffers = (exemplars * pixels * each for each in (_PICTURE, _BUFFER * channels))
    held = min(pictures, most_in_memory()) + min(buffers, _BUFFERS * most_in_memory())
    return exemplars * _SCENE + held + subjects


def _layer_texels(config: DatasetConfig) -> int:
    """Texels along a side of the largest map that is baked."""
    return max(config.window or 0, min(config.texture, WHOLE)) if config.windowed else config.texture
