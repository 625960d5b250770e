"""The plugin in `examples/plugin` passes the whole kit; from its wheel, `tests/packaging` runs the quick part."""

import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from tiers import AT_POWER, only, without

from svbrdfgan.testing import RendererTests, UVEmbeddingTests

EXAMPLE = Path(__file__).parents[2] / "examples" / "plugin"


@pytest.fixture(scope="module", autouse=True)
def _installed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The example on the path, with the entry points of its pyproject.toml."""
    folder = tmp_path_factory.mktemp("example")
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]
    info = folder / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    info.mkdir()
    groups = project["entry-points"].items()
    lines = [line for group, entries in groups for line in (f"[{group}]", *(f"{k} = {v}" for k, v in entries.items()))]
    (info / "entry_points.txt").write_text("\n".join(lines))
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(EXAMPLE))
        patch.syspath_prepend(str(folder))
        yield
    for module in [name for name in sys.modules if name.split(".")[0] == "svbrdfgan_example"]:
        del sys.modules[module]


@without("test_memory_does_not_grow", *AT_POWER)
class TestGrid(RendererTests):
    name = "grid"


@pytest.mark.full
@only("test_memory_does_not_grow", *AT_POWER)
class TestGridFull(RendererTests):
    name = "grid"


class TestCube(UVEmbeddingTests):
    name = "cube"
