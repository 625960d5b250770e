"""Save and load configuration-model records as readable JSON files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from svbrdfgan.config.models import Model, StrictModel, validate
from svbrdfgan.errors import AssetError
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.utils.named_files import parse_json, read_text


def save_record(path: Path, record: StrictModel) -> None:
    """Writes all fields of a record, defaults included.

    Raises:
        AssetError: the file cannot be written there.
    """
    with atomic_path(path) as temporary:
        temporary.write_text(record.model_dump_json(indent=1) + "\n", encoding="utf-8")


def load_record(model: type[Model], path: Path) -> Model:
    """Reads a record that `save_record` wrote.

    Raises:
        AssetError: the file is missing or not JSON.
        ConfigError: a key is unknown or a value is invalid.
    """
    return validate(model, load_json(path), str(path))


def load_json(path: Path) -> Any:
    """The contents of a JSON file.

    Raises:
        AssetError: the file is missing or not JSON.
    """
    try:
        return parse_json(read_text(path))
    except OSError as error:
        raise AssetError(f"{path} cannot be read: {error.strerror or error}.") from error
    except ValueError as error:
        raise AssetError(f"{path} is not valid JSON: {error}.") from error
