"""Arrows point one way: types <- protocols <- core, backends, parameterizations. Parsed from every import statement."""

import ast
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]
PLUGINS = sorted(
    path.parent for place in ("backends", "parameterizations") for path in REPOSITORY.glob(f"{place}/*/__init__.py")
)
PLUGIN_NAMES = {folder.name for folder in PLUGINS}

CONTRACT = ("svbrdfgan.types", "svbrdfgan.protocols", "svbrdfgan.errors")
FOR_BACKENDS = (*CONTRACT, "svbrdfgan.geometry.tangents", "svbrdfgan.rendering.autograd_vjp")
FOR_EMBEDDINGS = (*CONTRACT, *(f"svbrdfgan.geometry.{name}" for name in ("cells", "normals", "split", "subdivide")))

ROOMS = (
    *("errors", "types", "protocols", "utils", "config", "geometry", "io", "rendering", "plugins", "procedural"),
    *("networks", "weathering", "models", "scene", "asset", "data", "metrics", "training", "evaluation", "inference"),
    *("report", "experiments", "bench", "testing", "viewer", "cli"),
)
"""The rooms of the core, lowest first: each imports only from itself and from those before it."""


LONGEST_CHAIN = 20
"""The most modules that may import one another in a row when they are loaded."""


def imports(
    source: str,
    module: str,
    is_package: bool = False,
    nodes: Callable[[ast.AST], Iterable[ast.AST]] = ast.walk,
) -> Iterator[str]:
    """The modules, and the names in them, that a module imports anywhere, or in these nodes; written out in full."""
    package = module.split(".") if is_package else module.split(".")[:-1]
    for node in nodes(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            start = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join([*start, *filter(None, [node.module])])
            yield from (f"{base}.{alias.name}" for alias in node.names)


def at_load(tree: ast.AST) -> Iterator[ast.AST]:
    """The nodes that run when a module is loaded: none in functions, and none for type checkers alone."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            yield from at_load(ast.Module(node.orelse, []))
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            yield node
            yield from at_load(node)


def loaded(source: str, module: str, known: Iterable[str], is_package: bool = False) -> set[str]:
    """The known modules that a module imports when it is loaded, without the packages that it is in itself.

    `from a.b import c` counts as an import of `a.b`, and of `a.b.c` if that is a module.
    """
    names = list(imports(source, module, is_package, at_load))
    found = {*names, *(name.rpartition(".")[0] for name in names)} & set(known)
    return {name for name in found if not within(module, name)}


def longest_chain(graph: Mapping[str, Iterable[str]]) -> list[str]:
    """The longest chain of modules in which each imports the next.

    Raises:
        CycleError: modules import each other in a circle.
    """
    chains: dict[str, list[str]] = {}
    for module in TopologicalSorter(graph).static_order():
        chains[module] = [module, *max((chains[name] for name in graph.get(module, ())), key=len, default=[])]
    return max(chains.values(), key=len)


def within(name: str, *allowed: str) -> bool:
    return any(name == prefix or name.startswith(f"{prefix}.") for prefix in allowed)


def forbidden_in_core(module: str, names: Iterator[str]) -> list[str]:
    """What a module of the core imports though it must not: plugins, and rooms above its own.

    The package's own `__init__` may name everything, since it imports lazily, and so may `__main__`.
    """
    parts = module.split(".")
    if parts[1:] in ([], ["__main__"]):
        below: tuple[str, ...] = ("svbrdfgan",)
    else:
        below = ("svbrdfgan.__version__", *(f"svbrdfgan.{room}" for room in ROOMS[: ROOMS.index(parts[1]) + 1]))
    return [
        name
        for name in names
        if name.split(".")[0] in PLUGIN_NAMES or (within(name, "svbrdfgan") and not within(name, *below))
    ]


def forbidden_in_plugin(own: str, names: Iterator[str], allowed: tuple[str, ...]) -> list[str]:
    """What a module of a plugin imports though it must not: the core beyond the contract, and other plugins."""
    return [
        name
        for name in names
        if name.split(".")[0] in PLUGIN_NAMES - {own} or (within(name, "svbrdfgan") and not within(name, *allowed))
    ]


def modules(folder: Path) -> list[tuple[str, Path]]:
    """Each module below the folder of a package, by its full name."""
    found = []
    for path in sorted(folder.rglob("*.py")):
        parts = [folder.name, *path.relative_to(folder).with_suffix("").parts]
        found.append((".".join(parts[:-1] if parts[-1] == "__init__" else parts), path))
    return found


def imports_of(module: str, path: Path) -> Iterator[str]:
    return imports(path.read_text(encoding="utf-8"), module, path.name == "__init__.py")


def test_the_core_imports_no_plugin_and_nothing_upward() -> None:
    found = {
        module: forbidden_in_core(module, imports_of(module, path))
        for module, path in modules(REPOSITORY / "svbrdfgan")
    }
    assert {module: names for module, names in found.items() if names} == {}


def test_every_room_has_its_place() -> None:
    """A room is a package folder, or a loose module at the package's top."""
    entries = {path.stem for path in (REPOSITORY / "svbrdfgan").iterdir() if not path.name.startswith(("_", "py."))}
    assert entries == set(ROOMS)


def test_no_chain_of_imports_is_long() -> None:
    folders = (REPOSITORY / "svbrdfgan", *PLUGINS)
    known = {module: path for folder in folders for module, path in modules(folder)}
    graph = {
        module: loaded(path.read_text(encoding="utf-8"), module, known, path.name == "__init__.py")
        for module, path in known.items()
    }
    chain = longest_chain(graph)
    assert len(chain) <= LONGEST_CHAIN, f"{len(chain)} modules import one another in a row: {' > '.join(chain)}"


@pytest.mark.parametrize("folder", PLUGINS, ids=lambda folder: folder.name)
def test_a_plugin_imports_the_contract_alone(folder: Path) -> None:
    allowed = FOR_EMBEDDINGS if folder.parent.name == "parameterizations" else FOR_BACKENDS
    found = {m: forbidden_in_plugin(folder.name, imports_of(m, path), allowed) for m, path in modules(folder)}
    assert {module: names for module, names in found.items() if names} == {}


def test_importing_the_package_imports_neither_torch_nor_a_plugin() -> None:
    code = "import sys, svbrdfgan; print(*(name.split('.')[0] for name in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "svbrdfgan" in done.stdout.split()
    assert set(done.stdout.split()) & ({"torch", "warp", "pydantic"} | PLUGIN_NAMES) == set()


@pytest.mark.parametrize(
    ("module", "source", "found"),
    [
        ("svbrdfgan.data.index", "import svbrdfgan_numpy.trace", ["svbrdfgan_numpy.trace"]),
        (
            "svbrdfgan.geometry.bake",
            "def f():\n    from svbrdfgan_warp import WarpRenderer",
            ["svbrdfgan_warp.WarpRenderer"],
        ),
        ("svbrdfgan.data.index", "from svbrdfgan import plugins\nfrom .io import read", []),
        ("svbrdfgan.types.view", "from svbrdfgan.protocols import Renderer", ["svbrdfgan.protocols.Renderer"]),
        ("svbrdfgan.types.view", "from .. import data\nfrom ..errors import AssetError", ["svbrdfgan.data"]),
        ("svbrdfgan.protocols", "from svbrdfgan import data", ["svbrdfgan.data"]),
        ("svbrdfgan.scene.subject", "from svbrdfgan.data.config import Split", ["svbrdfgan.data.config.Split"]),
        ("svbrdfgan.errors", "import svbrdfgan.types", ["svbrdfgan.types"]),
    ],
)
def test_the_rule_for_the_core_bites(module: str, source: str, found: list[str]) -> None:
    assert forbidden_in_core(module, imports(source, module)) == found


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("from svbrdfgan.types import Mesh\nfrom . import trace\nimport numpy", []),
        ("import svbrdfgan", ["svbrdfgan"]),
        ("from svbrdfgan import data", ["svbrdfgan.data"]),
        ("import svbrdfgan.geometry as g", ["svbrdfgan.geometry"]),
        ("import svbrdfgan_warp", ["svbrdfgan_warp"]),
    ],
)
def test_the_rule_for_backends_bites(source: str, found: list[str]) -> None:
    names = imports(source, "svbrdfgan_numpy.renderer")
    assert forbidden_in_plugin("svbrdfgan_numpy", names, FOR_BACKENDS) == found


def test_the_rule_for_chains_bites() -> None:
    graph = {f"a.m{number}": {f"a.m{number + 1}"} for number in range(LONGEST_CHAIN)} | {"a.short": {"a.m7"}}
    assert longest_chain(graph) == [f"a.m{number}" for number in range(LONGEST_CHAIN + 1)]
    with pytest.raises(CycleError):
        longest_chain({**graph, f"a.m{LONGEST_CHAIN}": {"a.m0"}})


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("from a.b import c", {"a.b", "a.b.c"}),
        ("from a.b import name", {"a.b"}),
        ("from .b.c import name\nimport a.d", {"a.b.c", "a.d"}),
        ("try:\n    import a.d\nexcept ImportError:\n    from a.b import c", {"a.b", "a.b.c", "a.d"}),
        ("class K:\n    import a.d", {"a.d"}),
        ("def f():\n    import a.d", set()),
        (
            "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import a.d\nelse:\n    import a.b.c",
            {"a.b", "a.b.c"},
        ),
        ("from a import d", {"a.d"}),
    ],
)
def test_what_a_module_loads(source: str, found: set[str]) -> None:
    assert loaded(source, "a.m", {"a", "a.b", "a.b.c", "a.d", "a.m"}) == found
