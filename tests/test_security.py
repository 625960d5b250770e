"""What SECURITY.md promises of the code as a whole; it names the tests of the rest, which must be there."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

REPOSITORY = Path(__file__).parents[1]
PAGE = (REPOSITORY / "SECURITY.md").read_text(encoding="utf-8")
SOURCES = sorted(
    path for folder in ("svbrdfgan", "backends", "parameterizations") for path in (REPOSITORY / folder).rglob("*.py")
)
RUNS_CODE = {"eval", "exec", "os.system", "os.popen", "torch.load", "pickle.load", "pickle.loads", "yaml.unsafe_load"}
NETWORK = {"ftplib", "http", "requests", "smtplib", "socket", "socketserver", "ssl", "urllib.request", "webbrowser"}
KIT = "svbrdfgan/testing/contract.py"
"""Pickles and unpickles a plugin of its own."""


def identity(path: Path) -> str:
    return path.relative_to(REPOSITORY).as_posix()


def parsed(pattern: str) -> dict[str, ast.AST]:
    """The modules of the product whose text has the pattern."""
    texts = {identity(path): path.read_text(encoding="utf-8") for path in SOURCES}
    return {name: ast.parse(text) for name, text in texts.items() if re.search(pattern, text)}


def calls(tree: ast.AST) -> Iterator[ast.Call]:
    return (node for node in ast.walk(tree) if isinstance(node, ast.Call))


def imported(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


def test_no_file_is_run_or_unpickled() -> None:
    trees = parsed("|".join({rf"\b{name.rpartition('.')[2]}\(" for name in RUNS_CODE}))
    found = {(name, call) for name, tree in trees.items() for call in calls(tree) if ast.unparse(call) != "exec('')"}
    runs = {(name, ast.unparse(call.func)) for name, call in found}
    assert {each for each in runs if each[1] in RUNS_CODE} == {(KIT, "pickle.loads")}
    loaders = [
        [ast.unparse(word) for word in call.keywords]
        for tree in parsed(r"yaml\.load\(").values()
        for call in calls(tree)
        if ast.unparse(call.func) == "yaml.load"
    ]
    assert loaders == [["Loader=_Loader"]]


def test_no_shell_is_started_and_no_array_runs_code() -> None:
    trees = parsed("shell|allow_pickle")
    assert not {"shell", "allow_pickle"} & {
        word.arg for tree in trees.values() for call in calls(tree) for word in call.keywords
    }


def test_only_the_viewer_knows_of_a_network() -> None:
    trees = parsed("|".join(map(re.escape, NETWORK)))
    assert {
        (name, module)
        for name, tree in trees.items()
        for module in imported(tree)
        if module in NETWORK or module.partition(".")[0] in NETWORK
    } == {
        ("svbrdfgan/viewer/server.py", "http"),
        ("svbrdfgan/viewer/server.py", "http.server"),
        ("svbrdfgan/cli/view.py", "webbrowser"),
    }


def test_programs_are_started_by_the_modules_that_the_page_names() -> None:
    starting = {name for name, tree in parsed("subprocess").items() if "subprocess" in set(imported(tree))}
    assert starting == set(re.findall(r"`([\w/]+\.py)`", PAGE.partition("## Programs")[2]))


def test_the_tests_that_the_page_names_are_there() -> None:
    named = re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", PAGE)
    assert len(named) > 10
    for path, test in named:
        assert f"def {test}" in (REPOSITORY / path).read_text(encoding="utf-8"), (path, test)


def test_the_page_is_short() -> None:
    assert len(PAGE.splitlines()) <= 120
