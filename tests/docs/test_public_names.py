"""The public names are exactly those that docs/api.md lists."""

import ast
import importlib
import pkgutil
import re
import subprocess
import sys
from pathlib import Path

import pytest

import svbrdfgan

LIST = Path(__file__).parents[1] / "public_names.txt"
PUBLIC_MODULES = (
    *("svbrdfgan", "svbrdfgan.errors", "svbrdfgan.protocols", "svbrdfgan.types", "svbrdfgan.testing"),
    *("svbrdfgan.rendering.autograd_vjp", "svbrdfgan.geometry.cells", "svbrdfgan.geometry.normals"),
    *("svbrdfgan.geometry.split", "svbrdfgan.geometry.subdivide", "svbrdfgan.geometry.tangents"),
)


def listed(repository: Path) -> list[str]:
    text = (repository / "docs" / "api.md").read_text(encoding="utf-8")
    return re.findall(r"^\| `(\w+)` \| .+ \|$", text, re.MULTILINE)


def test_the_list_is_complete(repository: Path) -> None:
    names = listed(repository)
    assert sorted(names) == sorted(svbrdfgan.__all__)
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("name", svbrdfgan.__all__)
def test_every_name_leads_somewhere(name: str) -> None:
    value = getattr(svbrdfgan, name)
    assert isinstance(value, str) or value.__module__.startswith("svbrdfgan.")
    assert name in dir(svbrdfgan)


def test_the_stub_names_the_modules_that_define_each_name() -> None:
    for node in ast.parse(Path(svbrdfgan.__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body:
        for alias in node.names if isinstance(node, ast.ImportFrom) else ():
            assert alias.asname == alias.name, "a stub's import is public only as itself"
            assert getattr(importlib.import_module(node.module), alias.name) is getattr(svbrdfgan, alias.name)


def test_no_public_name_comes_or_goes_unannounced() -> None:
    """`tests/public_names.txt` lists them all: the package's, and those of the modules that plugins import."""
    found = "".join(f"{module}.{name}\n" for module in PUBLIC_MODULES for name in public_names(module))
    wanted = LIST.read_text(encoding="utf-8")
    assert found == wanted, f"public names changed: write them into {LIST.name}, docs/api.md and CHANGELOG.md"


def public_names(module: str) -> list[str]:
    """The names in `__all__`, or else those that the module itself defines, without a leading underscore."""
    loaded = importlib.import_module(module)
    own = (name for name, value in vars(loaded).items() if getattr(value, "__module__", None) == module)
    return sorted(getattr(loaded, "__all__", (name for name in own if not name.startswith("_"))))


def test_no_name_is_that_of_a_module() -> None:
    """Importing a module sets it as the package's attribute, which would hide the name."""
    assert not {module.name for module in pkgutil.iter_modules(svbrdfgan.__path__)} & set(svbrdfgan.__all__)


def test_names_are_imported_when_they_are_used() -> None:
    code = "import sys, svbrdfgan as s; s.SvbrdfganError; before = 'torch' in sys.modules; s.View; "
    code += "print(before, 'torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="Nonsense"):
        svbrdfgan.Nonsense  # noqa: B018
