"""What `svbrdfgan backends` and `embeddings` print."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from svbrdfgan.cli import backends, main


@pytest.fixture
def plugins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Four embeddings that do not work, each in a distribution of its own; two claim the same name."""
    monkeypatch.syspath_prepend(str(tmp_path))
    sources = {"crash": "import os; os.abort()", "lacks": "import nowhere_to_be_found", "one": "", "two": ""}
    for name, source in sources.items():
        (tmp_path / f"plug_{name}.py").write_text(source)
        (tmp_path / f"{name}-1.0.dist-info").mkdir()
        claimed = "twin" if name in ("one", "two") else name
        entry = f"[svbrdfgan.uv_embeddings]\n{claimed} = plug_{name}:Made\n"
        (tmp_path / f"{name}-1.0.dist-info/entry_points.txt").write_text(entry)


def listing_only(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    """Lists these plugins alone: each one listed costs a process."""
    listed = backends.list_plugins
    monkeypatch.setattr(backends, "list_plugins", lambda group: tuple(p for p in listed(group) if p.name in names))


@pytest.mark.usefixtures("plugins")
def test_json_lists_the_broken_beside_the_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    listing_only(monkeypatch, "crash", "lacks", "twin", "hemispherical")
    result = CliRunner().invoke(main, ["--quiet", "embeddings", "--json"])
    found = {row["name"]: row for row in json.loads(result.stdout)}
    assert {"name", "distribution", "status", "reason", "capabilities"} <= set(found["crash"])
    assert [found[name]["status"] for name in ("crash", "lacks")] == ["broken", "missing"]
    assert "pip install 'lacks[lacks]'" in found["lacks"]["reason"]
    assert found["hemispherical"]["distribution"] == "svbrdfgan"
    twins = [row for row in json.loads(result.stdout) if row["name"] == "twin"]
    assert [(row["distribution"], row["status"]) for row in twins] == [("one", "broken"), ("two", "broken")]
    assert all("claimed by one 1.0 and two 1.0" in row["reason"] for row in twins)
    assert (result.exit_code, result.stderr) == (0, "")


@pytest.mark.usefixtures("plugins")
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("twin", "is claimed by one 1.0 and two 1.0; uninstall one of them."),
        ("lacks", "needs nowhere_to_be_found, which is not installed: pip install 'lacks[lacks]'."),
        ("hemisperical", "did you mean 'hemispherical'?"),
    ],
)
def test_naming_one_in_a_configuration_is_one_sentence(
    name: str, said: str, dataset_data: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    (tmp_path / "dataset.yaml").write_text(json.dumps(dataset_data(embedding=name)))
    result = CliRunner().invoke(main, ["dataset", str(tmp_path / "dataset.yaml"), "-o", str(tmp_path / "out")])
    assert result.exit_code == 1
    (line,) = result.stderr.strip().splitlines()
    assert said in line
    assert not (tmp_path / "out" / "train").exists()


@pytest.mark.full
@pytest.mark.usefixtures("plugins")
def test_the_table_says_why() -> None:
    result = CliRunner(env={"COLUMNS": "200"}).invoke(main, ["embeddings"])
    assert "hemispherical" in result.stdout
    assert "SIGABRT" in result.stdout
    assert result.exit_code == 0


def test_json_lists_a_renderer_and_its_options(monkeypatch: pytest.MonkeyPatch) -> None:
    listing_only(monkeypatch, "numpy")
    (row,) = json.loads(CliRunner().invoke(main, ["backends", "--json"]).stdout)
    assert (row["name"], row["status"], row["options"]["max_bounces"]) == ("numpy", "ok", 1)
    assert "base_color" in row["capabilities"]["maps"]


@pytest.mark.full
def test_renderers() -> None:
    rows = json.loads(CliRunner().invoke(main, ["backends", "--json"]).stdout)
    assert {"numpy", "warp"} <= {row["name"] for row in rows}
    assert all(row["capabilities"]["maps"] for row in rows if row["status"] == "ok")
    assert {row["name"]: row["options"] for row in rows}["numpy"]["max_bounces"] == 1


@pytest.mark.full
def test_the_table_shows_options() -> None:
    output = CliRunner(env={"COLUMNS": "200"}).invoke(main, ["backends"]).stdout
    assert "options: max_bounces=1" in output
