"""docs/architecture.md is true: paths exist, functions are in their files, the order of rooms is the checked one."""

import ast
import re
from pathlib import Path

import pytest

PATH = re.compile(r"`((?:[\w.-]+/)+(?:[\w.-]+)?)`")
NAMED = re.compile(r"`((?:[\w.-]+/)+[\w-]+\.py)`:|`([\w.]+)\(\)`")
PACKAGES = ("svbrdfgan", "backends", "parameterizations")


@pytest.fixture(scope="module")
def page(repository: Path) -> str:
    return (repository / "docs" / "architecture.md").read_text(encoding="utf-8")


def rooms(repository: Path) -> tuple[str, ...]:
    """The rooms of the core, lowest first, from the test of imports."""
    text = (repository / "tests" / "test_architecture.py").read_text(encoding="utf-8")
    (found,) = re.findall(r"^ROOMS = \((.*?)^\)", text, re.MULTILINE | re.DOTALL)
    return tuple(re.findall(r'"(\w+)"', found))


def defined(path: Path) -> set[str]:
    """The functions of a module, and the methods of its classes as `Class.method`."""
    names = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef):
            names.add(node.name)
        elif isinstance(node, ast.ClassDef):
            names |= {node.name} | {f"{node.name}.{n.name}" for n in node.body if isinstance(n, ast.FunctionDef)}
    return names


def named_functions(text: str) -> set[tuple[str, str]]:
    """Each `name()` with the file that was named last before it, as `path/file.py`: ..."""
    pairs, path = set(), ""
    for file, name in NAMED.findall(text):
        path = file or path
        if name:
            pairs.add((path, name))
    return pairs


def absent(repository: Path, pairs: set[tuple[str, str]]) -> list[str]:
    """The names that are not in the file that the page gives."""
    return sorted(f"{path}: {name}" for path, name in pairs if name not in defined(repository / path))


def test_every_path_exists(page: str, repository: Path) -> None:
    paths = set(PATH.findall(page))
    assert [path for path in sorted(paths) if not (repository / path).exists()] == []
    assert len(paths) >= 15


def test_every_function_is_in_its_file(page: str, repository: Path) -> None:
    pairs = named_functions(page)
    assert absent(repository, pairs) == []
    assert len(pairs) >= 30


def test_a_function_that_moved_is_found(repository: Path) -> None:
    pairs = named_functions("1. `svbrdfgan/cli/train.py`: `command()` and\n   `gone()` of `svbrdfgan/io/mesh.py`.")
    assert pairs == {("svbrdfgan/cli/train.py", "command"), ("svbrdfgan/cli/train.py", "gone")}
    assert absent(repository, pairs) == ["svbrdfgan/cli/train.py: gone"]


def test_the_tree_has_every_package_and_room(page: str, repository: Path) -> None:
    tree = page.split("## The tree")[1].split("\n## ")[0]
    folders = {
        path.parent.relative_to(repository).as_posix() + "/"
        for top in PACKAGES
        for path in (repository / top).rglob("__init__.py")
    } - {"svbrdfgan/"}
    modules = {f"svbrdfgan/{room}.py" for room in rooms(repository) if (repository / f"svbrdfgan/{room}.py").is_file()}
    listed = set(re.findall(r"^\| `([^`]+)`", tree, re.MULTILINE))
    assert folders | modules <= listed


def test_the_tree_has_every_folder_of_tests(page: str, repository: Path) -> None:
    folders = {path.name for path in (repository / "tests").iterdir() if path.is_dir() and any(path.rglob("*.py"))}
    explained = set(re.findall(r"`tests/(\w+)/`", page))
    assert folders - explained <= set(rooms(repository))


def test_the_order_is_the_one_that_is_checked(page: str, repository: Path) -> None:
    (diagram,) = re.findall(r"^```\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    lines = [line.split("|")[1].split() for line in reversed(diagram.splitlines())]
    assert tuple(room for line in lines for room in line) == rooms(repository)
