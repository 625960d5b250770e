"""YAML of strangers: one sentence instead of a hang, a full memory or a traceback."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from svbrdfgan.config.yaml_files import MOST_VALUES, apply_overrides, load_yaml
from svbrdfgan.errors import ConfigError

LAUGHS = "a0: &a0 [lol, lol, lol, lol, lol, lol, lol, lol, lol, lol]\n" + "".join(
    f"a{n + 1}: &a{n + 1} [{', '.join([f'*a{n}'] * 10)}]\n" for n in range(12)
)
MERGES = "a0: &a0 {k: 1}\n" + "".join(
    f"a{n + 1}: &a{n + 1} {{<<: [{', '.join([f'*a{n}'] * 10)}]}}\n" for n in range(12)
)


def loaded(text: str, folder: Path) -> dict[str, object]:
    path = folder / "config.yaml"
    path.write_text(text, encoding="utf-8")
    return load_yaml(path)


@contextmanager
def calls_at_most(limit: int) -> Iterator[None]:
    """Fails as soon as more functions have been called: work is counted, since time depends on the machine."""
    made = 0

    def count(*_: object) -> None:
        nonlocal made
        made += 1
        if made > limit:
            sys.setprofile(None)
            pytest.fail(f"it made more than {limit:,} calls")

    before = sys.getprofile()
    sys.setprofile(count)
    try:
        yield
    finally:
        sys.setprofile(before)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (LAUGHS, f"more than {MOST_VALUES:,} values"),
        (MERGES, f"more than {MOST_VALUES:,} values"),
        ("a: &a [*a]", "an alias stands for what it lies in"),
        ("a: &a {<<: *a}", "an alias stands for what it lies in"),
        ("seed: " + 2000 * "[" + 2000 * "]", "is nested too deeply"),
        *(
            (f"seed: !!{tag} x", f"the tag 'tag:yaml.org,2002:{tag}' is not read")
            for tag in ("int", "bool", "timestamp")
        ),
        ("seed: !!map [1]", "line 1, column 7: the tag"),
        ("seed: !!python/name:os.system", "the tag 'tag:yaml.org,2002:python/name:os.system' is not read"),
    ],
)
def test_what_would_fill_memory_or_run_code_is_refused_at_once(text: str, said: str, tmp_path: Path) -> None:
    with calls_at_most(1_000_000), pytest.raises(ConfigError, match=said):
        loaded(text, tmp_path)


def test_a_few_aliases_and_merges_are_read(tmp_path: Path) -> None:
    text = "usual: &usual {views: 8}\ntrain: {<<: *usual, views: 20}\ntest: *usual\n"
    assert loaded(text, tmp_path) == {"usual": {"views": 8}, "train": {"views": 20}, "test": {"views": 8}}


def test_numbers_that_are_too_long_are_text(tmp_path: Path) -> None:
    assert loaded(f"seed: {'9' * 5000}", tmp_path) == {"seed": "9" * 5000}
    assert apply_overrides({}, ["seed=12_345"]) == {"seed": 12345}
