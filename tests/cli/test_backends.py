"""What `svbrdfgan backends` and `embeddings` print."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from svbrdfgan.cli import main


@pytest.fixture
def plugins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two embeddings that do not work, each in a distribution of its own."""
    monkeypatch.syspath_prepend(str(tmp_path))
    for name, source in {"crash": "import os; os.abort()", "lacks": "import nowhere_to_be_found"}.items():
        (tmp_path / f"plug_{name}.py").write_text(source)
        (tmp_path / f"{name}-1.0.dist-info").mkdir()
        entry = f"[svbrdfgan.uv_embeddings]\n{name} = plug_{name}:Made\n"
        (tmp_path / f"{name}-1.0.dist-info/entry_points.txt").write_text(entry)


@pytest.mark.usefixtures("plugins")
def test_json_lists_the_broken_beside_the_rest() -> None:
    result = CliRunner().invoke(main, ["embeddings", "--json"])
    found = {row["name"]: row for row in json.loads(result.stdout)}
    assert {"name", "distribution", "status", "reason", "capabilities"} <= set(found["crash"])
    assert [found[name]["status"] for name in ("crash", "lacks")] == ["broken", "missing"]
    assert "pip install 'lacks[lacks]'" in found["lacks"]["reason"]
    assert found["hemispherical"]["distribution"] == "svbrdfgan"
    assert (result.exit_code, result.stderr) == (0, "")


@pytest.mark.usefixtures("plugins")
def test_the_table_says_why() -> None:
    result = CliRunner(env={"COLUMNS": "200"}).invoke(main, ["embeddings"])
    assert "hemispherical" in result.stdout
    assert "SIGABRT" in result.stdout
    assert result.exit_code == 0


def test_renderers() -> None:
    rows = json.loads(CliRunner().invoke(main, ["backends", "--json"]).stdout)
    assert {"numpy", "warp"} <= {row["name"] for row in rows}
    assert all(row["capabilities"]["maps"] for row in rows if row["status"] == "ok")
