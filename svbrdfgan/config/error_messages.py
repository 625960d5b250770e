"""Error messages for what is wrong in a configuration."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from typing import TYPE_CHECKING, Any, get_args

if TYPE_CHECKING:
    from pydantic import ValidationError
    from pydantic_core import ErrorDetails

_WANTED = {
    "bool_type": "true or false",
    "dict_type": "a mapping of keys",
    "finite_number": "a finite number",
    "float_type": "a number",
    "greater_than": "a number above {gt}",
    "greater_than_equal": "a number of at least {ge}",
    "int_type": "an integer",
    "less_than": "a number below {lt}",
    "less_than_equal": "a number of at most {le}",
    "list_type": "a list",
    "literal_error": "{expected}",
    "model_type": "a mapping of keys",
    "none_required": "nothing",
    "string_too_short": "text of at least {min_length} characters",
    "string_type": "text",
    "too_long": "at most {max_length} values",
    "too_short": "at least {min_length} values",
    "tuple_type": "a list",
}
"""Words for what is wanted, by pydantic's type of error. pydantic's own words serve for other types."""

RENAMED = {
    "chance": "random_fields",
    "fresh": "online",
    "guide": "gbuffer",
    "light": "light_buffer",
    "sees": "compares",
    "transport": "stored",
}
"""Earlier names of keys and values, and the new ones. A name counts only where the new one is allowed instead."""

Location = Sequence[int | str]


def explain(error: ValidationError, model: type, data: object) -> list[tuple[str, str]]:
    """The path of the key and a sentence, for each error. The errors of a union's members become one."""
    messages: list[tuple[str, str]] = []
    wanted: dict[tuple[str, str], list[str]] = {}
    for detail in error.errors(include_url=False):
        location, context = detail["loc"], detail.get("ctx", {})
        if detail["type"] == "extra_forbidden":
            messages.append(_unknown(_path(location[:-1], data), str(location[-1]), set(_keys(model, location[:-1]))))
        elif detail["type"] == "missing" and isinstance(location[-1], int):
            wanted.setdefault((_path(location[:-1], data), as_text(detail["input"])), []).append("more values")
        elif detail["type"] == "missing":
            messages.append((_path(location[:-1], data), f"key {str(location[-1])!r} is missing."))
        elif "error" in context:
            messages.append((_path(location, data), str(context["error"])))
        else:
            wanted.setdefault((_path(location, data), as_text(detail["input"])), []).append(_wanted(detail))
    return messages + [
        (path, f"{given} is not allowed; wanted {' or '.join(dict.fromkeys(several))}.")
        for (path, given), several in wanted.items()
    ]


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """ "; did you mean 'x'?" for the closest of the known names; empty if none is close."""
    close = difflib.get_close_matches(name, list(known), n=1)
    return f"; did you mean {close[0]!r}?" if close else ""


def _unknown(path: str, key: str, known: Set[str]) -> tuple[str, str]:
    if RENAMED.get(key) in known:
        below = f"{path}." if path else ""
        return "", f"{below}{key} is now {below}{RENAMED[key]}."
    names = sorted(known)
    hint = did_you_mean(key, names) or (f"; known are {', '.join(names)}." if names else "; none is wanted here.")
    return path, f"unknown key {key!r}{hint}"


def _wanted(detail: ErrorDetails) -> str:
    context = detail.get("ctx", {})
    template = _WANTED.get(detail["type"])
    if template is None:
        return detail["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
    return template.format(**context) + (_closest_choice(detail) if detail["type"] == "literal_error" else "")


def _closest_choice(detail: ErrorDetails) -> str:
    given, known = detail["input"], detail["ctx"]["expected"].split("'")[1::2]
    if not isinstance(given, str):
        return ""
    new = RENAMED.get(given)
    return f"; {given!r} is now {new!r}" if new in known else did_you_mean(given, known).rstrip("?")


def as_text(value: object) -> str:
    """A value of a configuration as YAML has it, cut after 60 characters."""
    text = {True: "true", False: "false", None: "nothing"}.get(value) if isinstance(value, bool | None) else repr(value)
    return text if text and len(text) <= 60 else f"{str(text)[:57]}..."


def _path(location: Location, data: object) -> str:
    """The location as the user would write it, without pydantic's labels of a union's members."""
    path = ""
    for step in location:
        if isinstance(data, Mapping) and step in data:
            data, path = data[step], f"{path}.{step}"
        elif isinstance(data, list | tuple) and isinstance(step, int) and step < len(data):
            data, path = data[step], f"{path}[{step}]"
    return path.removeprefix(".")


def _keys(model: Any, location: Location) -> Iterator[str]:
    """The keys of the model at the location within a type."""
    fields = getattr(model, "model_fields", None)
    if fields is None:
        for inner in get_args(model):
            yield from _keys(inner, location)
            yield from _keys(inner, location[1:]) if location else ()
    elif not location:
        yield from (field.alias or name for name, field in fields.items())
    else:
        for name, field in fields.items():
            if location[0] == (field.alias or name):
                yield from _keys(field.annotation, location[1:])
        if location[0] == model.__name__:
            yield from _keys(model, location[1:])
