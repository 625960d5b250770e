"""YAML files as mappings, and `key=value` overrides of them.

Plain values are read by the rules of YAML 1.2: `1e-3` is a number; `no`, `010`, `1:30` and `2024-01-01` are text. By
PyYAML's own rules, those of 1.1, all five are something else; ruamel.yaml makes numbers of `010` and objects of dates.

Files may come from strangers. So tags are not read, and what aliases and merge keys stand for is bounded: a few
lines of aliases to aliases would else fill the memory.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from svbrdfgan.errors import ConfigError
from svbrdfgan.utils.named_files import read_text

MOST_VALUES = 400_000
"""Values in a file: a manifest of 10,000 pictures has some 200,000. Saying what is wrong with more takes seconds."""


def load_yaml(path: Path) -> dict[str, Any]:
    """The mapping that a YAML file holds.

    Raises:
        ConfigError: the file is missing, is not YAML, repeats a key, has tags, stands for more than `MOST_VALUES`, or
            is not a mapping.
    """
    try:
        text = read_text(Path(path))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}.") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is not UTF-8 text; wanted a YAML file.") from error
    data = _parse(text, str(path))
    if not isinstance(data, dict):
        raise ConfigError(f"{path}: is {_kind(data)}; wanted a mapping, such as 'seed: 1'.")
    return data


def apply_overrides(data: Mapping[str, Any], overrides: Iterable[str]) -> dict[str, Any]:
    """A copy of the data with each "dotted.key=value" set; values are read as YAML.

    Raises:
        ConfigError: an override has no key or no `=`, its value is not YAML, or a part of its key is not a mapping.
    """
    changed = dict(data)
    for override in overrides:
        key, equals, text = override.partition("=")
        keys = key.strip().split(".")
        if not equals or not all(keys):
            raise ConfigError(f"{override!r} is not an override; wanted key=value, such as seed=1.")
        changed = _put(changed, keys, _parse(text, repr(override)), override)
    return changed


def _put(data: Mapping[str, Any], keys: list[str], value: object, override: str) -> dict[str, Any]:
    if len(keys) == 1:
        return {**data, keys[0]: value}
    inner = data.get(keys[0])
    if inner is not None and not isinstance(inner, Mapping):
        raise ConfigError(f"{override!r}: {keys[0]!r} is {_kind(inner)} and has no keys; override it whole.")
    return {**data, keys[0]: _put(inner or {}, keys[1:], value, override)}


def _kind(value: object) -> str:
    names = {type(None): "empty", list: "a list", str: "text"}
    return names.get(type(value), "a single value")


def _parse(text: str, source: str) -> Any:
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        raise ConfigError(f"{source}{where}: {error.problem}.") from error
    except RecursionError as error:
        raise ConfigError(f"{source}: is nested too deeply.") from error
    except (yaml.YAMLError, ValueError) as error:
        raise ConfigError(f"{source}: is not YAML: {str(error).splitlines()[0]}.") from error


def _require_few_values(node: yaml.Node, counted: dict[int, int]) -> int:
    """The number of values in a node, with each alias replaced by what it stands for."""
    if id(node) in counted:
        if not counted[id(node)]:
            raise yaml.composer.ComposerError(None, None, "an alias stands for what it lies in", node.start_mark)
        return counted[id(node)]
    counted[id(node)] = 0
    inner = [] if isinstance(node, yaml.ScalarNode) else node.value
    pieces = [piece for each in inner for piece in (each if isinstance(each, tuple) else (each,))]
    total = 1 + sum(_require_few_values(piece, counted) for piece in pieces)
    if total > MOST_VALUES:
        problem = f"with what aliases stand for, it has more than {MOST_VALUES:,} values"
        raise yaml.composer.ComposerError(None, None, problem, node.start_mark)
    counted[id(node)] = total
    return total


class _Loader(yaml.SafeLoader):
    """The safe loader, with the plain values of YAML 1.2; refuses repeated keys, keys that are not text, and tags."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # replaces the rules of 1.1

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event = self.peek_event()
        if (tag := getattr(event, "tag", None)) is not None:
            raise yaml.composer.ComposerError(
                None, None, f"the tag {tag!r} is not read; leave it out", event.start_mark
            )
        return super().compose_node(parent, index)

    def get_single_node(self) -> yaml.Node | None:
        root = super().get_single_node()
        if root is not None:
            _require_few_values(root, {})
        return root

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key, _ in node.value:
            if key.tag != _MERGE and not (key.tag == _TEXT and isinstance(key, yaml.ScalarNode)):
                raise yaml.constructor.ConstructorError(None, None, "a key that is not text", key.start_mark)
            if key.value in seen:
                raise yaml.constructor.ConstructorError(None, None, f"key {key.value!r} is given twice", key.start_mark)
            seen.add(key.value)
        return super().construct_mapping(node, deep=deep)


_TEXT = "tag:yaml.org,2002:str"
_MERGE = "tag:yaml.org,2002:merge"
for _tag, _pattern, _first in (
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("int", r"[-+]?(?:0|[1-9][0-9_]{0,30})|0x[0-9a-fA-F]{1,16}", list("-+0123456789")),
    (
        "float",
        r"[-+]?(?:\.[0-9]+|[0-9]+\.[0-9]*)(?:[eE][-+]?[0-9]+)?|[-+]?[0-9]+[eE][-+]?[0-9]+",
        list("-+.0123456789"),
    ),
    ("float", r"[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)", list("-+.")),
    ("merge", r"<<", ["<"]),
):
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(rf"^(?:{_pattern})$"), _first)
