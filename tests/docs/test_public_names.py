"""The public names are exactly those that docs/api.md lists."""

import importlib
import pkgutil
import re
import subprocess
import sys
from pathlib import Path

import pytest

import svbrdfgan


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


def test_type_checkers_see_the_same_names() -> None:
    source = Path(svbrdfgan.__file__).read_text(encoding="utf-8")
    block = source.split("if TYPE_CHECKING:\n")[1].split("\n\n")[0]
    for module, names in re.findall(r"from (\S+) import (.+)", block):
        for name in names.split(", "):
            assert getattr(importlib.import_module(module), name) is getattr(svbrdfgan, name)
    named = {name for _, names in re.findall(r"from (\S+) import (.+)", block) for name in names.split(", ")}
    assert named | {"__version__"} == set(svbrdfgan.__all__)


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
