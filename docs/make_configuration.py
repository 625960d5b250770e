"""Makes `configuration.md` from the configuration models: `python docs/make_configuration.py`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import yaml
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from svbrdfgan.config.choices import PluginChoice
from svbrdfgan.config.distributions import Fixed, Integer, Name, Number, Paint
from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.data.photos.manifest import Manifest
from svbrdfgan.data.staged_photos.config import StagedPhotosConfig
from svbrdfgan.experiments.definition import Experiment
from svbrdfgan.scene.description import Scene
from svbrdfgan.training.config import TrainConfig

PAGE = Path(__file__).with_name("configuration.md")

FILES: dict[str, type[BaseModel]] = {
    "`dataset.yaml`": DatasetConfig,
    "`train.yaml`": TrainConfig,
    "The YAML file of staged photographs": StagedPhotosConfig,
    "The manifest of your own pictures": Manifest,
    "The YAML file of an experiment": Experiment,
    "The JSON file of a scene": Scene,
}
"""Each file and its model. A model that several files have is explained below the first."""

INTRODUCTION = """\
# Configuration

Every key of every file. `python docs/make_configuration.py` makes this page from the models in the code. The
[quickstart](quickstart.md) shows how to use `dataset.yaml` and `train.yaml`, [your own pictures](own-pictures.md) the
manifest, and [experiments](experiments.md) their files.

Paths in a YAML file, and shell patterns of files, are relative to that file. After the file's name in a command,
`KEY=VALUE` replaces a value by its dotted key, such as `spp=16 splits.train.views=4`.

## Distributions

A value that is drawn anew for each exemplar can be written as

| written | drawn |
|---|---|
| `5` or `{fixed: 5}` | always this value |
| `{uniform: [0, 360]}` | any number between two bounds, equally likely; not for names and colours |
| `{log_uniform: [0.1, 1]}` | a number between two bounds above 0, whose logarithm is equally likely; only for numbers |
| `{normal: [20, 5]}` | by mean and standard deviation, clamped to what is allowed; only for numbers |
| `{choice: [1, 2, 4]}` | one of several values, equally likely |
"""

_WORDS: dict[Any, str] = {
    bool: "boolean",
    int: "integer",
    float: "number",
    str: "text",
    Any: "any value",
    type(None): "`null`",
    PluginChoice: "name, or mapping with `name` and options",
    get_args(Number)[0]: "[distribution](#distributions) of numbers",
    get_args(Integer)[0]: "[distribution](#distributions) of integers",
    get_args(Name)[0]: "[distribution](#distributions) of names",
    get_args(Paint)[0]: "[distribution](#distributions) of colours",
}
_BOUNDS = {"ge": " ≥ {}", "gt": " > {}", "le": ", ≤ {}", "lt": ", < {}", "multiple_of": ", a multiple of {}"}


def page() -> str:
    """The text of `configuration.md`."""
    sections, explained = [INTRODUCTION], set[type[BaseModel]]()
    for title, model in FILES.items():
        sections.append(f"## {title}\n\n{_table(model)}")
        for part in _parts(model):
            if part not in explained:
                explained.add(part)
                sections.append(f"### {part.__name__}\n\n{str(part.__doc__).strip()}\n\n{_table(part)}")
    return "\n".join(sections)


def _table(model: type[BaseModel]) -> str:
    rows = [
        f"| `{name}` | {_type(field.annotation, field.metadata)} | {_default(field)} | {field.description} |"
        for name, field in model.model_fields.items()
    ]
    return "\n".join(["| key | type | default | meaning |", "|---|---|---|---|", *rows]) + "\n"


def _parts(model: type[BaseModel]) -> Iterator[type[BaseModel]]:
    """The models of a model's keys, each followed by its own; without itself."""
    for field in model.model_fields.values():
        for part in _models(field.annotation):
            if part is not model:
                yield part
                yield from _parts(part)


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    if annotation in _WORDS:
        return
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models(argument)


def _type(annotation: Any, metadata: Sequence[Any] = ()) -> str:
    if get_origin(annotation) is Annotated:
        inner, *further = get_args(annotation)
        return _type(inner, [each for m in further for each in (m.metadata if isinstance(m, FieldInfo) else [m])])
    if get_origin(annotation) in (Union, UnionType) and annotation not in _WORDS:
        first, *others = get_args(annotation)
        return _or([_type(first, metadata), *map(_type, others)])
    return _word(annotation) + "".join(_bounds(metadata))


def _word(annotation: Any) -> str:
    origin, arguments = get_origin(annotation), get_args(annotation)
    if annotation in _WORDS:
        return _WORDS[annotation]
    if origin is Literal:
        return _or(f"`{value}`" for value in arguments)
    if origin is tuple:
        several = "list of " if arguments[1] is ... else f"list of {len(arguments)}: "
        return several + _type(arguments[0])
    if origin is dict:
        return f"mapping from {_type(arguments[0])} to {_type(arguments[1])}"
    return f"[{annotation.__name__}](#{annotation.__name__.lower()})"


def _or(words: Iterable[str]) -> str:
    *most, last = words
    return f"{', '.join(most)} or {last}" if most else last


def _bounds(metadata: Iterable[Any]) -> Iterator[str]:
    for constraint in metadata:
        for name, text in _BOUNDS.items():
            bound = getattr(constraint, name, None)
            if bound is not None:
                yield text.format("2^63" if bound == 2**63 else bound)


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    text = yaml.safe_dump(_written(field.default), default_flow_style=True, width=10_000, sort_keys=False)
    return f"`{text.strip().removesuffix('...').strip()}`"


def _written(value: Any) -> Any:
    """A default as a user would write it."""
    if isinstance(value, PluginChoice) and not value.options:
        return value.name
    if isinstance(value, Fixed):
        return _written(value.fixed)
    if isinstance(value, BaseModel):
        return {
            name: _written(getattr(value, name)) for name in type(value).model_fields if name in value.model_fields_set
        }
    if isinstance(value, dict):
        return {key: _written(each) for key, each in value.items()}
    return [_written(each) for each in value] if isinstance(value, tuple) else value


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
