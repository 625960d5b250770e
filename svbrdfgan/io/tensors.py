"""Save and load tensors with metadata as safetensors files, which cannot run code when they are opened."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from svbrdfgan.errors import AssetError
from svbrdfgan.io.atomic import atomic_path


def save_tensors(path: Path, kind: str, tensors: Mapping[str, Tensor], words: Mapping[str, str]) -> None:
    """Writes tensors (from any device) and the metadata `words`. `kind` identifies the file's format and version.

    Raises:
        AssetError: the file cannot be written there.
    """
    plain = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    with atomic_path(path) as temporary:  # not save_file: it creates files that only their owner may read
        temporary.write_bytes(save(plain, {"format": kind, **words}))


@contextmanager
def stored_tensors(path: Path, kind: str, remedy: str) -> Iterator[tuple[dict[str, Tensor], dict[str, str]]]:
    """The tensors (on the CPU) and metadata that `save_tensors` wrote.

    Lookup, type, value and asset errors inside the block are reported as a broken file, so the block should extract
    what it needs and do nothing else.

    Args:
        remedy: advice for the error message, such as "delete it, and it is made again".

    Raises:
        AssetError: the file is missing, damaged or of another kind, or lacks something that the block needs.
    """
    try:
        with safe_open(path, framework="pt") as file:
            words = file.metadata() or {}
            known = words.get("format") == kind
            tensors = {name: file.get_tensor(name) for name in file.keys()} if known else {}  # noqa: SIM118
        if known:
            yield tensors, words
    except (AssetError, OSError, SafetensorError, LookupError, TypeError, ValueError, RuntimeError) as error:
        raise AssetError(f"{path} cannot be read ({_reason(error)}); {remedy}.") from error
    if not known:
        raise AssetError(f"{path} is not a {kind!r} file; {remedy}.")


def _reason(error: Exception) -> str:
    """The error's message on one line."""
    return f"it has no {error}" if isinstance(error, KeyError) else " ".join(str(error).split())[:300].rstrip(".")
