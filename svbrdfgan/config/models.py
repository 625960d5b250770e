"""Strict validation of what users write: configuration models, and the options of plugins.

Only two conversions are made, for things that YAML cannot express: integer to float, and list to tuple. Every error
becomes one line that names the key, the given value and what is wanted.
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Mapping
from typing import Any, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model
from pydantic_core import PydanticUndefined

from svbrdfgan.config.error_messages import explain
from svbrdfgan.errors import ConfigError

_STRICT = ConfigDict(strict=True, frozen=True, extra="forbid", allow_inf_nan=False, arbitrary_types_allowed=True)

Model = TypeVar("Model", bound=BaseModel)
Made = TypeVar("Made")


class StrictModel(BaseModel):
    """Base of configuration models: frozen, without unknown keys, conversions or infinities."""

    model_config = _STRICT

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy in which some values are others.

        Raises:
            TypeError: the model has no such key, which pydantic itself would not notice.
        """
        if unknown := set(update or ()) - set(type(self).model_fields):
            raise TypeError(f"{type(self).__name__} has no {', '.join(sorted(unknown))}")
        return super().model_copy(update=update, deep=deep)


def validate(model: type[Model], data: object, source: str) -> Model:
    """The model that the data describe; `source`, such as the file's name, begins every message.

    Raises:
        ConfigError: the data are wrong; one line for each error.
    """
    text = _as_json(data, source)
    try:
        return model.model_validate_json(text)
    except ValidationError as error:
        lines = [
            f"{source}: {path}: {message}" if path else f"{source}: {message}"
            for path, message in explain(error, model, data)
        ]
        raise ConfigError(*lines) from error
    except ConfigError as error:
        raise ConfigError(*(f"{source}: {sentence}" for sentence in error.args)) from error


def build(factory: Callable[..., Made], options: Mapping[str, object], path: str) -> Made:
    """`factory(**options)`, if the options fit its annotated keyword parameters; messages name them by `path`.

    Raises:
        ConfigError: an option is unknown, missing, of the wrong type, or refused by the factory itself.
        TypeError: the factory's annotations cannot be resolved, or are not types.
    """
    model, names = _options_model(factory)
    text = _as_json(dict(options), path)
    try:
        checked = model.model_validate_json(text)
    except ValidationError as error:
        lines = [
            f"{path}.{key}: {message}" if key else f"{path}: {message}"
            for key, message in explain(error, model, options)
        ]
        raise ConfigError(*lines) from error
    given = {name: getattr(checked, field) for field, name in names.items() if field in checked.model_fields_set}
    try:
        return factory(**given)
    except ConfigError as error:
        raise ConfigError(*(f"{path}: {sentence}" for sentence in error.args)) from error


def default_options(factory: Callable[..., object]) -> dict[str, object]:
    """The options that `build` accepts for a factory, with their defaults; options without a default are left out."""
    return {p.name: p.default for p in _usable(inspect.signature(factory)) if p.default is not p.empty}


def differences(mine: Mapping[str, Any], its: Mapping[str, Any], path: str = "") -> list[str]:
    """The differences between two dumps of models, sorted by dotted key, such as `loss.r1 0.1, not 1.0`."""
    found: list[str] = []
    for key in sorted(mine.keys() | its.keys()):
        a, b, name = mine.get(key), its.get(key), f"{path}{key}"
        if isinstance(a, dict) and isinstance(b, dict):
            found += differences(a, b, f"{name}.")
        elif a != b:
            found.append(f"{name} {_abbreviated(a)}, not {_abbreviated(b)}")
    return found


def _abbreviated(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _options_model(factory: Callable[..., object]) -> tuple[type[BaseModel], dict[str, str]]:
    """A model with one aliased field for each keyword parameter, and the parameter of each field."""
    try:
        usable = _usable(inspect.signature(factory, eval_str=True))
    except NameError as error:
        raise TypeError(f"the annotations of {factory!r} cannot be resolved: {error}") from error
    names = {f"option_{number}": parameter.name for number, parameter in enumerate(usable)}
    fields: dict[str, Any] = {
        field: (
            Any if p.annotation is p.empty else p.annotation,
            Field(PydanticUndefined if p.default is p.empty else p.default, alias=p.name),
        )
        for field, p in zip(names, usable, strict=True)
    }
    return create_model("Options", __config__=_STRICT, **fields), names


def _usable(signature: inspect.Signature) -> list[inspect.Parameter]:
    return [p for p in signature.parameters.values() if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]


def _as_json(data: object, source: str) -> str:
    """The data as JSON, for which pydantic's strict rules are right: a list may become a tuple, "3" is not a number."""
    try:
        return json.dumps(data)
    except (TypeError, ValueError, RecursionError) as error:
        raise ConfigError(f"{source}: wanted only numbers, text, lists and mappings: {error}.") from error
