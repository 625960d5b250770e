"""What several commands read from their command line."""

from __future__ import annotations

from typing import Any

from svbrdfgan.yaml_files import apply_overrides


def key_values(pairs: tuple[str, ...]) -> dict[str, Any]:
    """Options from KEY=VALUE words, the values as in YAML.

    Raises:
        ConfigError: a word is not of that form.
    """
    return apply_overrides({}, pairs)
