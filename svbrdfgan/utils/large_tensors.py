"""Tensors that may be larger than memory: from a size on, a file takes the place of memory."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from mmap import mmap
from pathlib import Path
from tempfile import TemporaryFile

import torch
from torch import Tensor

from svbrdfgan.errors import AssetError
from svbrdfgan.utils.memory import allowed_bytes, gigabytes

_SHARE = 1 / 16
"""Of the memory that may be taken, what one tensor takes at most."""
_HALF = 2  # bytes


def half_tensor(shape: Sequence[int], folder: Path) -> Tensor:
    """Zeros in half precision. The system keeps in memory what it can of a tensor that `most_in_memory` says is large.

    Args:
        folder: where the file of a large one lies. It has no name, and is gone when the tensor or the process is.

    Raises:
        AssetError: the file cannot be made there.
    """
    size = _HALF * math.prod(shape)
    if size <= most_in_memory():
        return torch.zeros(tuple(shape), dtype=torch.half)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder) as file:
            if hasattr(os, "posix_fallocate"):  # else a disk that becomes full would kill the process
                os.posix_fallocate(file.fileno(), 0, size)
            file.truncate(size)
            return torch.frombuffer(mmap(file.fileno(), size), dtype=torch.half).reshape(tuple(shape))
    except OSError as error:
        raise AssetError(
            f"{folder} cannot hold {gigabytes(size)} of pictures, too much for memory ({error.strerror}); "
            "free some there, or allow more memory by --memory."
        ) from error


def most_in_memory() -> int:
    """The bytes from which on a tensor lies in a file."""
    return round(_SHARE * allowed_bytes())
